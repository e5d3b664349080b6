"""A needle pushed, held, pulled and pushed again through points of tissue that grip it, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .coulomb_step import Contact, CoulombStep, Friction
from .gaussian_weights import gaussian_weights
from .stepwise_tissue import StepwiseTissue, StepwiseTissueState

Array = NDArray[np.float64]

_SAME_PLACE = 1e-9
"""Widths by which places may differ that are the same."""
_KEPT = 2
"""Lengths of a step whose compliance is kept."""


@dataclass(frozen=True, eq=False, repr=False)
class StepwiseNeedleState(ByBits):
    """A needle in tissue at an instant, with all of their past that counts."""

    tissue: StepwiseTissueState
    travel: float
    """How far the tip has gone along the needle from the entry."""
    contact: Contact

    @property
    def force(self) -> float:
        """All of the needle's force on the tissue, along it."""
        return float(self.contact.forces.sum() + self.contact.tip_force)

    @property
    def displacement(self) -> Array:
        """(nx, ny, nz, 3) of the nodes, in the world."""
        return self.tissue.displacement

    def __repr__(self) -> str:
        return f"StepwiseNeedleState(travel {self.travel:.4g}, force {self.force:.4g}, {self.contact!r})"


class StepwiseNeedle:
    """Coulomb friction along a rigid, straight needle, by complementarity and direct solution.

    **Tissue.** Point i of the tissue lies at X_i while undeformed, at depth s_i = (X_i - entry) d along the
    needle's direction d. A force of the needle on it is smoothed by a Gaussian of width a: nodal forces
    b_i d, with b_i the integrals of the Gaussian times the hat functions. It works on the mean by the same
    weights, w_i = b_i u d, so that with K of :class:`StepwiseTissue` the compliance of all points is symmetric:

        w = w0 + C f,   C_ij = (b_i d) K^-1 (b_j d),   w0 of what has relaxed until now

    **Slip.** With z the travel of the tip, what is beside point i is the place c_i = z - s_i - w_i behind the
    tip. The needle slides past the point at the rate dc_i/dt = dz/dt - dw_i/dt, and Coulomb's law says

        dc_i > 0 only where f_i = q_i,   dc_i < 0 only where f_i = -q_i,   -q_i <= f_i <= q_i

    Over a step, implicitly, with the place c_i at its start and the gap g_i = w_i - (z - s_i - c_i), which is the
    slip's negative: g_i = 0 within the bounds, <= 0 at the upper, >= 0 at the lower one. As C is positive
    definite these are the conditions of the minimum of f C f / 2 + (w0 - z + s + c) f within the bounds. A bound is
    static friction where the point stuck at the start of the step, and kinetic friction where it slid that way;
    what begins to slide within the step slides with kinetic friction at its end. Viscous friction adds b_i dc_i/dt to
    the force of a point beside the needle. Of f = r - D g with D = b / dt the dry part r meets the same conditions with
    (1 + C D)^-1 C and (1 + C D)^-1 (w0 - z + s + c) in the place of both.

    **Points past the tip.** A point that slid back to c_i < 0 has lost the needle: it carries no force and
    springs back, which pulls others past the tip but none behind it again. The needle that comes again
    meets it where c_i = 0 and only pushes it then: the same law with bounds 0 and q_i. So a cut
    track is taken again against friction alone.

    **Tip.** The end of the cut track lies at depth S. The tip pushes it with t in [0, R(S)] and gap
    g = w(S) - (z - S): it is ahead of the tip (g >= 0) where t = 0, at the tip where t is between, and at
    t = R(S) it is cut: S grows until the tip is at S again, w(S) + S = z with R at S. A point is
    reached where S = s_i, and pushed from then on like any other that the needle meets, with c_i = 0.

    **Work.** F dz = F du + sum f_i dc_i + R dl: what the tissue takes up, friction, and cutting, with dl the way of
    the cut, dS in undeformed and dS + (b(S + dS) - b(S)) u d in deformed tissue. Where the means of both ends stand
    for a step's forces the sum is exact, whatever the step.

    A step's error is of first order in its travel, where points change from sticking to sliding within it; no
    iteration is left unfinished. A point is gripped as a whole once the tip is at it, so that the force of a needle
    steps by q_i there. Points may be as dense as one likes: nearer than a width their forces cannot be told
    apart, but the sum and the field can.

    Parameters
    ----------
    body : StepwiseTissue
        What the needle is in.
    entry : (3,) array_like
        Where the tip is at zero travel, in the world.
    points : (m, 3) array_like
        X_i, in the world, each deeper along the needle than the one before. The track leads from the entry
        through them, and straight on from the last.
    direction : (3,) array_like, optional
        d; by default from the entry to the last point.
    width : float
        a, in the unit of the grid, above zero.
    bounds : (m,) or float array_like
        q_i, static friction of each point: force per length times the length it stands for; mN for mm and kPa.
    kinetic : (m,) or float array_like, optional
        Kinetic friction, at most the static one, which it is by default.
    viscous : (m,) or float array_like, default: 0.0
        b_i, force of a point by the speed of its slip, at or above zero; none in a step of no time, nor in that in
        which the tip comes to the point.
    cutting : float or callable, default: 0.0
        R: a number, or what gives it of the depth S.

    Raises
    ------
    ValueError
        Points that do not follow each other along the needle or lie outside the tissue, or forces out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.fem import StepwiseNeedle, StepwiseTissue
    >>> body = StepwiseTissue(ss.Tissue(ss.Grid.unit_cube(9)))
    >>> points = np.column_stack([np.arange(0.1, 0.65, 0.1), np.full(6, 0.5), np.full(6, 0.5)])
    >>> needle = StepwiseNeedle(body, entry=(0, 0.5, 0.5), points=points, width=0.1, bounds=0.003, cutting=0.007)
    >>> pushed = needle.path(needle.rest, np.linspace(0.05, 0.5, 10))[-1]
    >>> pulled = needle.path(pushed, np.linspace(0.45, 0.3, 4))[-1]
    >>> pushed, round(pulled.force, 4)
    (StepwiseNeedleState(travel 0.5, force 0.019, Contact(cut 0.4912, 4 of 6 points touching)), -0.009)
    """

    def __init__(
        self,
        body: StepwiseTissue,
        *,
        entry: ArrayLike,
        points: ArrayLike,
        width: float,
        bounds: ArrayLike,
        direction: ArrayLike | None = None,
        kinetic: ArrayLike | None = None,
        viscous: ArrayLike = 0.0,
        cutting: float | Callable[[float], float] = 0.0,
    ) -> None:
        self.body = body
        self.entry, self.points = _validate.vector("entry", entry), _validate.points("points", points)
        along = self.points[-1] - self.entry if direction is None else _validate.vector("direction", direction)
        self.direction = along / np.linalg.norm(along)
        depths = (self.points - self.entry) @ self.direction
        if not (np.diff(depths, prepend=0.0) > 0).all():
            raise ValueError(f"points lie at depths {depths.tolist()}; give each deeper than the one before")
        body.tissue.check_inside(entry=self.entry, points=self.points[-1])
        self.width = _validate.number("width", width, positive=True)
        static = _friction("bounds", bounds, len(depths))
        slower = static if kinetic is None else _friction("kinetic", kinetic, len(depths))
        if (slower > static).any():
            raise ValueError(f"kinetic = {slower.max():g} is above static friction; give at most the bounds")
        drag = _friction("viscous", viscous, len(depths))
        force = cutting if callable(cutting) else _validate.number("cutting", cutting)
        resistance = force if callable(force) else lambda depth: force
        self.friction = Friction(depths, static, slower, drag, resistance)
        self._weights = np.stack([self._weights_at(depth) for depth in depths])
        self._shafts: dict[float, _Shaft] = {}

    @cached_property
    def rest(self) -> StepwiseNeedleState:
        """The tip at the entry, in tissue that nothing has moved yet."""
        return StepwiseNeedleState(self.body.rest, 0.0, Contact.none(len(self.points)))

    def step(self, state: StepwiseNeedleState, travel: float, dt: float = 0.0) -> StepwiseNeedleState:
        """Return the state with the tip at a travel, a time later.

        Parameters
        ----------
        state : StepwiseNeedleState
            Before.
        travel : float
            Of the tip from the entry, along the needle; below zero it is outside.
        dt : float, default: 0.0
            Seconds, at or above zero.

        Raises
        ------
        ValueError
            A travel that leaves the tissue.
        """
        travel, dt = _validate.real("travel", travel), _validate.number("dt", dt)
        if travel > 0:
            self.body.tissue.check_inside(tip=self.entry + travel * self.direction)
        track = _Track(self._shaft(dt), self._along(self.body.free_response(state.tissue, dt)))
        step = CoulombStep(self.friction, state.contact, travel, dt, track.response, _SAME_PLACE * self.width)
        contact = step.advance()
        tissue = self.body.step(state.tissue, self.nodal_forces(contact), dt)
        return StepwiseNeedleState(tissue, travel, contact)

    def path(self, state: StepwiseNeedleState, travels: Iterable[float], dt: float = 0.0) -> list[StepwiseNeedleState]:
        """Return the states after steps to one travel after the other, each of a time."""
        states = [state]
        for travel in travels:
            states.append(self.step(states[-1], travel, dt))
        return states[1:]

    def nodal_forces(self, contact: Contact) -> Array:
        """Return the forces (nx, ny, nz, 3) of the needle on the nodes, in the world."""
        forces = np.tensordot(contact.forces, self._weights, 1) + contact.tip_force * self._weights_at(contact.cut)
        return forces[..., None] * self.direction

    def smoothed(self, displacement: Array, depth: float | None = None) -> Array:
        """Return what the points' forces work on: means (m,) along the needle of a displacement (nx, ny, nz, 3).

        With a depth of the track, that at it.
        """
        weights = self._weights if depth is None else self._weights_at(depth)
        means: Array = np.tensordot(weights, displacement @ self.direction, 3)
        return means

    def _along(self, displacement: Array) -> Array:
        """Of a displacement along the grid's axes, the part along the needle."""
        return displacement @ (self.direction @ self.body.tissue.grid.direction)

    def _weights_at(self, depth: float) -> Array:
        """Of a depth of the track, the weights (nx, ny, nz) of the nodes."""
        depths = (self.points - self.entry) @ self.direction
        last = self.points[-1] + max(depth - depths[-1], 0.0) * self.direction
        known, places = np.append(0.0, depths), np.vstack([self.entry, self.points])
        place = np.array([np.interp(depth, known, axis) for axis in places.T])
        return gaussian_weights(self.body.tissue, place + last - self.points[-1], self.width)

    def _shaft(self, dt: float) -> _Shaft:
        """The points' responses within a step of a time, which elastic tissue does not know."""
        key = dt if len(self.body.times) else 0.0
        if key not in self._shafts:
            while len(self._shafts) >= _KEPT:
                self._shafts.pop(next(iter(self._shafts)))
            self._shafts[key] = _Shaft(self, key)
        return self._shafts[key]

    def __repr__(self) -> str:
        return f"StepwiseNeedle({self.body!r}, {len(self.points)} points)"


