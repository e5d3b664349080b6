"""Markups of 3D Slicer (``.mrk.json``): points with labels, lines, and what of them is an entry or a target."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .files import read_text
from .writing import write_json

Array = NDArray[np.float64]

SUFFIX = ".mrk.json"
_LPS_TO_RAS = np.array([-1.0, -1.0, 1.0])
_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_NUMBERED = re.compile(r"[-_ ]?\d+\Z")
_WANTED = "a markups file of 3D Slicer (.mrk.json)"
_ENDS = ("entry", "target")


@dataclass(frozen=True, eq=False, repr=False)
class Markup:
    """Points that were put down together.

    Parameters
    ----------
    kind : str
        ``Fiducial``, ``Line``, ``Curve``, ...
    labels : tuple of str
    points : (n, 3) ndarray
        RAS mm.
    """

    kind: str
    labels: tuple[str, ...]
    points: Array

    def __repr__(self) -> str:
        return f"Markup({self.kind}, {', '.join(self.labels[:6])})"


def read_markups(path: str | PathLike[str]) -> tuple[Markup, ...]:
    """Read a markups file; points that were not put down are left out.

    Raises
    ------
    ValueError
        No markups file, or one with coordinates that are none or in another unit than mm.
    """
    where = f"markups = {str(path)!r}"
    try:
        content = json.loads(read_text(path, "markups", _WANTED))
        found = tuple(_markup(markup) for markup in content["markups"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        problem = str(error) if isinstance(error, _MarkupError) else "is no markups file"
        raise ValueError(f"{where} {problem}; give {_WANTED}") from None
    return found


def write_markups(points: Mapping[str, ArrayLike], path: str | PathLike[str]) -> None:
    """Write points (RAS mm) by their labels as a list of fiducials.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sonospline.io.markups import place_of, read_markups, write_markups
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "plan.mrk.json"
    >>> write_markups({"entry": (1, 2, 3), "target": (4, 5, 6)}, path)
    >>> read_markups(path), place_of(path, "target").tolist()
    ((Markup(Fiducial, entry, target),), [4.0, 5.0, 6.0])
    """
    write_json(path, markups_content(points))


def markups_content(points: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Return what a markups file holds of points by their labels."""
    controls = [
        {
            "id": str(number), "label": label, "positionStatus": "defined",
            "position": (np.asarray(at, float) * _LPS_TO_RAS).tolist(), "selected": True, "visibility": True,
        }
        for number, (label, at) in enumerate(points.items(), 1)
    ]  # fmt: skip
    markup = {
        "type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": False,
        "lastUsedControlPointNumber": len(controls), "controlPoints": controls, "display": {"visibility": True},
    }  # fmt: skip
    return {"@schema": _SCHEMA, "markups": [markup]}


def place_of(path: str | PathLike[str], role: str) -> Array:
    """Return the ``entry`` or the ``target`` (3,) of a markups file.

    A point of that label, whatever its case and number (``Entry-1``); else the first or last point of its one line;
    else its one point.

    Raises
    ------
    ValueError
        None of these is there, or several.
    """
    markups = read_markups(path)
    pairs = [pair for markup in markups for pair in zip(markup.labels, markup.points, strict=True)]
    called = [at for label, at in pairs if _NUMBERED.sub("", label).lower() == role]
    lines = [markup for markup in markups if markup.kind == "Line" and len(markup.points) == 2]
    if len(called) == 1:
        return called[0]
    if not called and len(lines) == 1:
        place: Array = lines[0].points[_ENDS.index(role)]
        return place
    if not called and len(pairs) == 1:
        return pairs[0][1]
    raise ValueError(
        f"markups = {str(path)!r} has {len(called)} points called {role!r} among {len(pairs)}; label one {role}, "
        "or draw a line"
    )


class _MarkupError(ValueError):
    """What is wrong with one markup."""


def _markup(content: Any) -> Markup:
    unit, system = content.get("coordinateUnits", "mm"), content.get("coordinateSystem", "LPS")
    if unit not in ("mm", ["mm"]) and unit != ["mm", "UCUM", "millimeter"]:
        raise _MarkupError(f"has coordinates in {str(unit)[:20]!r}")
    if system not in ("LPS", "RAS"):
        raise _MarkupError(f"has coordinates in {str(system)[:20]!r}")
    controls = [point for point in content["controlPoints"] if point.get("positionStatus", "defined") == "defined"]
    points = np.array([point["position"] for point in controls], float).reshape(-1, 3)
    if len(points) != len(controls) or not np.isfinite(points).all():
        raise _MarkupError("has a position that is not three numbers")
    flip = _LPS_TO_RAS if system == "LPS" else np.ones(3)
    return Markup(str(content.get("type", "Fiducial")), tuple(str(p.get("label", "")) for p in controls), points * flip)
