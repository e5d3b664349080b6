"""Poses of a needle and a probe over time as a CSV table: what a tracker, a robot or a spreadsheet hands over."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from .._shown import shown
from ..geometry.needle import Needle
from .tables import Row, read_rows
from .writing import write_text

Array = NDArray[np.float64]

_NEEDLE = tuple(f"{end}_{axis}" for end in ("entry", "tip") for axis in "xyz")
_PROBE = tuple(f"probe_{row}{column}" for row in range(3) for column in range(4))
COLUMNS = ("time_s", *_NEEDLE, *_PROBE)
"""Seconds; entry and tip of the needle, RAS mm, empty while it is out; the upper rows of ProbeToReference, empty where
it stays."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseRow:
    """Where needle and probe are at a moment.

    Parameters
    ----------
    time_s : float
        Seconds, from 0 on.
    needle : Needle, optional
        None while it is out.
    probe_to_reference : (4, 4) ndarray, optional
        None where it stays as it was.
    """

    time_s: float
    needle: Needle | None = None
    probe_to_reference: Array | None = None

    def __repr__(self) -> str:
        return f"PoseRow({self.time_s:g} s, {'no needle' if self.needle is None else f'{self.needle.depth:.4g} mm in'})"


def read_poses(path: str | PathLike[str]) -> list[PoseRow]:
    """Read a table of poses.

    Raises
    ------
    ValueError
        A column that is missing, a number that is none, times that go back, or a needle of which only one end is given:
        with the line.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sonospline.io.pose_table import PoseRow, read_poses, write_poses
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "hand.csv"
    >>> write_poses([PoseRow(0.0), PoseRow(0.5, Needle((50, 50, 0), (50, 50, 30)))], path)
    >>> read_poses(path)
    [PoseRow(0 s, no needle), PoseRow(0.5 s, 30 mm in)]
    """
    rows = [_pose_row(row, str(path)) for row in read_rows(path, "poses", COLUMNS)]
    if not rows:
        raise ValueError(f"poses = {str(path)!r} has no row; give one pose at least")
    for before, after in pairwise(rows):
        if after.time_s < before.time_s:
            raise ValueError(
                f"poses = {str(path)!r}: time_s = {after.time_s:g} comes after {before.time_s:g}; give rising times"
            )
    return rows


def write_poses(rows: Iterable[PoseRow], path: str | PathLike[str]) -> None:
    """Write a table of poses; reading it gives the same bits.

    Raises
    ------
    OSError
        It cannot be written whole; an earlier file stays.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(_cells(row) for row in rows)
    write_text(path, text.getvalue())


def _cells(row: PoseRow) -> list[str]:
    needle = [""] * 6 if row.needle is None else [repr(float(x)) for x in (*row.needle.entry, *row.needle.tip)]
    pose = row.probe_to_reference
    return [
        repr(float(row.time_s)), *needle,
        *([""] * 12 if pose is None else [repr(float(x)) for x in np.asarray(pose, float)[:3].ravel()]),
    ]  # fmt: skip


def _pose_row(row: Row, path: str) -> PoseRow:
    where = f"poses = {path!r}, line {row.line}"
    (time,) = _numbers(row, ("time_s",), where) or (None,)
    if time is None or time < 0:
        raise ValueError(f"{where}: time_s = {row.cells['time_s']!r} is no time; give seconds from 0 on")
    ends, pose = _numbers(row, _NEEDLE, where), _numbers(row, _PROBE, where)
    try:
        needle = None if ends is None else Needle(ends[:3], ends[3:])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return PoseRow(time, needle, None if pose is None else np.array([*pose, 0.0, 0.0, 0.0, 1.0]).reshape(4, 4))


def _numbers(row: Row, columns: tuple[str, ...], where: str) -> list[float] | None:
    """The values of some columns; None where all of them are empty."""
    cells = [row.cells[column].strip() for column in columns]
    if not any(cells):
        return None
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        bad = next(column for column, cell in zip(columns, cells, strict=True) if not _is_number(cell))
        raise ValueError(
            f"{where}: {bad} = {shown(row.cells[bad])} is no number; give one, or leave {columns[0]} to {columns[-1]} "
            "empty"
        ) from None
    if not np.isfinite(values).all():
        raise ValueError(f"{where}: {columns[0]} to {columns[-1]} are not finite; leave what is not known empty")
    return values


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
