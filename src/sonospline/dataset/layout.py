"""Where everything of a data set lies, and what its arrays are: the one place that names files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .sample import HUNDREDTH_MM
from .specification import Specification
from .store import Store

MANIFEST, PLAN, CARD, CROISSANT = "manifest.json", "plan.json", "README.md", "croissant.json"
FORMAT, FORMAT_VERSION = "sonospline data set", 1
ARRAYS, TABLE, RECEIPTS, SHARDS, PICTURES = "arrays", "table", "receipts", "shards", "pictures"


def read_described(place: Store, name: str, otherwise: str) -> dict[str, Any]:
    """Return what the plan or the manifest of a data set holds.

    Parameters
    ----------
    place : Store
        Where the data set is.
    name : {PLAN, MANIFEST}
        Which.
    otherwise : str
        What to say of a place that has none.

    Raises
    ------
    ValueError
        There is none, or it is of a later version.
    """
    try:
        found: dict[str, Any] = json.loads(place.read(name))
        version = found["format_version"] if found["format"] == FORMAT else None
        later = None if version is None else version > FORMAT_VERSION
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        later = None
    if later is None:
        raise ValueError(f"{place.address!r} {otherwise}")
    if later:
        raise ValueError(f"{place.address!r} is of a later version; read it with a later Sonospline")
    return found


def receipt_name(shard: int) -> str:
    """Return the file that says a shard is whole."""
    return f"{RECEIPTS}/{shard:06d}.json"


def table_name(shard: int) -> str:
    """Return the file of a shard's rows."""
    return f"{TABLE}/part-{shard:06d}.parquet"


def tar_name(shard: int) -> str:
    """Return the WebDataset file of a shard."""
    return f"{SHARDS}/{shard:06d}.tar"


@dataclass(frozen=True)
class ArrayForm:
    """One array of a data set, a sample along its first axis."""

    shape: tuple[int, ...]
    dtype: str
    axes: tuple[str, ...]
    about: str
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def empty(self, samples: int) -> NDArray[Any]:
        """Return so many samples of nothing."""
        return np.full((samples, *self.shape), self.fill, self.dtype)

    @property
    def fill(self) -> int:
        """What a sample that failed holds."""
        return int(self.attributes.get("_FillValue", 0))


def array_forms(asked: Specification, beams: tuple[int, int] | None = None) -> dict[str, ArrayForm]:
    """Return the arrays that a specification keeps, by name.

    Parameters
    ----------
    asked : Specification
        What is asked for.
    beams : (int, int), optional
        Lines and samples of the echoes, where those are kept.
    """
    stored = asked.stored
    pixels, coarse = (stored.pixels, stored.pixels), (stored.pixels // stored.stride,) * 2
    mm = {"scale_factor": HUNDREDTH_MM, "_FillValue": -32768, "units": "mm"}
    found: dict[str, ArrayForm] = {}
    if stored.image:
        found["image"] = ArrayForm(pixels, "uint8", ("row", "column"), "B-mode, grey levels; 0 outside the fan")
    if stored.labels:
        found["labels"] = ArrayForm(pixels, "uint8", ("row", "column"), "tissue at each pixel now; 0 outside the fan")
    if stored.needle:
        found["needle"] = ArrayForm(pixels, "uint8", ("row", "column"), "1 where the slice shows the needle's shaft")
    if stored.displacement:
        about = "how the tissue that is there now came there: right, down, away from the viewer"
        found["displacement"] = ArrayForm((*coarse, 3), "int16", ("block_row", "block_column", "along"), about, mm)
    if stored.volume:
        about = "displacement at nodes of the box, RAS: of what was at the node before the needle"
        found["volume"] = ArrayForm((*(stored.volume,) * 3, 3), "int16", ("i", "j", "k", "axis"), about, mm)
    if stored.iq:
        lines, samples = beams or (asked.view.lines, 1024)
        about = "complex echoes (in phase, quadrature) over the rms of liver's speckle at each depth"
        found["iq"] = ArrayForm((lines, samples, 2), "float16", ("line", "sample", "part"), about)
    return found
