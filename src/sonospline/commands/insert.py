"""``sonospline insert``: push a needle into a volume and write the deformed tissue."""

from __future__ import annotations

import argparse
import logging
import platform
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..fields.field import Field
from ..fields.grid_field import GridField
from ..fields.image_warp import ImageWarp
from ..geometry.label_map import LabelMap, looks_like_labels
from ..geometry.layered_block import default_needle, layered_block
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..geometry.volume import Volume
from ..io.canvas import attempt
from ..io.insertion_figure import draw_insertion
from ..io.staging import staged_folder
from ..io.volumes import RAS_TO_LPS, read_volume, suffix_of, write_volume
from ..io.vtk import write_vti
from ..io.writing import write_json
from ..mechanics.tissue_map import TissueMap
from ..models.elastic import ElasticInsertion
from ..models.elastic.strain import SMALL
from ..models.insertion import NeedleInsertion
from ..models.spline.insertion import Insertion
from . import _folds, _limits, _models, _points
from ._progress import track

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

HELP = "push a needle into a 3-D image and write the deformed tissue"
EXAMPLES = """examples:
  sonospline insert --out out                         # on a generated phantom
  sonospline insert --volume ct.nii.gz --entry 60,-20,15 --target 20,10,30 --out out
  sonospline insert --volume us.mha --frame IJK --entry 0,50,50 --target 90,55,50 --out out
  sonospline insert --labels abdomen_labels.nii.gz --model elastic --out out
  sonospline insert --set shaft_displacement=3.5 --steps 40 --json --out out
"""
_MANY_ANCHORS = 2000


