"""Sequence MetaImages (``.igs.mha``) of PLUS and 3D Slicer: frames with their transforms, written as they come."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from .writing import beside

Array = NDArray[np.float64]

SUFFIX = ".igs.mha"
_MOST_BYTES, _MOST_FRAMES = 16 << 30, 1_000_000


def sequence_header(
    size: tuple[int, int, int], frames: Sequence[Mapping[str, str]], *, orientation: str = "MF"
) -> bytes:
    """Return what stands before the pixels.

    Parameters
    ----------
    size : (columns, rows, frames)
    frames : sequence of mapping
        What is known of each frame: ``ProbeToReferenceTransform``, ``Timestamp``, ...
    orientation : str, default: "MF"
        Where x and y of the pixels run, as PLUS says it.
    """
    lines = [
        "ObjectType = Image", "NDims = 3", "BinaryData = True", "BinaryDataByteOrderMSB = False",
        f"DimSize = {' '.join(map(str, size))}", "ElementSpacing = 1 1 1", "Offset = 0 0 0", "ElementType = MET_UCHAR",
        f"UltrasoundImageOrientation = {orientation}", "UltrasoundImageType = BRIGHTNESS",
    ]  # fmt: skip
    for number, fields in enumerate(frames):
        lines += [f"Seq_Frame{number:04d}_{key} = {value}" for key, value in fields.items()]
    lines.append("ElementDataFile = LOCAL")
    return ("\n".join(lines) + "\n").encode()


class SequenceWriter:
    """Takes frames one by one; the file is there, whole, when it is closed.

    Parameters
    ----------
    path : path-like
        A new ``.igs.mha`` file; one that is there is not written over.
    orientation : str, default: "MF"

    Raises
    ------
    ValueError
        Another suffix, or a file that is there already.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import numpy as np
    >>> from sonospline.io.pose_sequence import read_pose_sequence
    >>> from sonospline.io.sequence_writer import SequenceWriter
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "one.igs.mha"
    >>> writer = SequenceWriter(path)
    >>> for time_s in (0.0, 0.1):
    ...     writer.add(np.zeros((3, 4), np.uint8), time_s, {"ProbeToReference": (np.eye(4), True)})
    >>> writer.close()
    >>> read_pose_sequence(path)
    PoseSequence(2 frames, 0.1 s, ProbeToReference)
    """

    def __init__(self, path: str | PathLike[str], *, orientation: str = "MF") -> None:
        self.path, self._orientation = Path(path), orientation
        if not self.path.name.endswith(SUFFIX):
            raise ValueError(f"path = {str(path)!r} does not end in {SUFFIX}; give one that does")
        if self.path.exists():
            raise ValueError(f"path = {str(path)!r} is there already; give a new name")
        self._pixels = TemporaryFile(dir=self.path.parent)  # noqa: SIM115  (closed with the writer)
        self._shape: tuple[int, ...] | None = None
        self._frames: list[dict[str, str]] = []

    @property
    def frames(self) -> int:
        """How many were taken."""
        return len(self._frames)

    def add(
        self, pixels: NDArray[np.uint8], time_s: float, transforms: Mapping[str, tuple[NDArray[np.floating], bool]]
    ) -> None:
        """Take a frame: its pixels (rows, columns), when it was, and poses by name with whether each tool was seen.

        Raises
        ------
        ValueError
            Another shape than the first frame's, or more than is kept: 10^6 frames, 16 GiB.
        OSError
            The disk is full.
        """
        if self._shape not in (None, pixels.shape):
            raise ValueError(f"a frame of {pixels.shape} among those of {self._shape}: a sequence has one shape")
        if len(self._frames) >= _MOST_FRAMES or (len(self._frames) + 1) * pixels.size > _MOST_BYTES:
            raise ValueError(f"{self.path.name} has {len(self._frames)} frames, which is as much as is kept; stop it")
        fields = {}
        for name, (matrix, seen) in transforms.items():
            fields[f"{name}Transform"] = " ".join(f"{x:.9g}" for x in np.asarray(matrix).ravel())
            fields[f"{name}TransformStatus"] = "OK" if seen else "INVALID"
        self._pixels.seek(len(self._frames) * pixels.nbytes)  # a frame that was cut off is written over
        self._pixels.write(np.ascontiguousarray(pixels).tobytes())
        self._shape = pixels.shape
        self._frames.append({**fields, "Timestamp": f"{time_s:.6f}", "ImageStatus": "OK"})

    def close(self) -> None:
        """Write the file; ValueError where no frame came."""
        with self._pixels:
            if self._shape is None:
                raise ValueError(f"{self.path.name} has no frames; record for longer")
            rows, columns = self._shape
            self._pixels.seek(0)
            with beside(self.path) as partial, partial.open("xb") as file:
                file.write(sequence_header((columns, rows, self.frames), self._frames, orientation=self._orientation))
                shutil.copyfileobj(self._pixels, file)

    def __repr__(self) -> str:
        return f"SequenceWriter({self.path.name!r}, {self.frames} frames)"
