"""Files of LeRobot v3: tables as Parquet, pictures as MP4, many episodes in each, and statistics of what they hold."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require

DATA_MB, VIDEO_MB, CHUNK = 100, 200, 1000
"""Sizes of files, at most but for their last episode, and files of a folder: LeRobot's own."""
CODEC = {"crf": 30, "g": 2, "preset": 12}
"""Of AV1, as LeRobot writes it: every second picture is whole, so that any is found at once."""
_QUANTILES = (1, 10, 50, 90, 99)
_WRITTEN = {"compression": "snappy", "use_dictionary": True}
Statistics = dict[str, NDArray[np.float64]]


def name_of(number: int) -> str:
    """Return a file's folder and name without its suffix, by its number."""
    return f"chunk-{number // CHUNK:03d}/file-{number % CHUNK:03d}"


def place_of(number: int) -> dict[str, int]:
    """Return which folder and file a number is."""
    return {"chunk_index": number // CHUNK, "file_index": number % CHUNK}


class Tables:
    """Parquet files of one kind, a row group for each episode."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._number, self._held = folder, 0, 0
        self._writer: Any = None

    @property
    def number(self) -> int:
        """Which file the next table goes to."""
        if self._writer is not None and self._held > DATA_MB * 2**20:
            self.close()
            self._number, self._held = self._number + 1, 0
        return self._number

    def add(self, table: Any) -> None:
        """Append a table."""
        path = self._folder / f"{name_of(self.number)}.parquet"
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = require("pyarrow.parquet").ParquetWriter(path, table.schema, **_WRITTEN)
        self._writer.write_table(table)
        self._held += table.nbytes

    def close(self) -> None:
        """Finish the file that is written."""
        if self._writer is not None:
            self._writer.close()
        self._writer = None


class Videos:
    """MP4 files of one camera, one episode after the other."""

    def __init__(self, folder: Path, fps: int) -> None:
        self._folder, self._fps = folder, fps
        self._number = self._held = self._frames = 0
        self._file: Any = None
        self._stream: Any = None

    def add(self, pictures: NDArray[np.uint8]) -> dict[str, Any]:
        """Append an episode's (n, rows, columns, 3); return which file it is in, and from when to when."""
        if self._frames and self._held > VIDEO_MB * 2**20:
            self.close()
            self._number, self._held, self._frames = self._number + 1, 0, 0
        if self._file is None:
            self._open(*pictures.shape[1:3])
        first, self._frames = self._frames, self._frames + len(pictures)
        for place, picture in enumerate(pictures, first):
            frame = require("av").VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            frame.pts = place
            self._encode(frame)
        return {
            **place_of(self._number), "from_timestamp": first / self._fps, "to_timestamp": self._frames / self._fps
        }  # fmt: skip

    def _open(self, rows: int, columns: int) -> None:
        path = self._folder / f"{name_of(self._number)}.mp4"
        path.parent.mkdir(parents=True, exist_ok=True)
        options = {name: str(value) for name, value in CODEC.items()}
        os.environ.setdefault("SVT_LOG", "1")  # errors alone: the encoder tells stderr how it was built
        self._file = require("av").open(str(path), "w")
        self._stream = self._file.add_stream("libsvtav1", self._fps, options=options)
        self._stream.height, self._stream.width, self._stream.pix_fmt = rows, columns, "yuv420p"

    def _encode(self, frame: Any = None) -> None:
        with _scheduled_as_before():
            packets = self._stream.encode(frame)
        for packet in packets:
            self._held += packet.size
            self._file.mux(packet)

    def close(self) -> None:
        """Finish the file that is written."""
        if self._file is not None:
            self._encode()
            self._file.close()
        self._file = None


@contextmanager
def _scheduled_as_before() -> Iterator[None]:
    """Give the calling thread its scheduling back.

    SVT-AV1 takes the highest priority in real time for the thread that opens it, where the system lets it, as root, and
    keeps it: what that thread starts afterwards, such as a browser, is then served before all other programs.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        if (os.sched_getscheduler(0), os.sched_getparam(0)) != before:
            os.sched_setscheduler(0, *before)


def write_tasks(path: Path, tasks: Sequence[str]) -> None:
    """Write the table of tasks, whose index is their text: pandas looks for it in the file's metadata."""
    arrow = require("pyarrow")
    table = arrow.table({"task_index": list(range(len(tasks))), "task": list(tasks)})
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
        for name, (kind, numpy) in kinds.items()
    ]
    about = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.2.0"}
    require("pyarrow.parquet").write_table(table.replace_schema_metadata({"pandas": json.dumps(about)}), path)


def statistics(values: NDArray[Any]) -> Statistics:
    """Return those of numbers (n, k), or (n,) of one: least, largest, mean, deviation, quantiles and how many."""
    rows = np.asarray(values, float).reshape(len(values), -1)
    cuts = np.quantile(rows, [share / 100 for share in _QUANTILES], axis=0)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    found |= {f"q{share:02d}": cut for share, cut in zip(_QUANTILES, cuts, strict=True)}
    return {**found, "count": np.array([float(len(rows))])}


def picture_statistics(pictures: NDArray[np.uint8]) -> Statistics:
    """Return those of pictures' grey levels over 255, (3, 1, 1) for channels that are alike."""
    found = statistics(pictures[..., 0].ravel() / 255)
    spread = {name: np.broadcast_to(value.reshape(1, 1, 1), (3, 1, 1)) for name, value in found.items()}
    return {**spread, "count": np.array([float(len(pictures))])}


def joined(parts: Sequence[Statistics]) -> Statistics:
    """Return those of several episodes together; of quantiles, which cannot be joined, the outer ones, as LeRobot."""
    held = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
    counts = held.pop("count")
    share = (counts / counts.sum()).reshape(-1, *[1] * (held["mean"].ndim - 1))
    mean = (held["mean"] * share).sum(axis=0)
    spread = ((held["std"] ** 2 + (held["mean"] - mean) ** 2) * share).sum(axis=0)
    outer = {name: held[name].min(axis=0) for name in ("min", *_names(low=True))}
    outer |= {name: held[name].max(axis=0) for name in ("max", *_names(low=False))}
    return {**outer, "mean": mean, "std": np.sqrt(spread), "count": counts.sum(axis=0)}


def _names(*, low: bool) -> list[str]:
    return [f"q{share:02d}" for share in _QUANTILES if (share <= 50) == low]


def as_lists(found: Mapping[str, Statistics]) -> dict[str, dict[str, Any]]:
    """Return statistics as JSON holds them."""
    return {
        key: {name: value.astype(int).tolist() if name == "count" else value.tolist() for name, value in one.items()}
        for key, one in found.items()
    }
