"""The table of a data set: a row for each sample, as Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

from .._extras import require

_WHOLE = ("index", "anatomy", "view", "needle_px")
_TEXT = ("split", "failed", "source", "target", "recipe")
_REAL = (
    "depth_mm", "tip_off_plane_mm", "force_axial_n", "error_estimate", "largest_mm", "pixel_mm", "frequency_mhz",
    "image_depth_mm", "gain_db", "noise_db",
)  # fmt: skip
_LISTS = {
    "target_mm": 3, "target_now_mm": 3, "entry_mm": 3, "tip_mm": 3, "tip_px": 2, "target_px": 2, "force_n": 3,
    "image_to_reference": 16,
}  # fmt: skip
COLUMNS = (
    "index", "split", "failed", "source", "anatomy", "view", "target", "target_mm", "target_now_mm", "entry_mm",
    "tip_mm", "depth_mm", "tip_px", "target_px", "tip_off_plane_mm", "needle_px", "force_axial_n", "force_n",
    "error_estimate", "largest_mm", "image_to_reference", "pixel_mm", "frequency_mhz", "image_depth_mm", "gain_db",
    "noise_db", "events", "recipe",
)  # fmt: skip
RECIPE_COLUMNS = ("index", "split", "failed", "recipe")
"""Of a data set of recipes."""
NUMBERS = (*_REAL, "needle_px")
"""Columns that statistics are of."""


def is_whole(name: str) -> bool:
    """Whether a column holds whole numbers."""
    return name in _WHOLE


def is_real(name: str) -> bool:
    """Whether a column holds real numbers, alone or in lists."""
    return name in _REAL or name in _LISTS


def is_list(name: str) -> bool:
    """Whether a column holds lists."""
    return name in _LISTS or name == "events"


def parquet(rows: Iterable[Mapping[str, Any]], columns: Sequence[str] = COLUMNS) -> bytes:
    """Return rows as a Parquet file; equal rows, equal bytes."""
    arrow, file_format = require("pyarrow"), require("pyarrow.parquet")
    rows = list(rows)
    held = [arrow.array([row.get(name) for row in rows], _kind(name)) for name in columns]
    stream = io.BytesIO()
    file_format.write_table(arrow.table(held, names=list(columns)), stream, compression="zstd")
    return stream.getvalue()


def read_rows(content: bytes, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Return the rows of a Parquet file.

    Raises
    ------
    ValueError
        It is none.
    """
    arrow, file_format = require("pyarrow"), require("pyarrow.parquet")
    try:
        found: list[dict[str, Any]] = file_format.read_table(io.BytesIO(content), columns=columns).to_pylist()
    except arrow.ArrowException as error:
        raise ValueError(f"table cannot be read ({str(error).splitlines()[0]}); make the data set again") from None
    return found


@cache
def _kind(name: str) -> Any:
    arrow = require("pyarrow")
    if name in _WHOLE:
        return arrow.int64()
    if name in _TEXT:
        return arrow.string()
    if name in _REAL:
        return arrow.float64()
    if name == "events":
        return arrow.list_(arrow.string())
    return arrow.list_(arrow.float64(), _LISTS[name])
