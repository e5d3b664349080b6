"""What a tissue model knows of a needle at one moment: all that the force in the hand needs until the next one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .._shown import shown

Array = NDArray[np.float64]

_NOWHERE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrozenContact(ByBits):
    """A needle in tissue that stands still: m points along it, how they give way, and what holds them.

    Point i is to move as the needle does, but for its anchor; how far tissue moves there follows from the forces:
    ``displacement_mm + compliance_mm_n @ (forces - forces_n)``. Forces act on the tissue, along the needle.

    Parameters
    ----------
    compliance_mm_n : (m, m) array_like
        Displacement of a point along the needle for a force along it, mm/N; symmetric, with no diagonal at or below 0.
    places_mm : (m,) array_like
        Where the points lie in undeformed tissue, along the needle from its tip on: behind the tip is below zero, mm.
    displacement_mm, forces_n, anchors_mm : (m,) array_like
        At this moment: displacement along the needle, mm; forces, N; and the distance behind the tip, mm, of the place
        on the needle that a point sticks to.
    low_n, high_n : (m,) array_like
        Bounds of the forces: friction's, and 0 and the cutting or rupture force at the tip.
    tip : int or None
        Which point is the end of the cut track, which the tip pushes and never pulls.
    axis : (3,) array_like
        Direction of the needle, from hub to tip.
    tip_mm : (3,) array_like
        Where the tip is.
    lateral_n_mm : float, default: 0.0
        Force on the hand, back to the needle's axis, for each mm that it is aside of it.
    lateral_n : (3,) array_like, default: none
        Force on the hand across the needle at this moment.

    Raises
    ------
    ValueError
        Numbers that are not finite or do not fit together, a bound on the wrong side of zero, a compliance that is not
        symmetric or has no diagonal above zero.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.contact import FrozenContact
    >>> apart = np.subtract.outer(np.arange(5), np.arange(5))
    >>> FrozenContact.at_rest(places_mm=2.0 * np.arange(-4, 1), compliance_mm_n=3 / np.hypot(1, apart), friction_n=0.05,
    ...                       cutting_n=0.7, axis=(0, 0, 1), tip_mm=(0, 0, 40))
    FrozenContact(5 points, tip at (0, 0, 40), 0 N along (0, 0, 1))
    """

    compliance_mm_n: Array
    places_mm: Array
    displacement_mm: Array
    forces_n: Array
    anchors_mm: Array
    low_n: Array
    high_n: Array
    tip: int | None
    axis: Array
    tip_mm: Array
    lateral_n_mm: float = 0.0
    lateral_n: Array = _NOWHERE  # type: ignore[assignment]

    def __post_init__(self) -> None:
        count = np.size(self.places_mm)
        if not 1 <= count <= 1000:
            raise ValueError(f"places_mm has {count} points; give 1 to 1000 along the needle")
        for name in ("places_mm", "displacement_mm", "forces_n", "anchors_mm", "low_n", "high_n"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name), (count,)))
        object.__setattr__(self, "compliance_mm_n", _numbers("compliance_mm_n", self.compliance_mm_n, (count, count)))
        for name in ("tip_mm", "lateral_n"):
            object.__setattr__(self, name, _validate.vector(name, getattr(self, name)))
        object.__setattr__(self, "axis", _unit(_validate.vector("axis", self.axis)))
        object.__setattr__(self, "lateral_n_mm", _validate.number("lateral_n_mm", self.lateral_n_mm))
        if self.tip is not None:
            _validate.count("tip", self.tip, least=0, most=count - 1)
        self._check()

    @classmethod
    def at_rest(
        cls, *, places_mm: ArrayLike, compliance_mm_n: ArrayLike, friction_n: ArrayLike, cutting_n: float,
        axis: ArrayLike, tip_mm: ArrayLike, lateral_n_mm: float = 0.0,
    ) -> FrozenContact:  # fmt: skip
        """Return a needle that tissue has closed on without being moved; the last place is the tip's.

        Parameters
        ----------
        places_mm, compliance_mm_n, axis, tip_mm, lateral_n_mm
            As above.
        friction_n : float or (m,) array_like
            Most force by friction at a point, N; the tip has none.
        cutting_n : float
            Most force of the tip, N.
        """
        places = _numbers("places_mm", places_mm, (np.size(places_mm),))
        high = np.broadcast_to(_numbers("friction_n", friction_n, np.shape(friction_n)), places.shape).copy()
        low = -high
        low[-1:], high[-1:] = 0.0, _validate.number("cutting_n", cutting_n)
        still = np.zeros_like(places)
        return cls(
            compliance_mm_n=np.asarray(compliance_mm_n, float), places_mm=places, displacement_mm=still, forces_n=still,
            anchors_mm=-places, low_n=low, high_n=high, tip=len(places) - 1, axis=np.asarray(axis, float),
            tip_mm=np.asarray(tip_mm, float), lateral_n_mm=lateral_n_mm,
        )  # fmt: skip

    @property
    def axial_n(self) -> float:
        """Force on the tissue along the needle at this moment, N."""
        return float(self.forces_n.sum())

    def for_core(self) -> dict[str, Any]:
        """Return it in the names of the core."""
        return {
            "compliance": self.compliance_mm_n, "places": self.places_mm, "displacement": self.displacement_mm,
            "forces": self.forces_n, "anchors": self.anchors_mm, "low": self.low_n, "high": self.high_n,
            "tip": -1 if self.tip is None else self.tip, "axis": self.axis, "origin": self.tip_mm,
            "lateral_stiffness": self.lateral_n_mm, "lateral_force": self.lateral_n,
        }  # fmt: skip

    def _check(self) -> None:
        compliance = self.compliance_mm_n
        if not (compliance.diagonal() > 0).all():
            least = float(compliance.diagonal().min())
            raise ValueError(f"compliance_mm_n has {least:g} in its diagonal; tissue gives way: give numbers above 0")
        if not np.allclose(compliance, compliance.T, rtol=0.02, atol=0.02 * float(compliance.diagonal().max())):
            raise ValueError("compliance_mm_n is not symmetric; weigh displacements as the forces are spread")
        for name, wrong in (("low_n", self.low_n > 0), ("high_n", self.high_n < 0)):
            if wrong.any():
                value, side = float(getattr(self, name)[wrong][0]), "below" if name == "low_n" else "above"
                raise ValueError(f"{name} = {value:g} holds on to no force of zero; give 0 or a number {side} it")

    def __repr__(self) -> str:
        tip, axis = (f"({', '.join(f'{x:.4g}' for x in v)})" for v in (self.tip_mm, self.axis))
        return f"FrozenContact({len(self.places_mm)} points, tip at {tip}, {self.axial_n:.4g} N along {axis})"


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape, read-only."""
    try:
        array = np.array(value, float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} = {shown(value)} is not numeric; give numbers") from None
    if array.shape != shape:
        wanted = " x ".join(map(str, shape)) or "one number"
        raise ValueError(f"{name} has shape {array.shape}; give {wanted}, as many as places_mm has points")
    if not (np.abs(array) < 1e9).all():
        raise ValueError(f"{name} contains NaN, infinity or a number beyond 1e9; give numbers in mm and N")
    array.setflags(write=False)
    return array


def _unit(axis: Array) -> Array:
    length = float(np.linalg.norm(axis))
    if not 0 < length < 1e9:
        raise ValueError(f"axis = {shown(axis.tolist())} has no direction; give one from hub to tip")
    unit: Array = axis / length
    unit.setflags(write=False)
    return unit
