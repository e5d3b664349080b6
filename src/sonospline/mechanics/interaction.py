"""What the needle does to the tissue around it: equations (14) to (21) and Table I."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..geometry.needle import Needle, Projection

Array = NDArray[np.float64]

TABLE_I_SPACING = 1 / 24
"""k of the 25-node mesh Table I was tuned on: the unit of its tip lengths."""

AMPLITUDES = ("shaft_displacement", "shaft_pull", "tip_displacement")
"""Parameters that may be zero: the others divide."""

_TIE = 1e-9
"""Points this near to being level with the entry or the tip, in needle lengths, count as level."""


@dataclass(frozen=True, kw_only=True)
class NeedleTissueModel:
    """The parameters of Table I: how far the needle drags and pushes nearby tissue.

    All are lengths in the unit of the grid (mm in the world, cube sides in the paper).
    Displacements are totals reached by a point, not increments a step, except with
    ``Insertion(accumulation="incremental")``.

    Parameters
    ----------
    shaft_displacement : float
        f_max, eq. (14): axial drag of tissue at the shaft. At or above zero.
    shaft_pull : float
        gamma_max, eq. (16): pull towards the shaft. At or above zero.
    shaft_radius : float
        delta, eqs (14) and (16): distance beyond which the shaft has no effect. Above zero.
    shaft_decay : float
        sigma_s, eq. (14): radial decay of the drag. Above zero.
    pull_decay : float
        sigma_c, eq. (16): radial decay of the pull. Above zero.
    tip_displacement : float
        sigma_tip, eq. (21): push ahead of the tip. At or above zero.
    tip_radius : float
        r_tip, eq. (20): radius of the cylinder ahead of the tip. Above zero.
    tip_length : float
        l_tip, eq. (19): length of the cylinder ahead of the tip. Above zero.

    Raises
    ------
    ValueError
        A parameter out of range, NaN or infinite.

    Examples
    --------
    >>> import sonospline as ss
    >>> ss.NeedleTissueModel.paper().shaft_displacement
    0.0227
    >>> round(ss.NeedleTissueModel.paper(side=100).tip_length, 3)   # mm, in a 100 mm cube
    8.986
    """

    shaft_displacement: float
    shaft_pull: float
    shaft_radius: float
    shaft_decay: float
    pull_decay: float
    tip_displacement: float
    tip_radius: float
    tip_length: float

    def __repr__(self) -> str:
        return f"NeedleTissueModel({', '.join(f'{name}={value:.4g}' for name, value in vars(self).items())})"

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            checked = _validate.number(field.name, value, positive=field.name not in AMPLITUDES)
            object.__setattr__(self, field.name, checked)

    @classmethod
    def paper(cls, side: float = 1.0) -> NeedleTissueModel:
        """Return Table I for a cube of the given side.

        The table's sigma_c = 0.3873 = 3 sigma_s is the truncation radius delta; sigma_c
        itself, unpublished, equals sigma_s here. r_tip and l_tip are in spacings of the
        25-node tuning mesh; everything else is in cube sides.
        """
        unit = cls(
            shaft_displacement=0.0227,
            shaft_pull=0.0041,
            shaft_radius=0.3873,
            shaft_decay=0.1291,
            pull_decay=0.1291,
            tip_displacement=0.0266,
            tip_radius=1.3185 * TABLE_I_SPACING,
            tip_length=2.1566 * TABLE_I_SPACING,
        )
        return unit.scaled(side)

    @classmethod
    def paper_incremental(cls, side: float = 1.0) -> NeedleTissueModel:
        """Return the rival reading of Table I, for ``accumulation="incremental"``.

        Displacements are increments a step in spacings of the tuning mesh, composed on
        the moving mesh as Algorithm 1, line 10, is written.
        """
        total = cls.paper(side)
        return replace(
            total,
            shaft_displacement=total.shaft_displacement * TABLE_I_SPACING,
            shaft_pull=total.shaft_pull * TABLE_I_SPACING,
            tip_displacement=total.tip_displacement * TABLE_I_SPACING,
        )

    @classmethod
    def tuned(cls, side: float = 1.0) -> NeedleTissueModel:
        """Return the parameters tuned to our own finite elements, for a cube of the given side.

        Found by ``sonospline tune --seed 0`` (three insertions at 25^3, half and full depth,
        1,600 evaluations) for the load ``LineForce()`` in ``Material()``, and rounded. On the
        eight held-out insertions the mean error is 1.1e-3 sides, 0.37 of the mean
        displacement; with Table I it is 1.6e-3 and 0.51. Displacements are proportional to
        load over stiffness: tune anew for others.
        """
        unit = cls(
            shaft_displacement=0.01996,
            shaft_pull=0.007835,
            shaft_radius=0.456,
            shaft_decay=0.152,
            pull_decay=0.02828,
            tip_displacement=0.02654,
            tip_radius=0.04186,
            tip_length=0.01073,
        )
        return unit.scaled(side)

    def scaled(self, side: float) -> NeedleTissueModel:
        """Return the model with every length multiplied by ``side``."""
        side = _validate.number("side", side, positive=True)
        return NeedleTissueModel(**{f.name: getattr(self, f.name) * side for f in fields(self)})


def shaft_displacement(points: Array, needle: Needle, model: NeedleTissueModel) -> Array:
    """Return the displacement (m, 3) of points (m, 3) by friction along the shaft, eqs (14) to (18).

    Acts for 0 <= tau <= inserted length and d <= delta. The inward pull never crosses
    the axis: its magnitude is at most d.
    """
    seen = needle.project(points)
    beside = _beside_shaft(seen, model, needle.depth)
    return np.where(beside[:, None], _drag_and_pull(points, seen, needle, model), 0.0)


def tip_displacement(points: Array, needle: Needle, model: NeedleTissueModel) -> Array:
    """Return the displacement (m, 3) of points (m, 3) ahead of the tip, eqs (19) to (21)."""
    seen = needle.project(points)
    slack = _TIE * needle.depth
    ahead = seen.along - needle.depth
    pushed = (ahead > slack) & (ahead <= model.tip_length + slack) & (seen.distance <= model.tip_radius)
    return np.where(pushed[:, None], model.tip_displacement * needle.direction, 0.0)


def interaction(points: Array, needle: Needle, model: NeedleTissueModel) -> Array:
    """Return the displacement (m, 3) at this moment: shaft and tip superposed (Sec. III)."""
    return shaft_displacement(points, needle, model) + tip_displacement(points, needle, model)


def accumulated(points: Array, needle: Needle, model: NeedleTissueModel) -> Array:
    """Return the displacement (m, 3) accumulated while the needle came to its depth.

    For each point the largest :func:`interaction` over all depths from zero to the
    present one: it saturates and never adds up (Sec. V: from the undeformed reference to
    the accumulated target). In closed form, so it depends on the pose alone, not on the
    number of steps, and a needle pulled back to a depth gives that depth's field again.
    """
    return History.of(points, needle, model).at(needle.depth)


@dataclass(frozen=True, eq=False)
class History:
    """What points go through as a needle advances along one axis, at every depth at once.

    A point in the way of the tip is pushed when the tip comes near; when the tip has
    passed, the shaft drags it, and the stronger of the two counts.
    """

    along: Array
    """(m,) tau of each point."""
    wakes: Array
    """(m,) depth from which each is displaced; infinity where it never is."""
    pushed: Array
    """(m, 3) displacement from that depth on, until the tip passes."""
    passed: Array
    """(m, 3) displacement once the tip has passed."""

    @classmethod
    def of(cls, points: Array, needle: Needle, model: NeedleTissueModel) -> History:
        """Return the history of points (m, 3) along a needle's axis."""
        seen = needle.project(points)
        in_path = (seen.along > 0) & (seen.distance <= model.tip_radius)
        beside = _beside_shaft(seen, model, np.inf)
        pushed = np.where(in_path[:, None], model.tip_displacement * needle.direction, 0.0)
        dragged = np.where(beside[:, None], _drag_and_pull(points, seen, needle, model), 0.0)
        tip_is_stronger = np.linalg.norm(pushed, axis=1) > np.linalg.norm(dragged, axis=1)
        by_shaft = np.where(beside, np.maximum(seen.along, 0.0), np.inf)
        by_tip = np.where(in_path, np.maximum(seen.along - model.tip_length, 0.0), np.inf)
        return cls(
            seen.along,
            np.minimum(by_shaft, by_tip),
            pushed,
            np.where(tip_is_stronger[:, None], pushed, dragged),
        )

    def select(self, chosen: NDArray[np.int64]) -> History:
        """Return the history of some of the points, by number."""
        return History(self.along[chosen], self.wakes[chosen], self.pushed[chosen], self.passed[chosen])

    def awake(self, depth: float) -> int:
        """Return how many points are displaced at a depth, where they are sorted by ``wakes``."""
        return int(np.searchsorted(self.wakes, depth * (1 + _TIE), side="right"))

    def at(self, depth: float, count: int | None = None) -> Array:
        """Return the displacement at a depth of the first ``count`` points (all by default)."""
        first = slice(count)
        reached = depth * (1 + _TIE)
        displaced = np.where((self.along[first] <= reached)[:, None], self.passed[first], self.pushed[first])
        return np.where((self.wakes[first] <= reached)[:, None], displaced, 0.0)

    def __repr__(self) -> str:
        return f"History({len(self.along)} points)"


def _beside_shaft(seen: Projection, model: NeedleTissueModel, depth: float) -> NDArray[np.bool_]:
    """Points the shaft acts on; those level with its ends count, whatever the rounding."""
    slack = _TIE * max(model.shaft_radius, 0.0 if np.isinf(depth) else depth)
    return (seen.along >= -slack) & (seen.along <= depth + slack) & (seen.distance <= model.shaft_radius)


def _drag_and_pull(points: Array, seen: Projection, needle: Needle, model: NeedleTissueModel) -> Array:
    drag = model.shaft_displacement * np.exp(-(seen.distance**2) / (2 * model.shaft_decay**2))  # (14)
    pull = model.shaft_pull * np.exp(-(seen.distance**2) / (2 * model.pull_decay**2))  # (16)
    pull = np.minimum(pull, seen.distance)
    return drag[:, None] * needle.direction + pull[:, None] * _inward(points, seen)  # (17)


def _inward(points: Array, seen: Projection) -> Array:
    """Unit vectors (m, 3) towards the axis, eq. (15); zero on the axis itself."""
    outward = points - seen.foot
    on_axis = seen.distance == 0
    return -outward / np.where(on_axis, 1.0, seen.distance)[:, None]
