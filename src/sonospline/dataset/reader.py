"""Reads a data set, whatever its form and wherever it is: by sample, by shard, or all of a split in some order."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._extras import require
from .._shown import shown
from .layout import ARRAYS, MANIFEST, array_forms, read_described, table_name, tar_name
from .plan import SPLITS
from .specification import Specification
from .store import Store, store_at
from .table_form import read_rows
from .tar_form import read_tar

Arrays = dict[str, NDArray[Any]]

_KEPT_SHARDS = 2
_INCOMPLETE = f"is no complete data set: it has no sound {MANIFEST}; make what is missing of it with dataset make"


class DataSet:
    """A data set that is complete.

    Parameters
    ----------
    address : str, path or Store
        A folder, or an address of fsspec.
    options : dict, optional
        For fsspec.

    Raises
    ------
    ValueError
        There is none, or it is not complete.

    Examples
    --------
    >>> import tempfile
    >>> from sonospline.dataset import DataSet, Specification, make_dataset
    >>> asked = Specification.parse('''samples = 2
    ... [[sources]]
    ... kind = "block"
    ... [stored]
    ... pixels = 64
    ... ''')
    >>> folder = tempfile.mkdtemp()
    >>> made = make_dataset(asked, folder)
    >>> data = DataSet(folder)
    >>> data.sample(1)["image"].shape, data.labels[8], round(made.bytes_a_sample) < 180_000
    ((64, 64), 'tumour', True)
    """

    def __init__(self, address: str | os.PathLike[str] | Store, options: dict[str, Any] | None = None) -> None:
        self.store = address if isinstance(address, Store) else store_at(address, options)
        self.manifest = read_described(self.store, MANIFEST, _INCOMPLETE)
        try:
            self.specification = Specification.parse_table(self.manifest["specification"])
        except (ValueError, KeyError):
            raise ValueError(f"{self.store.address!r} {_INCOMPLETE}") from None
        beams = self.manifest.get("beams")
        self.forms = {} if self.form == "recipe" else array_forms(self.specification, beams and tuple(beams))
        """What its arrays are, by name."""
        self._read_shard = lru_cache(maxsize=_KEPT_SHARDS)(self._read)
        self._table = lru_cache(maxsize=_KEPT_SHARDS)(self._read_table)
        self._splits = lru_cache(maxsize=None)(self._read_splits)

    @property
    def form(self) -> str:
        """How it is stored: ``zarr``, ``webdataset`` or ``recipe``."""
        return self.specification.storage.form

    @property
    def labels(self) -> dict[int, str]:
        """Names of the numbers in label images; 0 is nothing."""
        return {int(number): name for name, number in self.manifest["labels"].items()}

    @property
    def failed(self) -> dict[int, str]:
        """Samples that could not be made, and why."""
        return {int(index): reason for index, reason in self.manifest["failed"].items()}

    def __len__(self) -> int:
        return int(self.manifest["samples"])

    def __repr__(self) -> str:
        return f"DataSet({shown(self.manifest['name'])}, {len(self):,} samples, {self.form})"

    def rows(self, split: str | None = None, columns: Sequence[str] | None = None) -> Iterator[dict[str, Any]]:
        """Yield the rows of the table, of a split or of all, without those that failed.

        Parameters
        ----------
        split : {"train", "validation", "test"}, optional
            Which.
        columns : sequence of str, optional
            Which columns, besides ``index`` and ``split``; by default all.
        """
        self._check_split(split)
        wanted = None if columns is None else list(dict.fromkeys(["index", "split", "failed", *columns]))
        for shard in range(self.specification.shards):
            rows = read_rows(self.store.read(table_name(shard)), wanted)
            yield from (row for row in rows if row["failed"] is None and split in (None, row["split"]))

    def sound_rows(self, shard: int) -> list[dict[str, Any]]:
        """Return the rows of a shard, without those that failed."""
        return [row for row in self._table(shard) if row["failed"] is None]

    def shard(self, number: int) -> Arrays:
        """Return the arrays of a shard as they are stored, samples along the first axis; see :attr:`forms`.

        Raises
        ------
        ValueError
            There is no such shard, or the data set holds recipes alone.
        """
        if self.form == "recipe":
            raise ValueError(f"{self.store.address!r} holds recipes alone; make its arrays with dataset rebuild")
        _validate.count("shard", number, least=0, most=self.specification.shards - 1)
        found: Arrays = self._read_shard(number)
        return found

    def sample(self, index: int) -> Mapping[str, Any]:
        """Return a sample: its arrays by name, displacement in mm (NaN where not known), and its row of the table."""
        _validate.count("index", index, least=0, most=len(self) - 1)
        number, place = divmod(index, self.specification.shard)
        row = self._table(number)[place]
        if row["failed"] is not None:
            raise ValueError(f"index = {index} is a sample that could not be made ({row['failed']}); take another")
        return {**{name: self.in_units(name, array[place]) for name, array in self.shard(number).items()}, "row": row}

    def in_units(self, name: str, array: NDArray[Any]) -> NDArray[Any]:
        """Return an array as it is meant: displacement in mm as float32, NaN where not known; others as they are."""
        attributes = self.forms[name].attributes
        if "scale_factor" not in attributes:
            return array
        found = array.astype(np.float32) * np.float32(attributes["scale_factor"])
        return np.where(array == attributes["_FillValue"], np.float32(np.nan), found)

    def samples(
        self,
        split: str | None = None,
        arrays: Sequence[str] | None = None,
        *,
        shuffle: int | None = None,
        part: int = 0,
        parts: int = 1,
    ) -> Iterator[Arrays]:
        """Yield the samples of a split one by one: the arrays asked for, and ``index``.

        Parameters
        ----------
        split : {"train", "validation", "test"}, optional
            Which; by default all.
        arrays : sequence of str, optional
            Names; by default all.
        shuffle : int, optional
            Seed of an order: of the shards, and of the samples in each.
        part, parts : int
            Which of so many readers this is: each has shards of its own.
        """
        for first, held, chosen in self._shards_read(split, arrays, shuffle, part, parts):
            for place in chosen:
                yield {**{name: array[place] for name, array in held.items()}, "index": np.array(first + place)}

    def batches(
        self,
        size: int,
        split: str | None = None,
        arrays: Sequence[str] | None = None,
        *,
        shuffle: int | None = None,
        part: int = 0,
        parts: int = 1,
    ) -> Iterator[Arrays]:
        """Yield the samples of a split in batches, along the first axis: each of one shard, whose last may be smaller.

        Parameters
        ----------
        size : int
            Samples of a batch.
        split, arrays, shuffle, part, parts
            As for :meth:`samples`, whose order it is.
        """
        _validate.count("size", size)
        for first, held, chosen in self._shards_read(split, arrays, shuffle, part, parts):
            for start in range(0, len(chosen), size):
                places = np.array(chosen[start : start + size])
                yield {**{name: array[places] for name, array in held.items()}, "index": first + places}

    def _shards_read(
        self, split: str | None, arrays: Sequence[str] | None, shuffle: int | None, part: int, parts: int
    ) -> Iterator[tuple[int, Arrays, list[int]]]:
        """For each shard in order its first sample, its arrays, and which of its samples are meant, in order."""
        self._check_split(split)
        names = tuple(self.forms) if arrays is None else tuple(arrays)
        for name in names:
            _validate.choice("arrays", name, tuple(self.forms))
        shards = self._shards_of(split)
        random = None if shuffle is None else np.random.default_rng(shuffle)
        if random is not None:
            random.shuffle(shards)
        for number in shards[part::parts]:
            held = self._read(number, names)
            chosen = [n for n, its in enumerate(self._splits(number)) if its is not None and split in (None, its)]
            if random is not None:
                random.shuffle(chosen)
            converted = {name: self.in_units(name, held[name]) for name in names}
            yield number * self.specification.shard, converted, chosen

    def _check_split(self, split: str | None) -> None:
        if split is not None:
            _validate.choice("split", split, SPLITS)

    def _shards_of(self, split: str | None) -> list[int]:
        """Shards that hold samples of a split."""
        found = range(self.specification.shards)
        return [n for n in found if split is None or split in self._splits(n)]

    def _read_table(self, number: int) -> list[dict[str, Any]]:
        return read_rows(self.store.read(table_name(number)))

    def _read_splits(self, number: int) -> list[str | None]:
        """Of each sample of a shard its split; None of one that failed."""
        rows = read_rows(self.store.read(table_name(number)), ["split", "failed"])
        return [row["split"] if row["failed"] is None else None for row in rows]

    def _read(self, number: int, names: tuple[str, ...] | None = None) -> Arrays:
        names = tuple(self.forms) if names is None else names
        return (self._read_tar if self.form == "webdataset" else self._read_zarr)(number, names)

    def _read_zarr(self, number: int, names: tuple[str, ...]) -> Arrays:
        """By way of memory, so that any store will do: the shard's own files, and the arrays' metadata."""
        zarr, shard = require("zarr"), self.specification.shard
        buffer = require("zarr.core.buffer").default_buffer_prototype().buffer
        files: dict[str, Any] = {}
        for name in names:
            for key in (f"{name}/zarr.json", f"{name}/c/{number}" + "/0" * len(self.forms[name].shape)):
                if key.endswith("json") or f"{ARRAYS}/{key}" in self._files_of(number):
                    files[key] = buffer.from_bytes(self.store.read(f"{ARRAYS}/{key}"))
        memory = zarr.storage.MemoryStore(files, read_only=True)
        first, last = number * shard, min((number + 1) * shard, len(self))
        return {name: zarr.open_array(memory, path=name, mode="r", zarr_format=3)[first:last] for name in names}

    def _files_of(self, number: int) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self.manifest["shards"][number]["files"]
        return found

    def _read_tar(self, number: int, names: tuple[str, ...]) -> Arrays:
        shard = self.specification.shard
        first, last = number * shard, min((number + 1) * shard, len(self))
        arrays = {name: self.forms[name].empty(last - first) for name in names}
        for index, held in read_tar(self.store.read(tar_name(number))):
            for name in names:
                arrays[name][index - first] = held[name]
        return arrays

    def __getstate__(self) -> dict[str, Any]:
        return {"address": self.store}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]
