"""NumPy twin of the core's force in the hand: the same law, for any number of hands at once, in virtual time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .checks import require

Array = NDArray[np.float64]

_UNSURE, _RESTART, _REACH, _VELOCITY_TICKS, _MOST = 3, 0.5, 1e5, 4, 1e9
_SETTLING, _SETTLED = 32, 1e-4


class Options(NamedTuple):
    """Numbers of a law, in the order in which the core takes them: mm, N, s."""

    period: float
    stiffness: float
    damping: float
    delay: float
    hand_acceleration: float
    hand_mass: float
    """N s2/mm."""
    most_force: float
    most_rate: float
    swap: float
    swap_step: float
    device_stale: float
    contact_stale: float
    fade: float
    seed: float
    """Net work that the loop may do on the hand before the hand has done any, N mm."""
    most_stored: float
    withdrawn: float
    """Way behind the tip on which a point lets go of the needle, mm."""
    tolerance: float


class Contact(NamedTuple):
    """What a tissue model knows of one needle at one moment; as :class:`~sonospline.contact.FrozenContact`."""

    compliance: Array
    places: Array
    displacement: Array
    forces: Array
    anchors: Array
    low: Array
    high: Array
    tip: int
    axis: Array
    origin: Array
    lateral_stiffness: float
    lateral_force: Array

    def checked(self) -> Contact:
        """Return it where it is sound."""
        n = len(self.places)
        require(1 <= n <= 1000, "places is not of 1 to 1000 points")
        require(self.compliance.shape == (n, n), "compliance is not square, of the length of places")
        require(_bounded(self.compliance), "compliance is not finite")
        require(bool((self.compliance.diagonal() > 0).all()), "compliance has no diagonal above 0")
        for values in (self.displacement, self.forces, self.anchors, self.low, self.high):
            require(values.shape == (n,), "displacement, forces, anchors, low or high is not of the length of places")
        sound = all(map(_bounded, self[1:7]))
        require(sound, "places, displacement, forces, anchors, low or high is not finite")
        require(bool((self.low <= 0).all() & (self.high >= 0).all()), "low is above 0, or high below it")
        require(-1 <= self.tip < n, "tip is neither -1 nor a point")
        sound = all(_bounded(three) for three in (self.axis, self.origin, self.lateral_force))
        require(sound, "axis, origin or lateral_force is not finite")
        require(bool(abs(self.axis @ self.axis - 1) < 1e-6), "axis is not of length 1")
        require(0 <= self.lateral_stiffness <= _MOST, "lateral_stiffness is not at or above 0")
        return self


class ForceLaw:
    """Hands that hold a needle each, all in the same frozen contact, tick by tick.

    Threads may share the compiled one: each call is whole.

    Parameters
    ----------
    hands : int
        How many.
    options : (17,) ndarray
        As :class:`Options` has them.
    sweeps : int
        Of projected Gauss-Seidel in a tick, at most.
    """

    def __init__(self, hands: int, options: Array, sweeps: int) -> None:
        require(1 <= hands <= 1_000_000, "hands is not between 1 and 1000000")
        require(np.shape(options) == (17,), "options are not 17 numbers")
        self._options = o = Options(*map(float, options))
        require(all(0 <= x <= _MOST for x in o), "options are not at or above 0")
        require(all(o[i] > 0 for i in (0, 1, 5, 6, 7, 8, 9, 12, 15)), "options are not above 0 where they divide")
        require(5e-5 <= o.period <= 0.1, "period is not between 0.05 and 100 ms")
        require(o.delay <= 1, "delay is above a second")
        require(1 <= sweeps <= 1000, "sweeps is not between 1 and 1000")
        self._hands, self._sweeps, self._ticks = hands, sweeps, 0
        self._contact: Contact | None = None
        self._next: Contact | None = None
        self._waits = np.zeros(hands, bool)
        self._forces = self._anchors = np.zeros((hands, 0))
        delays = int(np.ceil(o.delay / o.period)) + 1
        self._seed, self._stored = np.full(hands, o.seed), np.full((delays, hands), o.seed)
        self._stretch, self._fade, self._used_up = np.zeros(hands), np.zeros(hands), np.zeros(hands)
        self._offset, self._limited, self._wanted = (np.zeros((hands, 3)) for _ in range(3))
        self._offset_left, self._offset_step = np.zeros(hands), np.zeros(hands)
        self._placed = np.zeros(hands, bool)
        self._sent = np.zeros((delays + _UNSURE - 1, hands, 3))
        self._been = np.zeros((_VELOCITY_TICKS, hands, 3))

    def renew(
        self, compliance: Array, places: Array, displacement: Array, forces: Array, anchors: Array, low: Array,
        high: Array, tip: int, axis: Array, origin: Array, lateral_stiffness: float, lateral_force: Array,
    ) -> None:  # fmt: skip
        """Have another contact from the next tick on that hears of its hand."""
        given = (compliance, places, displacement, forces, anchors, low, high, tip, axis, origin)
        self._next = Contact(*given, lateral_stiffness, lateral_force).checked()
        self._waits[:] = True

    def tick(self, positions: Array, device_age: Array, contact_age: float) -> Array:
        """Return the forces (hands, 3) on hands that are at positions (hands, 3), until the next tick, N."""
        fits = positions.shape == (self._hands, 3) and device_age.shape == (self._hands,)
        require(fits, "positions or device_age is not one a hand")
        o, now, last = self._options, self._ticks % _VELOCITY_TICKS, (self._ticks - 1) % _VELOCITY_TICKS
        heard = (np.abs(positions) <= _REACH).all(axis=1) & (device_age <= o.device_stale)
        here = np.where(heard[:, None], positions, self._been[last])
        first = heard & ~self._placed
        self._been[:, first] = here[first]
        self._placed |= heard
        self._account(heard, here - self._been[last])
        self._been[now] = here
        begins = heard & self._waits
        self._waits &= ~heard
        if begins.any():
            self._install(begins)
            self._settle(begins, here)
            self._begin_swap(begins)
        if self._contact is not None:
            self._feel(self._contact, heard & ~begins, here)
        self._offset_left[heard] = np.maximum(0, self._offset_left - self._offset_step)[heard]
        shows = heard & (self._contact is not None) & (contact_age <= o.contact_stale)
        self._fade = np.clip(self._fade + np.where(shows, 1, -1) * o.period / o.fade, 0, 1)

        target = _at_most(o.most_force, self._wanted + self._offset_left[:, None] * self._offset)
        self._limited = self._limited + _at_most(o.most_rate * o.period, target - self._limited)
        shown = self._fade[:, None] * self._limited
        force: Array = self._passive_share(shown, device_age)[:, None] * shown
        self._sent[self._ticks % len(self._sent)] = force
        self._ticks += 1
        return force.copy()

    def state(self) -> tuple[Array, Array, Array]:
        """Return forces and anchors (hands, n), and stretch, fade and stored (hands, 3)."""
        numbers = np.stack([self._stretch, self._fade, self._stored.min(axis=0)], axis=1)
        return self._forces.copy(), self._anchors.copy(), numbers

    def _install(self, hands: NDArray[np.bool_]) -> None:
        """Let hands feel the contact that waits for them; those that wait on are not asked for their old one."""
        assert self._next is not None
        contact, o = self._next, self._options
        if contact is not self._contact:
            n = len(contact.places)
            self._compliance = contact.compliance + 1 / (o.stiffness + o.damping / o.period)
            self._base = contact.displacement + contact.places - contact.compliance @ contact.forces
            self._forces, self._anchors = np.zeros((self._hands, n)), np.zeros((self._hands, n))
            self._contact = contact
        self._forces[hands], self._anchors[hands] = contact.forces, contact.anchors

    def _settle(self, hands: NDArray[np.bool_], here: Array) -> None:
        """Let a new contact find its forces, as if time stood still for the hand."""
        assert self._contact is not None
        hands = hands.copy()
        for _ in range(_SETTLING):
            before = self._wanted.copy()
            self._feel(self._contact, hands, here)
            hands &= np.linalg.norm(self._wanted - before, axis=1) >= _SETTLED

    def _begin_swap(self, hands: NDArray[np.bool_]) -> None:
        """Keep what hands feel: the difference to the new contact's own force is given back little by little."""
        o = self._options
        self._offset[hands] = (self._limited - self._wanted)[hands]
        self._offset_left[hands] = 1
        ticks = np.maximum(o.swap / o.period, np.linalg.norm(self._offset[hands], axis=1) / o.swap_step)
        self._offset_step[hands] = 1 / ticks

    def _feel(self, contact: Contact, hands: NDArray[np.bool_], here: Array) -> None:
        """Find the contact's force on some hands, and where it slips."""
        if not hands.any():
            return
        o, tip = self._options, contact.tip
        moved = here[hands] - contact.origin
        advance = moved @ contact.axis
        damping = o.damping / o.period
        coupling = 1 / (o.stiffness + damping)
        kept = coupling * damping * self._stretch[hands]
        anchors = self._anchors[hands]
        held = np.clip(1 + anchors / o.withdrawn, 0, 1)
        if tip >= 0:
            held[:, tip] = 1
        low, high = held * contact.low, held * contact.high
        apart = self._base + anchors - (advance - kept)[:, None]
        forces, beyond = _clipped(self._compliance, apart, low, high, self._forces[hands], self._sweeps, o.tolerance)
        backward = (forces <= low) & (beyond > 0)
        if tip >= 0:
            backward[:, tip] = False
        slips = ((forces >= high) & (beyond < 0)) | backward
        self._anchors[hands], self._forces[hands] = np.where(slips, anchors - beyond, anchors), forces
        axial = forces.sum(axis=1)
        self._stretch[hands] = kept + coupling * axial
        force = contact.lateral_force - axial[:, None] * contact.axis
        if contact.lateral_stiffness > 0:
            aside = moved - advance[:, None] * contact.axis
            force = force - aside / (1 / contact.lateral_stiffness + 1 / o.stiffness)
        self._wanted[hands] = force

    def _account(self, heard: NDArray[np.bool_], way: Array) -> None:
        """Count the work on hands on their last way, for each delay that may be, by the worst of a few forces."""
        room, delays = len(self._sent), len(self._stored)
        ago = (self._ticks - 1 - np.arange(room)) % room
        work = np.einsum("thi,hi->th", self._sent[ago], way)
        most = np.where(heard, np.max([work[late : late + delays] for late in range(_UNSURE)], axis=0), 0)
        self._stored = np.where(heard, np.minimum(self._stored - most, self._options.most_stored), self._stored)
        self._used_up[heard] = np.where(self._stored.min(axis=0) > 0, 0, self._used_up + self._options.period)[heard]
        again = heard & (self._used_up >= _RESTART)
        self._seed[again] /= 2
        self._stored[:, again] = self._seed[again]
        self._used_up[again] = 0

    def _passive_share(self, force: Array, device_age: Array) -> Array:
        """Return the share of forces that does no more work than is stored, wherever hands may go while they act."""
        o, size = self._options, np.linalg.norm(force, axis=1)
        most = self._stored.min(axis=0)
        unseen = o.delay + np.fmax(0, device_age) + _UNSURE * o.period
        here, before = self._been[self._ticks % _VELOCITY_TICKS], self._been[(self._ticks + 1) % _VELOCITY_TICKS]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = ((here - before) * force).sum(axis=1) / size / ((_VELOCITY_TICKS - 1) * o.period)
            late = unseen + _VELOCITY_TICKS * o.period / 2
            drift = np.where(along > 0, 2 * along, along)
            once = size * (drift * unseen + o.hand_acceleration * late * late / 2)
            twice = size * size * unseen * unseen / (2 * o.hand_mass)
            share = np.minimum(1, 2 * most / (once + np.sqrt(once * once + 4 * twice * most)))
        return np.where(size == 0, 1, np.where(most > 0, share, 0))


def _clipped(
    compliance: Array, apart: Array, low: Array, high: Array, start: Array, sweeps: int, tolerance: float
) -> tuple[Array, Array]:
    """Solve :func:`clipped_forces` for many rows at once; return the forces and how far points are beyond."""
    forces = np.clip(start, low, high)
    beyond = apart + forces @ compliance
    goes_on = np.ones(len(forces), bool)
    for _ in range(sweeps):
        largest = np.zeros(len(forces))
        for i, diagonal in enumerate(compliance.diagonal()):
            wanted = np.minimum(np.maximum(forces[:, i] - beyond[:, i] / diagonal, low[:, i]), high[:, i])
            change = np.where(goes_on, wanted - forces[:, i], 0)
            forces[:, i] += change
            beyond += change[:, None] * compliance[i]
            largest = np.maximum(largest, np.abs(change) * diagonal)
        goes_on &= largest > tolerance
        if not goes_on.any():
            break
    return forces, beyond


def _bounded(values: Array) -> bool:
    return bool((np.abs(values) <= _MOST).all())


def _at_most(most: float, vectors: Array) -> Array:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(size > most, vectors * (most / np.maximum(size, most)), vectors)
