"""Markdown tables for reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table of cells that are shown as ``str`` shows them."""
    lines = ["| " + " | ".join(map(str, cells)) + " |" for cells in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


def table_of(rows: Iterable[Mapping[str, Any]], head: str, line: str) -> str:
    """Return a Markdown table with a line for each row of named values.

    Parameters
    ----------
    rows : iterable of mapping
        Values by name.
    head, line : str
        Headings, and the format of a row, their cells parted by ``|``.

    Examples
    --------
    >>> from sonospline._markdown import table_of
    >>> print(table_of([{"n": 1000, "ms": 2.345}], "nodes | time", "{n:,} | {ms:.1f} ms"))
    | nodes | time |
    | --- | --- |
    | 1,000 | 2.3 ms |
    """
    return table(head.split(" | "), [[cell.format_map(row) for cell in line.split(" | ")] for row in rows])
