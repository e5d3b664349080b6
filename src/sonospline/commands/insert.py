"""``sonospline insert``: push a needle into a volume and write the deformed tissue."""

from __future__ import annotations

import argparse
import json
import platform
import time
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import _core, _validate
from ..field import Field
from ..figure import draw_insertion
from ..grid_field import GridField
from ..insertion import Insertion
from ..interaction import NeedleTissueModel
from ..io.staging import staged_folder
from ..io.transforms import ImageWarp
from ..io.volumes import RAS_TO_LPS, read_volume, suffix_of, write_volume
from ..io.vtk import write_vti
from ..kernels import Biharmonic, Triharmonic
from ..needle import Needle
from ..phantom import default_needle, layered_block
from ..tissue import Tissue
from ..volume import Volume
from . import _parameters, _points
from ._progress import bar, track

Array = NDArray[np.float64]

HELP = "push a needle into a 3-D image and write the deformed tissue"
EXAMPLES = """examples:
  sonospline insert --out out                         # on a generated phantom
  sonospline insert --volume ct.nii.gz --entry 60,-20,15 --target 20,10,30 --out out
  sonospline insert --volume us.mha --frame IJK --entry 0,50,50 --target 90,55,50 --out out
  sonospline insert --set shaft_displacement=3.5 --steps 40 --json --out out
"""
_MANY_ANCHORS = 2000
KERNELS = {"biharmonic": Biharmonic, "triharmonic": Triharmonic}


