"""Tracked poses of a recording: the sequence MetaImages of PLUS and 3D Slicer (``.igs.mha``)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from .files import open_file

Array = NDArray[np.float64]

_FIELD = re.compile(r"Seq_Frame(\d{1,8})_(\w+?)(Transform|TransformStatus)?\Z", re.ASCII)
_LONGEST_LINE, _LARGEST = 4096, 256 << 20
_MOST_FRAMES = 1_000_000
_WANTED = "a sequence MetaImage, as PLUS records it"


@dataclass(frozen=True, eq=False, repr=False)
class PoseSequence:
    """Poses of tracked tools at moments.

    Parameters
    ----------
    time_s : (n,) ndarray
        Of each frame, by the recorder's clock; it never goes back.
    poses : mapping of str to (n, 4, 4) ndarray
        By name (``ProbeToTracker``), in the file's own coordinates, mm.
    seen : mapping of str to (n,) ndarray of bool
        Whether the tracker saw the tool: where not, the pose means nothing.
    """

    time_s: Array
    poses: Mapping[str, Array]
    seen: Mapping[str, NDArray[np.bool_]]

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    def __repr__(self) -> str:
        return f"PoseSequence({len(self.time_s)} frames, {self.seconds:.4g} s, {', '.join(self.poses)})"


def read_pose_sequence(path: str | PathLike[str]) -> PoseSequence:
    """Read the poses of a recording; its pixels are left alone.

    Raises
    ------
    ValueError
        No sequence, one without transforms, or numbers that are none.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sonospline.io.pose_sequence import read_pose_sequence
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "hand.igs.mha"
    >>> lines = ["NDims = 3", "Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1",
    ...          "Seq_Frame0000_Timestamp = 2", "ElementDataFile = LOCAL"]
    >>> _ = path.write_text("\\n".join(lines))
    >>> read_pose_sequence(path)
    PoseSequence(1 frames, 0 s, ProbeToTracker)
    """
    fields = _header_of(path)
    frames: dict[int, dict[str, str]] = {}
    for key, value in fields:
        found = _FIELD.fullmatch(key)
        if found is not None:
            frames.setdefault(int(found[1]), {})[found[2] + (found[3] or "")] = value
    if len(frames) > _MOST_FRAMES:
        raise ValueError(f"{path} has {len(frames)} frames; give one of {_MOST_FRAMES} at most")
    ordered = [frames[number] for number in sorted(frames)]
    names = sorted({key[: -len("Transform")] for frame in ordered for key in frame if key.endswith("Transform")})
    if not names:
        raise ValueError(f"{path} holds no transforms (Seq_Frame0000_ProbeToTrackerTransform); give {_WANTED}")
    time_s = np.array([_number(path, frame.get("Timestamp", "nan")) for frame in ordered])
    time_s = np.maximum.accumulate(np.where(np.isfinite(time_s), time_s, 0.0))
    seen = {name: np.array([_is_seen(frame, name) for frame in ordered]) for name in names}
    poses = {
        name: np.array(
            [
                _matrix(path, name, f[name + "Transform"]) if ok else np.eye(4)
                for f, ok in zip(ordered, seen[name], strict=True)
            ]
        )
        for name in names
    }
    return PoseSequence(time_s, poses, seen)


def _header_of(path: str | PathLike[str]) -> list[tuple[str, str]]:
    fields, size = [], 0
    with open_file(path, "sequence", _WANTED) as stream:
        for line in iter(lambda: stream.readline(_LONGEST_LINE), b""):
            size += len(line)
            key, equals, value = line.decode("latin-1").partition("=")
            if not equals or size > _LARGEST:
                raise ValueError(f"sequence = {str(path)!r} is not a MetaImage; give {_WANTED}")
            fields.append((key.strip(), value.strip()))
            if fields[-1][0] == "ElementDataFile":
                return fields
    raise ValueError(f"sequence = {str(path)!r} ends within its header; give {_WANTED}")


def _is_seen(frame: Mapping[str, str], name: str) -> bool:
    return name + "Transform" in frame and frame.get(name + "TransformStatus", "OK").upper() == "OK"


def _number(path: str | PathLike[str], text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{path} has the time {text[:40]!r}, which is no number; give {_WANTED}") from None


def _matrix(path: str | PathLike[str], name: str, text: str) -> Array:
    try:
        matrix = np.array(text.split(), float)
    except ValueError:
        matrix = np.zeros(0)
    if matrix.shape != (16,) or not np.isfinite(matrix).all():
        raise ValueError(f"{path} has a transform {name} that is not sixteen numbers; give {_WANTED}")
    return matrix.reshape(4, 4)
