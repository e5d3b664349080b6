"""What ``sonospline insert`` leaves behind: deformed images, the deformation, a picture and a summary."""

from __future__ import annotations

import argparse
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from .. import _core
from ..fields.field import Field
from ..fields.grid_field import GridField
from ..fields.image_warp import ImageWarp
from ..fields.kernel_field import KernelField
from ..geometry.label_map import LabelMap
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from ..io.canvas import attempt
from ..io.insertion_figure import draw_insertion
from ..io.insertion_scene import insertion_scene
from ..io.volumes import write_volume
from ..io.vtk import write_vti
from ..io.writing import write_json
from ..mechanics.bone_stop import Blocked
from ..models.insertion import NeedleInsertion
from . import _folds

_MANY_LANDMARKS = 2000


@dataclass(frozen=True)
class Outcome:
    """A finished insertion and how long its steps took."""

    insertion: NeedleInsertion
    path: Needle
    """As it was asked for."""
    needle: Needle
    """Where it ended."""
    bone: Blocked | None
    """What stopped it there."""
    field: Field
    step_ms: list[float]


def write(outcome: Outcome, images: dict[str, Volume], folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Write each image deformed, under its name, and the deformation; the first image is the one to draw."""
    grid = outcome.insertion.tissue.grid
    displacement = outcome.field.on_grid()
    det = np.linalg.det(outcome.field.jacobian(grid.points)).reshape(grid.shape)
    _folds.refuse(det, grid, args)
    # With every face node a landmark, summing at each iterate would take minutes.
    many = isinstance(outcome.field, KernelField) and len(outcome.field.centres) > _MANY_LANDMARKS
    warp = ImageWarp.of(GridField.of(outcome.field, "accurate") if many else outcome.field)
    pairs = {file: (image, warp.apply(image)) for file, image in images.items()}
    for file, (_, image) in pairs.items():
        write_volume(image, folder / file)
    warp.save(folder / "displacement.h5")
    if args.slicer:
        named = {"labels" if file.startswith("warped_labels") else "image": pair for file, pair in pairs.items()}
        deformation = (folder / "displacement.h5").read_bytes()
        insertion_scene(named, deformation, outcome.needle, outcome.path.tip).write(folder / "scene.mrb")
    write_vti(folder / "displacement.vti", grid, {"displacement": displacement, "det_jacobian": det})
    moved = Volume(
        voxels=np.linalg.norm(warp.displacement, axis=-1),
        spacing=grid.spacing,
        origin=grid.origin,
        direction=grid.direction,
    )
    volume, warped = next(iter(pairs.values()))
    attempt(lambda: draw_insertion(volume, warped, moved, outcome.needle, folder / "figure.png"))
    summary = {
        "verb": "insert",
        "volume": str(args.volume or args.labels or "phantom"),
        "volume_kind": "labels" if isinstance(volume, LabelMap) else "image",
        "entry_ras_mm": outcome.needle.entry.tolist(),
        "target_ras_mm": outcome.path.tip.tolist(),
        "tip_ras_mm": outcome.needle.tip.tolist(),
        "depth_mm": outcome.needle.depth,
        "blocked": None if outcome.bone is None else asdict(outcome.bone),
        "nodes": grid.node_count,
        "grid_shape": grid.shape,
        "grid_spacing_mm": grid.spacing,
        "entry_face": outcome.insertion.tissue.entry_face,
        "model": args.model,
        **outcome.insertion.tissue_model.facts(outcome.insertion.response),
        "steps": len(outcome.step_ms),
        "step_ms": {
            "median": float(np.median(outcome.step_ms)),
            "p95": float(np.percentile(outcome.step_ms, 95)),
        },
        "max_displacement_mm": float(np.linalg.norm(displacement, axis=-1).max()),
        "smallest_det_jacobian": float(det.min()),
        "folded_nodes": int((det <= 0).sum()),
        "boundary_drift_mm": outcome.insertion.tissue.boundary_drift(displacement),
        "inverse": {
            "unconverged_nodes": int((~warp.report.converged).sum()),
            "iterations": warp.report.iterations,
            "residual_mm": warp.report.residual,
        },
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "seed": args.seed,
        "versions": _versions(),
        "files": sorted([*(file.name for file in folder.iterdir()), "summary.json"]),
    }
    write_json(folder / "summary.json", summary)
    return summary


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in ("sonospline", "numpy", "scipy", "SimpleITK", "vtk", "matplotlib"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    return found
