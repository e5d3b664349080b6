"""Series of frames: a sequence file that keeps their geometry, and a moving picture."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from os import PathLike

import numpy as np

from .._extras import require
from ..io.sequence_writer import sequence_header
from ..io.writing import write_bytes
from .frame import Frame, as_bytes


def write_sequence(frames: Sequence[Frame], path: str | PathLike[str], *, frame_ms: float = 50.0) -> None:
    """Write frames of one shape as a sequence MetaImage (``.igs.mha``, as PLUS and 3D Slicer read it).

    Every frame carries its ``ImageToReferenceTransform`` and its time. As in every sequence of PLUS the image
    frame counts pixels from pixel (0, 0), so that their size is in the transform and the header's spacing is 1;
    the reference is LPS mm.
    """
    from ..io.volumes import RAS_TO_LPS

    if not frames:
        raise ValueError("frames is empty; give at least one frame")
    if len({frame.pixels.shape for frame in frames}) > 1:
        raise ValueError("frames differ in shape; a sequence needs one shape")
    stack = np.stack([as_bytes(frame.pixels) for frame in frames])
    fields = []
    for number, frame in enumerate(frames):
        across, down, corner = (RAS_TO_LPS @ frame.plane.affine).T
        normal = RAS_TO_LPS @ frame.plane.image_to_reference[:3, 2]
        matrix = np.vstack([np.column_stack([across, down, normal, corner]), (0, 0, 0, 1)])
        place = {"ImageToReferenceTransform": " ".join(f"{x:.9g}" for x in matrix.ravel())}
        status = {"ImageToReferenceTransformStatus": "OK"}
        fields.append({**place, **status, "Timestamp": f"{number * frame_ms / 1000:.6g}", "ImageStatus": "OK"})
    frame_count, rows, columns = stack.shape
    write_bytes(path, sequence_header((columns, rows, frame_count), fields) + stack.tobytes())


def write_gif(frames: Sequence[Frame], path: str | PathLike[str], *, frame_ms: float = 100.0) -> None:
    """Write frames as an endless GIF. Needs Pillow, which the extra ``plot`` brings."""
    if not frames:
        raise ValueError("frames is empty; give at least one frame")
    image = require("PIL.Image")
    pictures = [image.fromarray(as_bytes(frame.shown)) for frame in frames]
    moving = BytesIO()
    pictures[0].save(moving, save_all=True, append_images=pictures[1:], duration=frame_ms, loop=0, format="GIF")
    write_bytes(path, moving.getvalue())
