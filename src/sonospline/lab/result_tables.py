"""Attempts as tables that other programs read: CSV for people, Parquet for pandas, R and whoever has many."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

from .._extras import require
from ..training.metric import METRICS

COLUMNS = (
    "attempt", "participant", "group", "session", "exercise", "exercise_hash", "seed", "began", "ended", "passed",
    "seconds", "verdict", "recording", "recording_hash",
)  # fmt: skip
"""What is known of every attempt; a column for each of :data:`~sonospline.training.METRICS` follows."""
_WHOLE, _TIME, _FLAG, _REAL = ("attempt", "seed"), ("began",), ("passed",), ("seconds",)


def write_tables(attempts: Iterable[dict[str, Any]], folder: str | Path) -> tuple[str, ...]:
    """Write ``attempts.csv`` and ``attempts.parquet`` into a folder; return their names.

    Parameters
    ----------
    attempts : iterable of dict
        As :meth:`ResultStore.attempts` yields them.
    folder : str or Path
        Which is there.

    Raises
    ------
    OSError
        The disk is full or gone.
    MissingExtraError
        ``pip install 'sonospline[lab]'``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sonospline.lab import write_tables
    >>> write_tables([], pathlib.Path(tempfile.mkdtemp()))
    ('attempts.csv', 'attempts.parquet')
    """
    rows, folder = list(attempts), Path(folder)
    with (folder / "attempts.csv").open("w", newline="", encoding="utf-8") as stream:
        write_csv(rows, stream)
    _write_parquet(rows, folder / "attempts.parquet")
    return "attempts.csv", "attempts.parquet"


def write_csv(rows: Iterable[dict[str, Any]], stream: TextIO) -> None:
    """Write attempts as CSV into an open file."""
    writer = csv.writer(stream)
    writer.writerow((*COLUMNS, *METRICS))
    writer.writerows([_text(row.get(name)) for name in (*COLUMNS, *METRICS)] for row in rows)


def _text(value: Any) -> str:
    """As CSV holds it: numbers in full; texts that a spreadsheet would take for a formula are not."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value if value[:1] in ("=", "+", "-", "@") else value
    return value.isoformat(timespec="seconds") if hasattr(value, "isoformat") else repr(value)


def _write_parquet(rows: list[dict[str, Any]], path: Path) -> None:
    arrow, parquet = require("pyarrow"), require("pyarrow.parquet")
    kinds = (
        dict.fromkeys(_WHOLE, arrow.int64()) | dict.fromkeys(_TIME, arrow.timestamp("us", "UTC"))
        | dict.fromkeys(_FLAG, arrow.bool_()) | dict.fromkeys((*_REAL, *METRICS), arrow.float64())
    )  # fmt: skip
    form = arrow.schema([(name, kinds.get(name, arrow.string())) for name in (*COLUMNS, *METRICS)])
    columns = [[row.get(name) for row in rows] for name in form.names]
    parquet.write_table(
        arrow.table([arrow.array(column, kind) for column, kind in zip(columns, form.types, strict=True)], schema=form),
        path,
    )
