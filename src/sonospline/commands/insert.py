"""``sonospline insert``: push a needle into a volume and write the deformed tissue."""

from __future__ import annotations

import argparse
import logging
import time
from pathlib import Path
from typing import Any

from ..fields.strain import SMALL
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..geometry.volume import Volume
from ..io.staging import staged_folder
from ..io.volumes import suffix_of
from ..mechanics.bone_stop import stopped
from ..mechanics.tissue_map import TissueMap
from ..models.insertion import NEEDLE, NeedleInsertion
from . import _folds, _limits, _models, _options, _points
from ._insert_place import image, needle_path
from ._insert_results import Outcome, write
from ._progress import track

logger = logging.getLogger(__name__)

HELP = "push a needle into a 3-D image and write the deformed tissue"
EXAMPLES = """examples:
  sonospline insert --out out                         # on a generated phantom
  sonospline insert --volume ct.nii.gz --entry 60,-20,15 --target 20,10,30 --out out
  sonospline insert --volume us.mha --frame IJK --entry 0,50,50 --target 90,55,50 --out out
  sonospline insert --labels abdomen_labels.nii.gz --model elastic --out out
  sonospline insert --volume ct.nii.gz --labels organs.seg.nrrd --model elastic --entry plan.mrk.json \
      --target plan.mrk.json --slicer --out out       # out/scene.mrb opens in 3D Slicer
  sonospline insert --set shaft_displacement=3.5 --steps 40 --json --out out
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    where = parser.add_argument_group("where")
    where.add_argument(
        "--volume", type=Path, metavar="FILE", help=".nrrd, .mha, .nii.gz or DICOM; without it, a phantom"
    )
    where.add_argument(
        "--volume-kind",
        default="auto",
        choices=("auto", "image", "labels"),
        help="image: linear between voxels; labels: the nearest voxel (auto: as it looks, and said)",
    )
    _options.add_path(where, "mm, or voxels with --frame IJK")
    where.add_argument("--frame", default="RAS", choices=("RAS", "LPS", "IJK"), help="frame of the points (RAS)")
    where.add_argument("--entry-face", default="auto", metavar="FACE", help="free face, x- to z+ (nearest to entry)")
    how = parser.add_argument_group("how")
    how.add_argument("--steps", type=int, default=20, metavar="N", help="insertion steps (20)")
    _options.add_nodes(how)
    _options.add_seed(how, "of the phantom's speckle")
    _models.add_arguments(parser)
    what = parser.add_argument_group("what comes out")
    what.add_argument("--strict", action="store_true", help="write nothing where bone stops the needle (exit 2)")
    _folds.add_argument(what)
    what.add_argument(
        "--slicer", action="store_true", help="also scene.mrb for 3D Slicer: deformation, images, segments, needle"
    )
    _options.add_output(what)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _limits.check(args, {"seed": _limits.SEED, "steps": _limits.STEPS, "nodes": _limits.NODES, **_models.LIMITS})
    _points.check(args, "entry", "target")
    _models.check(args)
    if args.volume_kind != "auto" and args.volume is None:
        raise ValueError(f"--volume-kind {args.volume_kind} belongs to --volume; give both or neither")
    suffix = suffix_of(args.volume) if args.volume else ".nrrd"
    tissues = _models.read_tissues(args)
    volume = image(args, tissues)
    path = needle_path(args, volume)
    _say_what_stops(path, tissues, args)
    insertion = _insertion(args, volume, path, tissues)
    with staged_folder(args.out) as folder:
        outcome = _insert(insertion, path, args)
        images: dict[str, Volume] = {f"warped{suffix}": volume}
        if tissues is not None:
            images[f"warped_labels{suffix_of(args.labels)}"] = tissues.labels
        return write(outcome, images, folder, args)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the summary as a few lines for a person."""
    shape = " x ".join(map(str, summary["grid_shape"]))
    inverse = summary["inverse"]
    lines = [
        f"tissue        {summary['nodes']:,} nodes ({shape}), {summary['entry_face']} free",
        f"needle        {summary['depth_mm']:.1f} mm in {summary['steps']} steps, " + _about_model(summary),
        *_bone_line(summary),
        f"step          {summary['step_ms']['median']:.1f} ms median, {summary['step_ms']['p95']:.1f} ms p95 "
        f"({summary['backend']}, {summary['instruction_set']})",
        f"displacement  {summary['max_displacement_mm']:.2f} mm at most, "
        f"{_walls(summary)} {summary['boundary_drift_mm']:.3f} mm",
        f"folding       smallest det J {summary['smallest_det_jacobian']:.3f}",
    ]
    lines += _strain_line(summary)
    if summary["volume_kind"] == "labels":
        lines.append("image         a label map: the nearest voxel, no label between two")
    if inverse["unconverged_nodes"]:
        lines.append(f"inverse       NOT found at {inverse['unconverged_nodes']} nodes; the image is unwarped there")
    if args.slicer:
        lines.append(f"3D Slicer     {args.out / 'scene.mrb'}")
    if "figure.png" in summary["files"]:
        lines.append(f"picture       {args.out / 'figure.png'}")
    return "\n".join(lines)