@dataclass(frozen=True)
class Outcome:
    """A finished insertion and how long its steps took."""

    insertion: NeedleInsertion
    needle: Needle
    field: Field
    step_ms: list[float]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    where = parser.add_argument_group("where")
    where.add_argument("--volume", type=Path, metavar="FILE", help=".nrrd, .mha or .nii.gz; without it, a phantom")
    where.add_argument(
        "--volume-kind",
        default="auto",
        choices=("auto", "image", "labels"),
        help="image: linear between voxels; labels: the nearest voxel (auto: as it looks, and said)",
    )
    where.add_argument("--entry", metavar="X,Y,Z", help="where the needle enters (mm, or voxels with --frame IJK)")
    where.add_argument("--target", metavar="X,Y,Z", help="where its tip ends")
    where.add_argument("--frame", default="RAS", choices=("RAS", "LPS", "IJK"), help="frame of the points (RAS)")
    where.add_argument("--entry-face", default="auto", metavar="FACE", help="free face, x- to z+ (nearest to entry)")
    how = parser.add_argument_group("how")
    how.add_argument("--steps", type=int, default=20, metavar="N", help="insertion steps (20)")
    how.add_argument("--nodes", type=int, default=150_000, metavar="N", help="grid nodes, about (150000)")
    how.add_argument("--seed", type=int, default=0, help="seed of the phantom's speckle (0)")
    _models.add_arguments(parser)
    what = parser.add_argument_group("what comes out")
    _folds.add_argument(what)
    what.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    what.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    what.add_argument("--quiet", action="store_true", help="no progress bar")
    parser.set_defaults(defaults=vars(parser.parse_args(["--out", "."])))


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _limits.check(args, {"seed": _limits.SEED, "steps": _limits.STEPS, "nodes": _limits.NODES, **_models.LIMITS})
    _points.check(args, "entry", "target")
    _models.check(args, args.defaults)
    if args.volume_kind != "auto" and args.volume is None:
        raise ValueError(f"--volume-kind {args.volume_kind} belongs to --volume; give both or neither")
    suffix = suffix_of(args.volume) if args.volume else ".nrrd"
    tissues = _models.read_tissues(args)
    volume = _volume(args, tissues)
    path = _needle(args, volume)
    insertion = _insertion(args, volume, path, tissues)
    with staged_folder(args.out) as folder:
        outcome = _insert(insertion, path, args)
        images = {f"warped{suffix}": volume}
        if tissues is not None:
            images[f"warped_labels{suffix_of(args.labels)}"] = tissues.labels
        return _write(outcome, images, folder, args)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the summary as a few lines for a person."""
    shape = " x ".join(map(str, summary["grid_shape"]))
    inverse = summary["inverse"]
    lines = [
        f"tissue        {summary['nodes']:,} nodes ({shape}), {summary['entry_face']} free",
        f"needle        {summary['depth_mm']:.1f} mm in {summary['steps']} steps, " + _about_model(summary),
        f"step          {summary['step_ms']['median']:.1f} ms median, {summary['step_ms']['p95']:.1f} ms p95 "
        f"({summary['backend']}, {summary['instruction_set']})",
        f"displacement  {summary['max_displacement_mm']:.2f} mm at most, "
        f"pinned faces drift {summary['boundary_drift_mm']:.3f} mm",
        f"folding       smallest det J {summary['smallest_det_jacobian']:.3f}",
    ]
    lines += _strain_line(summary)
    if summary["volume_kind"] == "labels":
        lines.append("image         a label map: the nearest voxel, no label between two")
    if inverse["unconverged_nodes"]:
        lines.append(f"inverse       NOT found at {inverse['unconverged_nodes']} nodes; the image is unwarped there")
    if "figure.png" in summary["files"]:
        lines.append(f"picture       {args.out / 'figure.png'}")
    return "\n".join(lines)


def _about_model(summary: dict[str, Any]) -> str:
    if summary["model"] != "elastic":
        return f"{summary['landmarks']} landmarks, {summary['anchors']} anchors"
    solver = " x ".join(map(str, summary["solver_shape"]))
    return f"finite elements on {solver} nodes, error estimate {100 * summary['error_estimate']:.1f} %"


def _strain_line(summary: dict[str, Any]) -> list[str]:
    if summary.get("small_strain", True):
        return []
    place = ", ".join(f"{x:.0f}" for x in summary["largest_strain_ras_mm"])
    return [
        f"strain        {summary['largest_strain']:.2f} at ({place}) mm: beyond {SMALL:g}, where the linear theory "
        "is a rough guide"
    ]


def _needle(args: argparse.Namespace, volume: Volume) -> Needle:
    if args.entry is None and args.target is None and args.volume is None:
        return default_needle() if args.labels is None else _anterior_needle(volume)
    for name in ("entry", "target"):
        if getattr(args, name) is None:
            centre = ",".join(f"{x:.0f}" for x in volume.lattice.world(volume.lattice.extent[None] / 2)[0])
            raise ValueError(f"--{name} is missing; give X,Y,Z inside the image, whose centre is {centre} (RAS mm)")
    entry, target = (_world(name, getattr(args, name), args.frame, volume) for name in ("entry", "target"))
    if np.allclose(entry, target, rtol=0, atol=1e-9 * volume.lattice.side):
        raise ValueError(f"--target {args.target} equals --entry; move the target to where the tip should end")
    return Needle(entry, target)


def _anterior_needle(volume: Volume) -> Needle:
    """From the middle of the face that looks most to the front (RAS +y) to the middle of the box."""
    lattice = volume.lattice
    axis = int(np.abs(lattice.direction[1]).argmax())
    middle = lattice.extent / 2
    entry = middle.copy()
    entry[axis] = lattice.extent[axis] if lattice.direction[1, axis] > 0 else 0.0
    return Needle(*lattice.world(np.stack([entry, middle])))


def _world(name: str, text: str, frame: str, volume: Volume) -> Array:
    point = _points.parse(name, text)
    if frame == "IJK":
        return volume.position(point[None])[0]
    return RAS_TO_LPS @ point if frame == "LPS" else point


def _volume(args: argparse.Namespace, tissues: TissueMap | None) -> Volume:
    """The image to deform: the one given, else one that shows the labelled tissue, else the phantom."""
    if args.volume:
        volume = read_volume(args.volume)
        kind = args.volume_kind
        if kind == "auto" and looks_like_labels(volume):
            logger.warning(
                "volume = %r is taken for a label map: its voxels move but are never interpolated "
                "(--volume-kind image takes it for an image)",
                str(args.volume),
            )
            kind = "labels"
        return LabelMap.of(volume, name=f"volume = {str(args.volume)!r}") if kind == "labels" else volume
    return layered_block(args.seed) if tissues is None else tissues.stiffness_image()


def _insertion(args: argparse.Namespace, volume: Volume, path: Needle, tissues: TissueMap | None) -> NeedleInsertion:
    grid = volume.grid(args.nodes)
    face = grid.nearest_face(path.entry) if args.entry_face == "auto" else args.entry_face
    return _models.make(args, Tissue(grid, entry_face=face), tissues)


def _insert(insertion: NeedleInsertion, path: Needle, args: argparse.Namespace) -> Outcome:
    step_ms = []
    steps = insertion.run(path.entry, path.tip, args.steps)
    for _ in track(range(args.steps), args.steps, "inserting", quiet=args.quiet):
        start = time.perf_counter()
        next(steps).on_grid()
        step_ms.append(1e3 * (time.perf_counter() - start))
    if isinstance(insertion, ElasticInsertion):
        insertion.settle()  # the needle rests at its target
    return Outcome(insertion, path, insertion.field, step_ms)


def _write(outcome: Outcome, images: dict[str, Volume], folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Write each image deformed, under its name, and the deformation; the first image is the one to draw."""
    grid = outcome.insertion.tissue.grid
    displacement = outcome.field.on_grid()
    det = np.linalg.det(outcome.field.jacobian(grid.points)).reshape(grid.shape)
    _folds.refuse(det, grid, args)
    # With every face node a landmark, summing at each iterate would take minutes.
    many = isinstance(outcome.insertion, Insertion) and len(outcome.insertion.anchors) > _MANY_ANCHORS
    warp = ImageWarp.of(GridField.of(outcome.field, "accurate") if many else outcome.field)
    deformed = {name: warp.apply(image) for name, image in images.items()}
    for name, image in deformed.items():
        write_volume(image, folder / name)
    warp.save(folder / "displacement.h5")
    write_vti(folder / "displacement.vti", grid, {"displacement": displacement, "det_jacobian": det})
    moved = Volume(
        voxels=np.linalg.norm(warp.displacement, axis=-1),
        spacing=grid.spacing,
        origin=grid.origin,
        direction=grid.direction,
    )
    volume, warped = next(zip(images.values(), deformed.values(), strict=True))
    attempt(lambda: draw_insertion(volume, warped, moved, outcome.needle, folder / "figure.png"))
    summary = {
        "verb": "insert",
        "volume": str(args.volume or args.labels or "phantom"),
        "volume_kind": "labels" if isinstance(volume, LabelMap) else "image",
        "entry_ras_mm": outcome.needle.entry.tolist(),
        "target_ras_mm": outcome.needle.tip.tolist(),
        "depth_mm": outcome.needle.depth,
        "nodes": grid.node_count,
        "grid_shape": grid.shape,
        "grid_spacing_mm": grid.spacing,
        "entry_face": outcome.insertion.tissue.entry_face,
        "model": args.model,
        **_models.facts(outcome.insertion, args),
        "steps": args.steps,
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
