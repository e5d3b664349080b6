"""Zarr 3 arrays, sharded: the file of each shard made in memory, so that whoever stores it can store it whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from .layout import ARRAYS, ArrayForm

_CHUNK_BYTES = 1 << 20
"""Of samples that are read together, about, before compression."""
_LEVEL = 5


def metadata(forms: Mapping[str, ArrayForm], samples: int, shard: int, attributes: dict[str, Any]) -> dict[str, bytes]:
    """Return the files that say what the arrays are, by name."""
    zarr = require("zarr")
    held: dict[str, Any] = {}
    group = zarr.open_group(zarr.storage.MemoryStore(held), mode="w", zarr_format=3, attributes=attributes)
    for name, form in forms.items():
        _array(group, name, form, samples, shard)
    return {f"{ARRAYS}/{key}": held[key].to_bytes() for key in sorted(held)}


def shard_files(
    forms: Mapping[str, ArrayForm], arrays: Mapping[str, NDArray[Any]], samples: int, shard: int, number: int
) -> dict[str, bytes]:
    """Return the file of each array that holds one shard; none where all of it is nothing.

    Parameters
    ----------
    forms : mapping of str to ArrayForm
        What the arrays are.
    arrays : mapping of str to ndarray
        The shard's samples along their first axis.
    samples, shard, number : int
        Samples in all, samples of a shard, and which shard.
    """
    zarr = require("zarr")
    files = {}
    for name, form in forms.items():
        held: dict[str, Any] = {}
        group = zarr.open_group(zarr.storage.MemoryStore(held), mode="w", zarr_format=3)
        array = _array(group, name, form, samples, shard)
        first = number * shard
        array[first : first + len(arrays[name])] = arrays[name]
        key = f"{name}/c/{number}" + "/0" * len(form.shape)
        if key in held:
            files[f"{ARRAYS}/{key}"] = held[key].to_bytes()
    return files


def _array(group: Any, name: str, form: ArrayForm, samples: int, shard: int) -> Any:
    codecs = require("zarr.codecs")
    size = int(np.dtype(form.dtype).itemsize)
    chunk = _chunk(shard, size * int(np.prod(form.shape)))
    shuffle = "noshuffle" if size == 1 else "bitshuffle"
    return group.create_array(
        name, shape=(samples, *form.shape), dtype=form.dtype, chunks=(chunk, *form.shape),
        shards=(shard, *form.shape), fill_value=form.fill, dimension_names=("index", *form.axes),
        compressors=codecs.BloscCodec(typesize=size, cname="zstd", clevel=_LEVEL, shuffle=shuffle),
        attributes={"about": form.about, **form.attributes},
    )  # fmt: skip


def _chunk(shard: int, sample_bytes: int) -> int:
    """Samples that are compressed together: the largest divisor of a shard that is not too large."""
    most = max(1, _CHUNK_BYTES // sample_bytes)
    return max(n for n in range(1, min(most, shard) + 1) if shard % n == 0)
