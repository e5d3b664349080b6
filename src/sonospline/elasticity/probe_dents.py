"""Dents of a probe that slides, turns and presses: solved at places of a lattice, kept, and blended in between.

A pose is six numbers: where the middle of the face is along the two sides of the skin, how deep, and three angles. Each
is counted in steps, and a dent at a pose is the linear interpolation of those at the corners of the simplex that it
is in (Kuhn's, of the cube around it): one more than there are numbers between two steps, where multilinear blending
takes two to that power.
"""

from __future__ import annotations

from math import asin, atan2, floor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .probe_contact import DEEPEST, Dent, ProbeContact

Array = NDArray[np.float64]
Place = tuple[float, ...]
"""Along the skin twice, depth, spin about the depth, fan about the image's x, rock about the probe's z; in steps."""

STEP_MM = 2.0
"""Between two dents that are solved: of slide along both sides of the skin, and of depth."""
TURN_DEG = 3.0
"""Of the angles: it moves the ends of a face of 60 mm by 1.6."""

_DEPTH = 2
_NEAR = 6
"""Decimals of a step that are told apart: rounding must not ask for a dent of no weight."""
_KEPT_BYTES = 128e6


class Blend(NamedTuple):
    """A sum of dents."""

    parts: tuple[tuple[float, Dent], ...]
    """Weight, above zero, and dent: at most seven that touch, whose weights add up to one or less."""

    @property
    def force_n(self) -> float:
        """Of the probe on the tissue, into it, N."""
        return float(sum(weight * dent.force_n for weight, dent in self.parts))

    def __repr__(self) -> str:
        return f"Blend({len(self.parts)} dents, {self.force_n:.3g} N)"