class _Shaft:
    """How points of the track answer to forces on each other, within a step of one time."""

    def __init__(self, needle: StepwiseNeedle, dt: float) -> None:
        self._needle, self._dt = needle, dt
        self.weights = needle._weights
        self.responses = np.stack([self.response_to(weights) for weights in self.weights])
        self.compliance = np.tensordot(self.weights, self.responses, ((1, 2, 3), (1, 2, 3)))

    def response_to(self, weights: Array) -> Array:
        """Displacement (nx, ny, nz) along the needle under a unit force along it."""
        body = self._needle.body
        force = weights[..., None] * (self._needle.direction @ body.tissue.grid.direction)
        return self._needle._along(body.response(force, self._dt))

    def weights_at(self, depth: float) -> Array:
        return self._needle._weights_at(depth)


class _Track:
    """The shaft, and the end of its track wherever that is, within one step."""

    def __init__(self, shaft: _Shaft, free: Array) -> None:
        self._shaft, self._free = shaft, free
        self._known: dict[float, tuple[Array, Array]] = {}

    def response(self, cut: float) -> tuple[Array, Array]:
        """Compliance (m + 1, m + 1) of the points and the end of the track, and where they go without force."""
        if cut not in self._known:
            weights = np.stack([*self._shaft.weights, self._shaft.weights_at(cut)])
            responses = np.stack([*self._shaft.responses, self._shaft.response_to(weights[-1])])
            self._known[cut] = np.tensordot(weights, responses, ((1, 2, 3),) * 2), np.tensordot(weights, self._free, 3)
        return self._known[cut]


def _friction(name: str, values: ArrayLike, points: int) -> Array:
    friction = np.array([_validate.number(name, value) for value in np.ravel(values)])
    if len(friction) not in (1, points):
        raise ValueError(f"{name} has {len(friction)} values; give one, or one for each of the {points} points")
    return np.broadcast_to(friction, points).copy()
