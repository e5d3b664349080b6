"""Makes the samples of a data set again from their recipes, in another form or place, bit for bit."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

from msgspec.structs import replace

from .factory import Made, make_dataset
from .reader import DataSet
from .shard import check_worker


def rebuild(
    data: DataSet,
    out: str | os.PathLike[str],
    *,
    form: Literal["zarr", "webdataset"] = "zarr",
    folder: Path | None = None,
    **settings: Any,
) -> Made:
    """Make a data set's samples again from the recipes in its table.

    Parameters
    ----------
    data : DataSet
        Of any form.
    out : str or path
        A new folder, or an address of fsspec.
    form : {"zarr", "webdataset"}, default: "zarr"
        How they are stored.
    folder : Path, optional
        From where the files of its specification are seen; by default from here.
    **settings
        As :func:`make_dataset` takes them.

    Raises
    ------
    WorkerError
        This machine would make other bits: another version, or another instruction set.
    """
    if not settings.get("scheduler") and settings.get("client") is None:
        check_worker(data.manifest["made_by"], who="this machine")
    asked = replace(data.specification, storage=replace(data.specification.storage, form=form))
    seen = asked.seen_from(data.specification.folder if folder is None else folder)
    return make_dataset(seen, out, recipes=data.store, **settings)
