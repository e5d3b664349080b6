"""The track of a needle: what it has cut, where it sticks, and with which forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._by_bits import ByBits
from .._core import shaft
from ..geometry.needle import Needle

Array = NDArray[np.float64]
Single = NDArray[np.float32]


class Passage(NamedTuple):
    """Where a track goes through a membrane."""

    at: float
    """Length of the track there, mm."""
    membrane: int
    """Its number."""
    inward: bool
    """Whether it goes in there."""


@dataclass(frozen=True, eq=False, repr=False)
class Track(ByBits):
    """Points fixed in the tissue along a needle's way, one ahead of the end of the cut; forces in mN, lengths in mm.

    Parameters
    ----------
    apart : float
        Length of the way from point to point; the first is where the needle enters.
    places : (m, 3) ndarray
        The points in undeformed tissue, in the world.
    anchors : (m,) ndarray
        How far behind the tip the place on the needle is that each of them is at.
    moved : (m, 3) ndarray
        How far the tissue there had moved when the last step ended.
    axial : (m,) ndarray
        Friction at each of them, along the needle.
    lateral : (m, 3) ndarray
        Force at each across the needle, in the world.
    offsets : (m, 3) ndarray
        How far beside the axis each is to be.
    tip : float
        Force at the tip, along the needle.
    cut : float
        How long the cut is.
    compliance : (3 m, 3 m) ndarray
        Displacement of one point by a force at another, both in the world, mm per mN.
    columns : (3, 3, nx, ny, nz) ndarray
        Displacement of the solver's nodes by 1 mN at the last point along each axis of the world.
    sliding, used, held : (m,) ndarray of bool
        Which points slide, which the tip has left since it cut there, and which are held sideways.
    stays : (m,) ndarray of bool
        Where bone or a wall keeps tissue from moving, however it is pushed: it holds no shaft.
    resistance : (4, m) ndarray
        As :class:`~sonospline.contact.medium.Resistance`.
    passages : tuple of Passage
        The membranes on the way, those ahead among them.
    broken : int
        How many of them the tip has gone through.
    """

    apart: float
    places: Array
    anchors: Array
    moved: Array
    axial: Array
    lateral: Array
    offsets: Array
    tip: float
    cut: float
    compliance: Array
    columns: Single
    sliding: NDArray[np.bool_]
    used: NDArray[np.bool_]
    held: NDArray[np.bool_]
    stays: NDArray[np.bool_]
    resistance: Array
    passages: tuple[Passage, ...] = ()
    broken: int = 0

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __len__(self) -> int:
        return len(self.places)

    def changed(self, **fields: object) -> Track:
        """Return a track with some fields changed, faster than :func:`dataclasses.replace` does it with so many."""
        made = object.__new__(Track)
        made.__dict__.update({name: self.__dict__[name] for name in Track.__dataclass_fields__}, **fields)
        for value in fields.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        return made

    def back_to(self, before: Track) -> Track:
        """Return the track as it was before a step, at the points that it has had since."""
        names = ("axial", "lateral", "offsets", "sliding", "used", "held")
        old, new = vars(before), vars(self)
        restored = {name: np.concatenate([old[name], np.zeros_like(new[name][len(before) :])]) for name in names}
        for name in ("anchors", "moved"):  # of what was not there as it is now
            restored[name] = np.concatenate([old[name], new[name][len(before) :]])
        return self.changed(tip=before.tip, cut=before.cut, broken=before.broken, **restored)

    @cached_property
    def along(self) -> Array:
        """Length of the track at each point."""
        return self.apart * np.arange(len(self), dtype=float)

    @cached_property
    def end(self) -> Array:
        """Share (m,) of each point in the end of the cut, which lies between two of them."""
        return shaft.share_of_end(self.along, self.cut, self.apart)

    @cached_property
    def lengths(self) -> Array:
        """Length (m,) of the shaft that each point stands for: in the cut, and behind the tip."""
        return shaft.lengths(self.along, self.anchors, self.cut, self.apart)

    def forces(self, needle: Needle) -> Array:
        """Return the force (m, 3) at each point, in the world: friction, grip, and the tip's share."""
        forces: Array = (self.axial + self.tip * self.end)[:, None] * needle.direction + self.lateral
        return forces

    def compliance_along(self, axis: Array) -> Array:
        """Return the displacement (m, m) of points along an axis by forces along it."""
        m = len(self)
        result: Array = axis @ (self.compliance.reshape(-1, 3) @ axis).reshape(m, 3, m)
        return result

    def __repr__(self) -> str:
        force = (self.axial.sum() + self.tip) / 1e3
        return f"Track({len(self)} points, {self.cut:.4g} mm cut, {force:.3g} N)"
