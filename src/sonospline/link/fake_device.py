"""Hands on a device that is not there, in virtual time: mass, spring, damper, and a wire that delays and loses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core, _validate
from ..contact.frozen_contact import FrozenContact
from .coupling import SWEEPS, Coupling

Array = NDArray[np.float64]

_SUBSTEPS = 4
"""Of the hand in a tick; the force stays the same from one message to the next, whatever they are."""


@dataclass(frozen=True, eq=False)
class Felt:
    """What hands did and felt, tick by tick.

    Parameters
    ----------
    positions_mm, forces_n : (ticks, hands, 3) ndarray
        Where hands were, and the force on them, as the device applied it.
    given_j : (hands,) ndarray
        The most net work that had been done on a hand at any time.
    """

    positions_mm: Array
    forces_n: Array
    given_j: Array

    def __repr__(self) -> str:
        ticks, hands = self.forces_n.shape[:2]
        return f"Felt({ticks} ticks, {hands} hands, at most {self.given_j.max(initial=0.0):.2g} J given)"


class FakeDevice:
    """Any number of hands, each with a device of its own, in the same contact.

    Parameters
    ----------
    at_mm : (3,) array_like
        Where hands begin.
    coupling : Coupling, optional
    hands : int, default: 1
    mass_kg, stiffness_n_mm, damping_n_s_mm : float or (hands,) array_like
        Of a hand that wants to be somewhere.
    delay_ms : float or (hands,) array_like, default: 0.0
        From a motion to the force that answers it; half of it before the loop, half behind.
    jitter_ms, loss : float, default: 0.0
        More delay of a message, at random up to so much; the share of messages that never arrive, each way.
    quantum_mm : float, default: 0.0
        Positions are told apart by so much.
    seed : int, default: 0

    Examples
    --------
    A hand pushes a needle 5 mm on, in 2 s, and feels friction and cutting force; the spring of the hand gives way.

    >>> import numpy as np
    >>> from sonospline.contact import FrozenContact
    >>> from sonospline.link import FakeDevice
    >>> apart = np.subtract.outer(np.arange(5), np.arange(5))
    >>> contact = FrozenContact.at_rest(places_mm=2.0 * np.arange(-4, 1), compliance_mm_n=1 / np.hypot(1, apart),
    ...                                 friction_n=0.05, cutting_n=0.4, axis=(0, 0, 1), tip_mm=(0, 0, 40))
    >>> device = FakeDevice((0, 0, 40), stiffness_n_mm=1.0)
    >>> device.renew(contact)
    >>> felt = device.move(lambda t: (0, 0, 40 + 5 * min(t / 2, 1)), seconds=3)
    >>> felt.forces_n[-1, 0].round(1).tolist()
    [0.0, 0.0, -0.6]
    """

    def __init__(
        self, at_mm: ArrayLike, coupling: Coupling | None = None, *, hands: int = 1, mass_kg: ArrayLike = 0.5,
        stiffness_n_mm: ArrayLike = 0.5, damping_n_s_mm: ArrayLike = 0.01, delay_ms: ArrayLike = 0.0,
        jitter_ms: float = 0.0, loss: float = 0.0, quantum_mm: float = 0.0, seed: int = 0,
    ) -> None:  # fmt: skip
        self.coupling = coupling or Coupling()
        self.law = _core.active.ForceLaw(_validate.count("hands", hands), self.coupling.for_core(), SWEEPS)
        self._period_s = self.coupling.period_ms / 1000
        self._at = np.tile(_validate.vector("at_mm", at_mm), (hands, 1))
        self._speed, self._given, self._most_given = np.zeros((hands, 3)), np.zeros(hands), np.zeros(hands)
        self._mass, self._stiffness, self._damping, delay_s = (
            np.broadcast_to(np.asarray(value, float), (hands,))[:, None] / per
            for value, per in ((mass_kg, 1000), (stiffness_n_mm, 1), (damping_n_s_mm, 1), (delay_ms, 1000))
        )
        self._quantum = _validate.number("quantum_mm", quantum_mm)
        chance, wire = np.random.default_rng(seed), (delay_s[:, 0] / 2, jitter_ms / 1000, loss)
        self._there, self._back = (_Wire(hands, *wire, self._period_s, chance) for _ in range(2))
        self._tick = 0

    def renew(self, contact: FrozenContact) -> None:
        """Have another contact from now on."""
        self.law.renew(**contact.for_core())

    def move(
        self,
        wanted: Callable[[float], ArrayLike],
        seconds: float,
        *,
        contact_age_s: Callable[[float], float] = lambda now: 0.0,
    ) -> Felt:
        """Let hands go where they want to be, (hands, 3) or (3,) mm at a time in s, and return what they felt."""
        ticks = round(seconds / self._period_s)
        positions, forces = np.empty((2, ticks, *self._at.shape))
        for k in range(ticks):
            now = self._tick * self._period_s
            self._there.send(now, self._quantised())
            heard, age = self._there.newest(now)
            heard = np.where(np.isfinite(age)[:, None], heard, np.nan)
            sent = self.law.tick(heard, age, contact_age_s(now))
            self._back.send(now, sent)
            for substep in range(_SUBSTEPS):
                felt = self._back.newest(now + substep * self._period_s / _SUBSTEPS)[0]
                self._step(felt, np.asarray(wanted(now), float), self._period_s / _SUBSTEPS)
            positions[k], forces[k] = self._at, felt
            self._tick += 1
        return Felt(positions, forces, self._most_given / 1000)

    def __repr__(self) -> str:
        return f"FakeDevice({len(self._at)} hands, {self.coupling})"

    def _quantised(self) -> Array:
        if self._quantum == 0:
            return self._at
        rounded: Array = np.round(self._at / self._quantum) * self._quantum
        return rounded

    def _step(self, felt: Array, wanted: Array, dt: float) -> None:
        """The hand's own spring and damper in one unknown step of time, the device's force as it is."""
        pull = self._stiffness * (wanted - self._at) + felt
        inertia = self._mass / dt + self._damping + self._stiffness * dt
        self._speed = (self._mass / dt * self._speed + pull) / inertia
        way = self._speed * dt
        self._at = self._at + way
        self._given += (felt * way).sum(axis=1)
        self._most_given = np.maximum(self._most_given, self._given)


class _Wire:
    """Messages (hands, 3) on their way; the newest of those that have arrived is what counts."""

    def __init__(
        self, hands: int, delay_s: Array, jitter_s: float, loss: float, period_s: float, chance: np.random.Generator
    ) -> None:
        longest = float(delay_s.max(initial=0.0)) + jitter_s
        self._room = int(np.ceil(longest / period_s)) + 2
        self._arrival = np.full((self._room, hands), np.inf)
        self._messages = np.zeros((self._room, hands, 3))
        self._delay, self._jitter, self._loss, self._chance = delay_s, jitter_s, loss, chance
        self._last, self._arrived, self._sent = np.zeros((hands, 3)), np.full(hands, -np.inf), 0
        self._order = np.full((self._room,), -1)
        self._seen = np.full(hands, -1)

    def send(self, now: float, messages: Array) -> None:
        place = self._sent % self._room
        late = self._delay + self._jitter * self._chance.random(self._delay.shape)
        lost = self._chance.random(self._delay.shape) < self._loss
        self._arrival[place] = np.where(lost, np.inf, now + late)
        self._messages[place], self._order[place] = messages, self._sent
        self._sent += 1

    def newest(self, now: float) -> tuple[Array, Array]:
        """Return it, and how long ago it arrived, s: never is infinitely long."""
        order = np.where(self._arrival <= now + 1e-12, self._order[:, None], -1)
        place = order.argmax(axis=0)
        hands = np.arange(len(place))
        newer = order[place, hands] > self._seen
        self._seen = np.where(newer, order[place, hands], self._seen)
        self._last = np.where(newer[:, None], self._messages[place, hands], self._last)
        self._arrived = np.where(newer, self._arrival[place, hands], self._arrived)
        return self._last, now - self._arrived
