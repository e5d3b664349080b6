"""Dents of a probe that slides and presses: solved at places of a lattice, kept, and blended in between."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .probe_contact import DEEPEST, Dent, ProbeContact

Array = NDArray[np.float64]

STEP_MM = 2.0
"""Between two dents that are solved: of slide along both sides of the skin, and of depth."""

_TURN_DECIMALS = 2
"""To which the probe's axes are rounded: half a degree."""
_KEPT_BYTES = 128e6


class Blend(NamedTuple):
    """A sum of dents."""

    parts: tuple[tuple[float, Dent], ...]
    """Weight, above zero, and dent: at most eight that touch, whose weights add up to one or less."""

    @property
    def force_n(self) -> float:
        """Of the probe on the tissue, into it, N."""
        return float(sum(weight * dent.force_n for weight, dent in self.parts))

    def __repr__(self) -> str:
        return f"Blend({len(self.parts)} dents, {self.force_n:.3g} N)"


class ProbeDents:
    """The dent of a probe at any pose, from those on a lattice of 2 mm.

    What is kept saves time and changes no bit: each dent is solved from rest.

    Parameters
    ----------
    contact : ProbeContact
        What solves them.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, ProbeContact, ProbeDents
    >>> from sonospline.mechanics import Footprint, Material
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.covering((100, 100, 60), nodes=9000), "z-"), Material(10), nodes=13**3)
    >>> dents = ProbeDents(ProbeContact(solver, Footprint(40, 16)))
    >>> pressed = dents.at(ss.facing((50, 50, 5), depth=(0, 0, 1), right=(1, 0, 0)))
    >>> pressed
    Blend(2 dents, 2.82 N)
    """

    def __init__(self, contact: ProbeContact) -> None:
        self.contact = contact
        self._kept: dict[tuple[bytes, tuple[int, ...]], Dent] = {}
        self._most = max(64, int(_KEPT_BYTES / contact.solver.rest.displacement.nbytes))

    def at(self, probe_to_reference: Array, force_n: float | None = None) -> Blend:
        """Return the dent of a probe at a pose (4, 4), as deep as its origin is, or as deep as a force presses it.

        Raises
        ------
        ValueError
            A middle beyond the skin, a probe too deep, or a force that would press it too deep.
        NotConvergedError
            As :meth:`ProbeContact.dent`.
        """
        turn = _rounded(probe_to_reference[:3, :3])
        sideways, depth = self._place(probe_to_reference)
        if force_n is not None:
            depth = self._depth_under(force_n, turn, sideways)
        self.contact.check(self._pose(probe_to_reference[:3, :3], (*sideways, depth)))
        return self._blend(turn, (*sideways, depth))

    def _place(self, probe_to_reference: Array) -> tuple[tuple[float, float], float]:
        """Where the middle of the probe's face is along the skin, and how deep, in steps."""
        middle = probe_to_reference[:3, 3]
        first, second = self.contact.solver.grid.local(middle)[list(self.contact.face.along)] / STEP_MM
        return (float(first), float(second)), float(self.contact.depth(middle)) / STEP_MM

    def _pose(self, turn: Array, place: tuple[float, ...]) -> Array:
        """The pose with its middle at a place, in steps."""
        face, grid = self.contact.face, self.contact.solver.grid
        local, depth = np.zeros(3), STEP_MM * place[2]
        local[list(face.along)] = STEP_MM * np.array(place[:2])
        local[face.axis] = depth if face.inward > 0 else grid.extent[face.axis] - depth
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, grid.world(local)
        return pose

    def _blend(self, turn: Array, place: tuple[float, ...]) -> Blend:
        low = [int(np.floor(at)) for at in place]
        shares = [((n, 1 - (at - n)), (n + 1, at - n)) for n, at in zip(low, place, strict=True)]
        parts = []
        for corner in product(*shares):
            weight = corner[0][1] * corner[1][1] * corner[2][1]
            if weight > 0:
                parts.append((weight, self._dent(turn, tuple(n for n, _ in corner))))
        return Blend(tuple((weight, dent) for weight, dent in parts if dent.force_n > 0))

    def _dent(self, turn: Array, place: tuple[int, ...]) -> Dent:
        key = turn.tobytes(), place
        known = self._kept.get(key)
        if known is None:
            known = self.contact.unchecked(self._pose(turn, place))
            if len(self._kept) >= self._most:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[key] = known
        return known

    def _depth_under(self, force_n: float, turn: Array, sideways: tuple[float, float]) -> float:
        """How deep a force presses the probe, in steps: blended forces are linear between two of them."""
        face = self.contact.face
        reach = float(self.contact.depth(self.contact.footprint_at(self._pose(turn, (*sideways, 0.0)))).max())
        first = int(np.floor(-reach / STEP_MM))
        last = int(np.ceil(DEEPEST * self.contact.solver.grid.extent[face.axis] / STEP_MM))
        before = 0.0
        for level in range(first + 1, last + 1):
            force = self._blend(turn, (*sideways, float(level))).force_n
            if force >= force_n:
                return level - 1 + (force_n - before) / (force - before) if force > before else float(level - 1)
            before = force
        raise ValueError(
            f"force_n = {force_n:g} presses deeper than a third of the tissue; give at most {before:.3g} N here"
        )

    def __repr__(self) -> str:
        return f"ProbeDents({self.contact.footprint!r}, {len(self._kept)} kept)"


def _rounded(turn: Array) -> Array:
    """A rotation near to one, the same for all that are nearer still."""
    left, _, right = np.linalg.svd(np.round(turn, _TURN_DECIMALS) + 0.0)
    return np.ascontiguousarray(left @ right)