def _walls(summary: dict[str, Any]) -> str:
    return "walls give way by" if summary.get("walls") == "continued" else "pinned faces drift"


def _about_model(summary: dict[str, Any]) -> str:
    if "solver_shape" in summary:
        solver = " x ".join(map(str, summary["solver_shape"]))
        grid, tip = summary["grid_error"], summary["grid_error_at_tip"]
        cells = "unknown" if grid is None else f"{100 * grid:.2g} %, at the tip {100 * tip:.2g} %"
        width, asked = summary["load_width_mm"], summary["load_width_asked_mm"]
        wide = f", load widened from {asked:.2g} to {width:.2g} mm by the cells" if width > asked else ""
        return (
            f"finite elements on {solver} nodes, error estimate {100 * summary['error_estimate']:.2g} %, "
            f"of the cells {cells}{wide}"
        )
    if "landmarks" in summary:
        return f"{summary['landmarks']} landmarks, {summary['anchors']} anchors"
    return f"model {summary['model']}"


def _bone_line(summary: dict[str, Any]) -> list[str]:
    blocked = summary["blocked"]
    return [] if blocked is None else [f"bone          {blocked['by']} stops the needle before its target"]


def _strain_line(summary: dict[str, Any]) -> list[str]:
    if summary.get("small_strain", True):
        return []
    place = ", ".join(f"{x:.0f}" for x in summary["largest_strain_ras_mm"])
    mean, peak = ("{:.0%} to {:.0%}".format(*share) for share in summary["theory_error"].values())
    return [
        f"strain        {summary['largest_strain']:.2f} at ({place}) mm, beyond {SMALL:g}: linear theory is off by "
        f"some {mean} of the mean displacement, {peak} of the largest, the more the more tissue stiffens"
    ]


def _insertion(args: argparse.Namespace, volume: Volume, path: Needle, tissues: TissueMap | None) -> NeedleInsertion:
    grid = volume.grid(args.nodes)
    face = grid.nearest_face(path.entry) if args.entry_face == "auto" else args.entry_face
    return NeedleInsertion(_models.make(args, Tissue(grid, entry_face=face), tissues))


def _say_what_stops(path: Needle, tissues: TissueMap | None, args: argparse.Namespace) -> None:
    """Say that bone will stop the needle; refuse one that starts in it, or any that is stopped where that was asked."""
    _, events = stopped({NEEDLE: path}, tissues)
    for event in events:
        stops = f"bone stops the needle: {event.by} after {event.depth_mm:.1f} of {path.depth:.1f} mm"
        if args.strict:
            raise ValueError(f"--strict: {stops}; choose a path beside it")
        logger.warning("%s", stops)


def _insert(insertion: NeedleInsertion, path: Needle, args: argparse.Namespace) -> Outcome:
    step_ms = []
    steps = insertion.run(path.entry, path.tip, args.steps)
    start = time.perf_counter()
    for field in track(steps, args.steps, "inserting", quiet=args.quiet):
        field.on_grid()
        step_ms.append(1e3 * (time.perf_counter() - start))
        start = time.perf_counter()
    bone = insertion.response.blocked.get(NEEDLE)
    needle = insertion.needle if bone and insertion.needle else path
    insertion.settle()  # a loose fragment may move on before the tip, which stays
    return Outcome(insertion, path, needle, bone, insertion.field, step_ms)
