"""Tables of labels as CSV, however a spreadsheet wrote them."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from os import PathLike

from .files import read_text

_MOST_ROWS = 100_000
_DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True)
class Row:
    """One line of a table: its number in the file and its cells by column."""

    line: int
    cells: dict[str, str]


def read_rows(path: str | PathLike[str], name: str, columns: tuple[str, ...], *, headless: bool = False) -> list[Row]:
    """Return the rows of a CSV file.

    Parameters
    ----------
    path : path-like
        Separated by comma, semicolon or tab; UTF-8 (with or without a byte order mark) or UTF-16.
    name : str
        The argument, as an error names it.
    columns : tuple of str
        Columns it must have; case and blanks around a heading do not matter, nor do further columns.
    headless : bool, default: False
        Whether a file that starts with a number has no headings, its columns in the order of ``columns``.

    Raises
    ------
    ValueError
        A file that cannot be read, a column that is missing or there twice, or a row that is too short.
    """
    wanted = f"a CSV file with columns {','.join(columns)}"
    lines = _lines(read_text(path, name, wanted), path, name, wanted)
    if not lines:
        raise ValueError(f"{name} = {str(path)!r} is empty; give {wanted}")
    if len(lines) > _MOST_ROWS:
        raise ValueError(f"{name} = {str(path)!r} has {len(lines):,} lines; give at most {_MOST_ROWS:,}")
    first = [cell.lower() for cell in lines[0][1]]
    if headless and re.fullmatch(r"[+-]?\d+(\.0*)?", first[0]):
        headings = [*columns, *("",) * (len(first) - len(columns))]
    else:
        headings, lines = first, lines[1:]
    for column in columns:
        if headings.count(column) != 1:
            many = "lacks" if column not in headings else "has twice"
            raise ValueError(f"{name} = {str(path)!r} {many} the column {column!r}; give {wanted}")
    places = {heading: place for place, heading in enumerate(headings) if heading}
    rows = []
    for number, cells in lines:
        if len(cells) <= max(places[column] for column in columns):
            raise ValueError(f"{name} = {str(path)!r}, line {number}: {len(cells)} cells are too few; give {wanted}")
        rows.append(Row(number, {heading: cells[place] for heading, place in places.items() if place < len(cells)}))
    return rows


def read_by_label(
    path: str | PathLike[str], name: str, columns: tuple[str, ...], *, headless: bool = False
) -> dict[int, Row]:
    """Return the rows of a CSV file by the number in their column ``label``.

    Raises
    ------
    ValueError
        As :func:`read_rows`; a label that is not a whole number at or above zero, or is there twice.
    """
    table: dict[int, Row] = {}
    for row in read_rows(path, name, ("label", *columns), headless=headless):
        cell = row.cells["label"]
        if not re.fullmatch(r"\+?\d{1,18}(\.0*)?", cell):
            raise ValueError(
                f"{name} = {str(path)!r}, line {row.line}: label {cell!r} is not a whole number; give 0 or more"
            )
        label = int(cell.partition(".")[0])
        if label in table:
            raise ValueError(
                f"{name} = {str(path)!r} has label {label} twice, in lines {table[label].line} and {row.line}; "
                "keep one of them"
            )
        table[label] = row
    return table


def read_names(path: str | PathLike[str], name: str = "names") -> dict[int, str]:
    """Read the names of labels from a CSV file.

    Parameters
    ----------
    path : path-like
        Columns ``label`` and ``name``, or no headings and these two first.
    name : str, default: "names"
        The argument, as an error names it.

    Raises
    ------
    ValueError
        A file that cannot be read, a label that is no whole number or is there twice, or an empty name.
    """
    rows = read_by_label(path, name, ("name",), headless=True)
    for label, row in rows.items():
        if not row.cells["name"]:
            raise ValueError(f"{name} = {str(path)!r}, line {row.line}: label {label} has an empty name; give one")
    return {label: row.cells["name"] for label, row in rows.items()}


def _lines(text: str, path: str | PathLike[str], name: str, wanted: str) -> list[tuple[int, list[str]]]:
    """Lines that are not blank: number in the file, and cells without blanks around them."""
    heading = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(_DELIMITERS, key=heading.count)
    reader = csv.reader(text.splitlines(keepends=True), delimiter=delimiter, skipinitialspace=True)
    try:
        return [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if any(map(str.strip, cells))]
    except csv.Error as error:
        raise ValueError(f"{name} = {str(path)!r}, line {reader.line_num}: {error}; give {wanted}") from None