@dataclass(frozen=True)
class Outcome:
    """A finished insertion and how long its steps took."""

    insertion: Insertion
    needle: Needle
    field: Field
    step_ms: list[float]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    where = parser.add_argument_group("where")
    where.add_argument("--volume", type=Path, metavar="FILE", help=".nrrd, .mha or .nii.gz; without it, a phantom")
    where.add_argument("--entry", metavar="X,Y,Z", help="where the needle enters (mm, or voxels with --frame IJK)")
    where.add_argument("--target", metavar="X,Y,Z", help="where its tip ends")
    where.add_argument("--frame", default="RAS", choices=("RAS", "LPS", "IJK"), help="frame of the points (RAS)")
    where.add_argument("--entry-face", default="auto", metavar="FACE", help="free face, x- to z+ (nearest to entry)")
    how = parser.add_argument_group("how")
    how.add_argument("--steps", type=int, default=20, metavar="N", help="insertion steps (20)")
    how.add_argument("--nodes", type=int, default=150_000, metavar="N", help="grid nodes, about (150000)")
    how.add_argument("--parameters", type=Path, metavar="FILE", help="model parameters, TOML (Table I)")
    how.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one model parameter, mm")
    how.add_argument("--kernel", default="biharmonic", choices=tuple(KERNELS), help="spline kernel (biharmonic)")
    how.add_argument("--smoothing", type=float, default=0.0, metavar="S", help="0 meets every landmark (0)")
    how.add_argument("--anchors", default="5", metavar="N|all", help="anchors a face side, or every face node (5)")
    how.add_argument("--max-landmarks", type=int, default=300, metavar="N", help="most landmarks (300)")
    how.add_argument(
        "--accumulation",
        default="maximum",
        choices=("maximum", "incremental"),
        help="map from the reference, or Algorithm 1's moving mesh (maximum)",
    )
    how.add_argument("--seed", type=int, default=0, help="seed of the phantom's speckle (0)")
    what = parser.add_argument_group("what comes out")
    what.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    what.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    what.add_argument("--quiet", action="store_true", help="no progress bar")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _validate.count("seed", args.seed, least=0)
    suffix = suffix_of(args.volume) if args.volume else ".nrrd"
    volume = read_volume(args.volume) if args.volume else layered_block(args.seed)
    path = _needle(args, volume)
    insertion = _insertion(args, volume, path)
    with staged_folder(args.out) as folder:
        outcome = _insert(insertion, path, args)
        return _write(outcome, volume, folder, f"warped{suffix}", args)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the summary as a few lines for a person."""
    shape = " x ".join(map(str, summary["grid_shape"]))
    inverse = summary["inverse"]
    lines = [
        f"tissue        {summary['nodes']:,} nodes ({shape}), {summary['entry_face']} free",
        f"needle        {summary['depth_mm']:.1f} mm in {summary['steps']} steps, "
        f"{summary['landmarks']} landmarks, {summary['anchors']} anchors",
        f"step          {summary['step_ms']['median']:.1f} ms median, {summary['step_ms']['p95']:.1f} ms p95 "
        f"({summary['backend']}, {summary['instruction_set']})",
        f"displacement  {summary['max_displacement_mm']:.2f} mm at most, "
        f"pinned faces drift {summary['boundary_drift_mm']:.3f} mm",
        f"folding       smallest det J {summary['smallest_det_jacobian']:.3f}",
    ]
    if inverse["unconverged_nodes"]:
        lines.append(f"inverse       NOT found at {inverse['unconverged_nodes']} nodes; the image is unwarped there")
    return "\n".join([*lines, f"picture       {args.out / 'figure.png'}"])


def _needle(args: argparse.Namespace, volume: Volume) -> Needle:
    if args.entry is None and args.target is None and args.volume is None:
        return default_needle()
    for name in ("entry", "target"):
        if getattr(args, name) is None:
            centre = ",".join(f"{x:.0f}" for x in volume.lattice.world(volume.lattice.extent[None] / 2)[0])
            raise ValueError(f"--{name} is missing; give X,Y,Z inside the image, whose centre is {centre} (RAS mm)")
    entry, target = (_world(name, getattr(args, name), args.frame, volume) for name in ("entry", "target"))
    if np.allclose(entry, target, rtol=0, atol=1e-9 * volume.lattice.side):
        raise ValueError(f"--target {args.target} equals --entry; move the target to where the tip should end")
    return Needle(entry, target)


def _world(name: str, text: str, frame: str, volume: Volume) -> Array:
    point = _points.parse(name, text)
    if frame == "IJK":
        return volume.position(point[None])[0]
    return RAS_TO_LPS @ point if frame == "LPS" else point


def _insertion(args: argparse.Namespace, volume: Volume, path: Needle) -> Insertion:
    grid = volume.grid(_validate.count("--nodes", args.nodes, least=8))
    face = grid.nearest_face(path.entry) if args.entry_face == "auto" else args.entry_face
    preset = NeedleTissueModel.paper_incremental if args.accumulation == "incremental" else NeedleTissueModel.paper
    model = _parameters.apply(preset(grid.side), args.parameters, args.set, grid.side)
    anchors = _anchors(args.anchors)
    with bar("factoring the faces", quiet=args.quiet or anchors != "all") as progress:
        return Insertion(
            Tissue(grid, entry_face=face),
            model,
            kernel=KERNELS[args.kernel](),
            anchors=anchors,
            max_landmarks=args.max_landmarks,
            smoothing=args.smoothing,
            accumulation=args.accumulation,
            progress=progress,
        )


def _anchors(text: str) -> int | Literal["all"]:
    if text == "all":
        return "all"
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"--anchors {text!r} is not a number; give anchors along a face side, or all") from None


def _insert(insertion: Insertion, path: Needle, args: argparse.Namespace) -> Outcome:
    step_ms = []
    steps = insertion.run(path.entry, path.tip, args.steps)
    for _ in track(range(args.steps), args.steps, "inserting", quiet=args.quiet):
        start = time.perf_counter()
        next(steps).on_grid()
        step_ms.append(1e3 * (time.perf_counter() - start))
    return Outcome(insertion, path, insertion.field, step_ms)


def _write(
    outcome: Outcome, volume: Volume, folder: Path, warped_name: str, args: argparse.Namespace
) -> dict[str, Any]:
    grid = outcome.insertion.tissue.grid
    displacement = outcome.field.on_grid()
    det = np.linalg.det(outcome.field.jacobian(grid.points)).reshape(grid.shape)
    # With every face node a landmark, summing at each iterate would take minutes.
    many = len(outcome.insertion.anchors) > _MANY_ANCHORS
    warp = ImageWarp.of(GridField.of(outcome.field, "accurate") if many else outcome.field)
    warped = warp.apply(volume)
    write_volume(warped, folder / warped_name)
    warp.write(folder / "displacement.h5")
    write_vti(folder / "displacement.vti", grid, {"displacement": displacement, "det_jacobian": det})
    moved = Volume(
        voxels=np.linalg.norm(warp.displacement, axis=-1),
        spacing=grid.spacing,
        origin=grid.origin,
        direction=grid.direction,
    )
    draw_insertion(volume, warped, moved, outcome.needle, folder / "figure.png")
    summary = {
        "volume": str(args.volume) if args.volume else "phantom",
        "entry_ras_mm": outcome.needle.entry.tolist(),
        "target_ras_mm": outcome.needle.tip.tolist(),
        "depth_mm": outcome.needle.depth,
        "nodes": grid.node_count,
        "grid_shape": grid.shape,
        "grid_spacing_mm": grid.spacing,
        "entry_face": outcome.insertion.tissue.entry_face,
        "landmarks": outcome.insertion.landmark_count,
        "anchors": len(outcome.insertion.anchors),
        "steps": args.steps,
        "step_ms": {
            "median": float(np.median(outcome.step_ms)),
            "p95": float(np.percentile(outcome.step_ms, 95)),
        },
        "max_displacement_mm": float(np.linalg.norm(displacement, axis=-1).max()),
        "smallest_det_jacobian": float(det.min()),
        "boundary_drift_mm": outcome.insertion.tissue.boundary_drift(displacement),
        "inverse": {
            "unconverged_nodes": int((~warp.report.converged).sum()),
            "iterations": warp.report.iterations,
            "residual_mm": warp.report.residual,
        },
        "accumulation": args.accumulation,
        "kernel": args.kernel,
        "model_mm": asdict(outcome.insertion.model),
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "seed": args.seed,
        "versions": _versions(),
        "files": [warped_name, "displacement.h5", "displacement.vti", "figure.png", "summary.json"],
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    return summary


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in ("sonospline", "numpy", "scipy", "SimpleITK", "vtk", "matplotlib"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    return found
