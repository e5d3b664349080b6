"""What ``sonospline image`` writes: pictures before and after, a sequence between, and a summary."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..io.writing import write_json
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.insertion import Insertion
from ..ultrasound.cine import write_gif, write_sequence
from . import _folds
from ._image_view import View
from ._progress import track

_TIMED_FRAMES = 5


def write(view: View, folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Write every file of a run; return the summary."""
    start = time.perf_counter()
    before = view.render(None, None, 0)
    first_ms = 1e3 * (time.perf_counter() - start)
    before.save(folder / "before.png")
    shown, largest, field = before, None, None
    if view.needle is not None:
        insertion, needle = _insertion(view), view.needle
        frames = []
        for k in track(range(args.cine), args.cine, "imaging", quiet=args.quiet):
            at = Needle(needle.entry, needle.at((k + 1) / args.cine))
            frames.append(view.render(GridField.of(insertion.advance(at)), at, k))
        final = insertion.advance(needle)
        _folds.refuse(np.linalg.det(final.jacobian(view.grid.points)).reshape(view.grid.shape), view.grid, args)
        field = GridField.of(final)
        largest = float(np.linalg.norm(field.values, axis=-1).max())
        shown = view.render(field, needle, args.cine)
        shown.save(folder / "after.png")
        if frames:
            write_sequence(frames, folder / "cine.igs.mha")
            write_gif([before, *frames], folder / "cine.gif")
    shown.save(folder / "image.mha")
    summary = {
        "verb": "image",
        "picture": before.pixels.shape,
        "pixel_mm": before.plane.spacing_mm[0],
        "image_to_reference": before.plane.image_to_reference.tolist(),
        "seen_share": None if before.mask is None else float(before.mask.mean()),
        "entry_ras_mm": None if view.needle is None else view.needle.entry.tolist(),
        "target_ras_mm": None if view.needle is None else view.needle.tip.tolist(),
        "max_displacement_mm": largest,
        "first_ms": first_ms,
        "render_ms": _frame_ms(view, field),
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "seed": args.seed,
    }
    summary["files"] = sorted([*(file.name for file in folder.iterdir()), "summary.json"])
    write_json(folder / "summary.json", summary)
    return summary


def _frame_ms(view: View, field: GridField | None) -> float:
    """Median time of some frames after what was set up for the field's lattice."""
    times = []
    for frame in range(_TIMED_FRAMES + 1):
        start = time.perf_counter()
        view.render(field, view.needle, frame)
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times[1:]))


def _insertion(view: View) -> Insertion:
    assert view.needle is not None
    face = view.grid.nearest_face(view.needle.entry)
    return Insertion(Tissue(view.grid, entry_face=face), NeedleTissueModel.paper(view.grid.side))