class ProbeDents:
    """The dent of a probe at any pose, from those on a lattice of 2 mm and 3 degrees.

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
        self._kept: dict[tuple[int, ...], Dent] = {}
        self._most = max(64, int(_KEPT_BYTES / contact.solver.rest.displacement.nbytes))
        self._axes = _axes(contact)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_kept": {}}

    def at(self, probe_to_reference: Array, force_n: float | None = None) -> Blend:
        """Return the dent of a probe at a pose (4, 4), as deep as its origin is, or as deep as a force presses it.

        Raises
        ------
        ValueError
            A middle beyond the skin, a probe too deep, or a force that would press it too deep.
        NotConvergedError
            As :meth:`ProbeContact.dent`.
        """
        if force_n is not None:
            probe_to_reference = self.pressed(probe_to_reference, force_n)
        self.contact.check(probe_to_reference)
        return self._blend(self._place(probe_to_reference))

    def pressed(self, probe_to_reference: Array, force_n: float) -> Array:
        """Return a pose (4, 4) of the probe as deep as a force presses it, wherever it is above or below the skin.

        Raises
        ------
        ValueError
            As :meth:`at`.
        """
        contact, face = self.contact, self.contact.face
        there = np.array(probe_to_reference, float)
        deep = STEP_MM * self._depth_under(force_n, self._place(there)) - float(contact.depth(there[:3, 3]))
        there[:3, 3] += deep * face.inward * contact.solver.grid.direction[:, face.axis]
        return there

    def _place(self, probe_to_reference: Array) -> Place:
        """Where a pose is, in steps."""
        middle = probe_to_reference[:3, 3]
        along = self.contact.solver.grid.local(middle)[list(self.contact.face.along)]
        turned = self._axes.T @ probe_to_reference[:3, :3]
        (_, _, sine), (sr, cr, sf), (_, _, cosine) = turned.tolist()
        angles = np.degrees([atan2(sine, cosine), -asin(max(-1.0, min(1.0, sf))), atan2(sr, cr)])
        steps = np.array([*along, self.contact.depth(middle), *angles]) / _STEPS
        return tuple(np.round(steps, _NEAR).tolist())

    def _pose(self, place: Place) -> Array:
        """The pose at a place."""
        face, grid = self.contact.face, self.contact.solver.grid
        first, second, depth, spin, fan, rock = (np.array(place) * _STEPS).tolist()
        local = np.zeros(3)
        local[list(face.along)] = first, second
        local[face.axis] = depth if face.inward > 0 else grid.extent[face.axis] - depth
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._axes @ _turned(*np.radians([spin, fan, rock]).tolist()), grid.world(local)
        return pose

    def _blend(self, place: Place) -> Blend:
        blended = [(weight, self._dent(corner)) for weight, corner in _simplex(place)]
        return Blend(tuple((weight, dent) for weight, dent in blended if dent.force_n > 0))

    def _dent(self, place: tuple[int, ...]) -> Dent:
        known = self._kept.get(place)
        if known is None:
            known = self.contact.unchecked(self._pose(place))
            if len(self._kept) >= self._most:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[place] = known
        return known

    def _depth_under(self, force_n: float, place: Place) -> float:
        """How deep a force presses the probe, in steps: blended forces are linear between the depths of corners."""
        face, sideways = self.contact.face, self._pose(_deep(place, 0.0))
        reach = float(self.contact.depth(self.contact.footprint_at(sideways)).max())
        first = int(np.floor(-reach / STEP_MM))
        last = int(np.ceil(DEEPEST * self.contact.solver.grid.extent[face.axis] / STEP_MM))
        shares = sorted({share for share in np.round(np.mod(_deep(place, 0.0), 1.0), _NEAR).tolist() if share > 0})
        before, above = 0.0, float(first)
        for level in range(first + 1, last + 1):
            if self._force(place, float(level)) < force_n:
                before, above = self._force(place, float(level)), float(level)
                continue
            for depth in (*(level - 1 + share for share in shares), float(level)):
                force = self._force(place, depth)
                if force >= force_n:
                    return above + (depth - above) * (force_n - before) / (force - before) if force > before else above
                before, above = force, depth
        raise ValueError(
            f"force_n = {force_n:g} presses deeper than a third of the tissue; give at most {before:.3g} N here"
        )

    def _force(self, place: Place, depth: float) -> float:
        return self._blend(_deep(place, depth)).force_n

    def __repr__(self) -> str:
        return f"ProbeDents({self.contact.footprint!r}, {len(self._kept)} kept)"


_STEPS = np.array([STEP_MM] * 3 + [TURN_DEG] * 3)


def _deep(place: Place, depth: float) -> Place:
    return *place[:_DEPTH], depth, *place[_DEPTH + 1 :]


def _axes(contact: ProbeContact) -> Array:
    """The world's axes of a probe that faces the tissue: its x along the skin, y deep, z = x cross y."""
    face, direction = contact.face, contact.solver.grid.direction
    right, deep = direction[:, face.along[0]], face.inward * direction[:, face.axis]
    return np.column_stack([right, deep, np.cross(right, deep)])


def _turned(spin: float, fan: float, rock: float) -> Array:
    """A rotation (3, 3): by spin about y, by fan about x then, and by rock about z then."""
    (cs, cf, cr), (ss, sf, sr) = np.cos([spin, fan, rock]).tolist(), np.sin([spin, fan, rock]).tolist()
    return np.array(
        [
            [cs * cr + ss * sf * sr, ss * sf * cr - cs * sr, ss * cf],
            [cf * sr, cf * cr, -sf],
            [cs * sf * sr - ss * cr, ss * sr + cs * sf * cr, cs * cf],
        ]
    )


def _simplex(place: Place) -> list[tuple[float, tuple[int, ...]]]:
    """Corners of the simplex that a place is in, and its coordinates there, above zero."""
    corner = [floor(at) for at in place]
    shares = [at - low for at, low in zip(place, corner, strict=True)]
    last, found = 1.0, []
    for number in sorted(range(len(place)), key=lambda number: -shares[number]):
        if last > shares[number]:
            found.append((last - shares[number], tuple(corner)))
        last = shares[number]
        corner[number] += 1
    return [*found, (last, tuple(corner))] if last > 0 else found
