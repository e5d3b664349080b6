"""Measured curves: the force of a needle that is pushed in, against its depth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import _validate
from ..._by_bits import ByBits
from ..._shown import shown
from ...io.tables import Row, read_rows
from ...mechanics.material_table import BACKGROUND

Array = NDArray[np.float64]

FEWEST = 20
"""Samples of a curve."""
_BELOW = 0.05
"""Of the largest force: what noise about zero may be below it."""


@dataclass(frozen=True, eq=False, repr=False)
class ForceCurve(ByBits):
    """Force of a needle against its depth, pushed in at one speed.

    Parameters
    ----------
    depths_mm : (n,) array_like
        Of the tip from where it first touches, at or above zero and growing.
    force_n : (n,) array_like
        Along the needle, positive where it resists.
    tissues : sequence of (str, float), optional
        Name and beginning of each tissue on the way, before any has moved, in mm; by default one.
    speed_mm_s : float, optional
        Of the needle.
    name : str, default: "curve"
        As messages have it.

    Raises
    ------
    ValueError
        Fewer than 20 samples, NaN, depths that do not grow, forces that pull, or tissues that do not follow each other.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.contact.calibration import ForceCurve
    >>> depths = np.linspace(0, 50, 101)
    >>> ForceCurve(depths, 0.5 + 0.03 * depths, speed_mm_s=5)
    ForceCurve('curve', 101 samples to 50 mm, 1 tissue, 5 mm/s)
    """

    depths_mm: Array
    force_n: Array
    tissues: tuple[tuple[str, float], ...] = ((BACKGROUND, 0.0),)
    speed_mm_s: float | None = None
    name: str = "curve"

    def __init__(
        self,
        depths_mm: ArrayLike,
        force_n: ArrayLike,
        tissues: tuple[tuple[str, float], ...] = ((BACKGROUND, 0.0),),
        speed_mm_s: float | None = None,
        name: str = "curve",
    ) -> None:
        depths, force = _numbers(name, "depth_mm", depths_mm), _numbers(name, "force_n", force_n)
        if len(depths) != len(force):
            raise ValueError(f"{name}: {len(depths)} depths and {len(force)} forces; give one force for each depth")
        if len(depths) < FEWEST:
            raise ValueError(f"{name}: {len(depths)} samples are too few; give at least {FEWEST}")
        if depths[0] < 0:
            raise ValueError(
                f"{name}: depth_mm = {depths[0]:g} is out of range; count from where the tip first touches"
            )
        if (stays := np.flatnonzero(np.diff(depths) <= 0)).size:
            first, then = depths[stays[0] : stays[0] + 2]
            raise ValueError(
                f"{name}: depth_mm goes from {first:g} to {then:g}; give the part in which the needle is pushed in"
            )
        if force.min() < -_BELOW * max(force.max(), 0.0) or force.max() <= 0:
            raise ValueError(f"{name}: force_n = {force.min():g} pulls; give what resists as positive, tared to zero")
        for field, value in {"depths_mm": depths, "force_n": force, "name": name}.items():
            object.__setattr__(self, field, value)
        object.__setattr__(self, "tissues", _following(name, tissues, float(depths[-1])))
        speed = None if speed_mm_s is None else _validate.number(f"{name}: speed_mm_s", speed_mm_s, positive=True)
        object.__setattr__(self, "speed_mm_s", speed)

    @property
    def noise_n(self) -> float:
        """Standard deviation of what changes from sample to sample, whatever the curve does."""
        turns = np.diff(self.force_n, 2)
        return float(1.4826 * np.median(np.abs(turns - np.median(turns))) / np.sqrt(6))

    @classmethod
    def read(cls, path: str | PathLike[str]) -> ForceCurve:
        """Read a CSV file with the columns ``depth_mm`` and ``force_n``.

        Further columns may be ``tissue``, what is at that depth before any tissue has moved, and ``speed_mm_s`` or
        ``time_s``.

        Raises
        ------
        ValueError
            A file that cannot be read, a cell that is no number, or as the class.
        """
        name = Path(path).name
        rows = read_rows(path, "curve", ("depth_mm", "force_n"))
        depths, forces = (np.array([_cell(name, row, column) for row in rows]) for column in ("depth_mm", "force_n"))
        tissues: list[tuple[str, float]] = []
        for row, depth in zip(rows, depths, strict=True):
            tissue = row.cells.get("tissue", BACKGROUND)
            if not tissues or tissue != tissues[-1][0]:
                tissues.append((tissue, float(depth) if tissues else 0.0))
        return cls(depths, forces, tuple(tissues), _speed(name, rows, depths), name)

    def __repr__(self) -> str:
        tissues = f"{len(self.tissues)} tissue{'s' * (len(self.tissues) > 1)}"
        speed = "" if self.speed_mm_s is None else f", {self.speed_mm_s:.3g} mm/s"
        return (
            f"ForceCurve({self.name!r}, {len(self.depths_mm)} samples to {self.depths_mm[-1]:g} mm, {tissues}{speed})"
        )


def _numbers(name: str, column: str, values: ArrayLike) -> Array:
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {column} = {shown(values)} is not numeric; give numbers") from None
    if array.ndim != 1:
        raise ValueError(f"{name}: {column} has shape {array.shape}; give one number a sample")
    if (bad := np.flatnonzero(~np.isfinite(array))).size:
        raise ValueError(f"{name}: {column} = {array[bad[0]]} at sample {bad[0]} is not finite; leave the sample out")
    array.setflags(write=False)
    return array


def _following(name: str, tissues: tuple[tuple[str, float], ...], end: float) -> tuple[tuple[str, float], ...]:
    found = tuple((_validate.text("tissue", tissue), _validate.number(f"{name}: begin", at)) for tissue, at in tissues)
    begins = [at for _, at in found]
    if not begins or begins[0] != 0 or any(b <= a for a, b in pairwise(begins)):
        raise ValueError(
            f"{name}: tissues begin at {begins}; let the first begin at 0 and each farther than the one before"
        )
    if begins[-1] >= end:
        raise ValueError(
            f"{name}: {found[-1][0]} begins at {begins[-1]:g} mm, and the curve ends at {end:g}; leave it out"
        )
    return found


def _cell(name: str, row: Row, column: str) -> float:
    try:
        return float(row.cells[column])
    except ValueError:
        text = shown(row.cells[column])
        raise ValueError(f"{name}, line {row.line}: {column} = {text} is not a number; give one") from None


def _speed(name: str, rows: list[Row], depths: Array) -> float | None:
    if all("speed_mm_s" in row.cells for row in rows):
        return float(np.mean([_cell(name, row, "speed_mm_s") for row in rows]))
    if all("time_s" in row.cells for row in rows):
        times = np.array([_cell(name, row, "time_s") for row in rows])
        if not np.isfinite(times).all() or times[-1] <= times[0]:
            raise ValueError(f"{name}: time_s goes from {times[0]:g} to {times[-1]:g}; give seconds that grow")
        return float((depths[-1] - depths[0]) / (times[-1] - times[0]))
    return None
