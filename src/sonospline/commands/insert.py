"""``sonospline insert``: push a needle into a volume and write the deformed tissue."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from ..fields.strain import SMALL
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..geometry.volume import Volume
from ..io.staging import staged_folder
from ..io.volumes import suffix_of
from ..mechanics.tissue_map import TissueMap
from ..models.insertion import NeedleInsertion
from . import _folds, _limits, _models, _options, _points
from ._insert_place import image, needle_path
from ._insert_results import Outcome, write
from ._progress import track

HELP = "push a needle into a 3-D image and write the deformed tissue"
EXAMPLES = """examples:
  sonospline insert --out out                         # on a generated phantom
  sonospline insert --volume ct.nii.gz --entry 60,-20,15 --target 20,10,30 --out out
  sonospline insert --volume us.mha --frame IJK --entry 0,50,50 --target 90,55,50 --out out
  sonospline insert --labels abdomen_labels.nii.gz --model elastic --out out
  sonospline insert --set shaft_displacement=3.5 --steps 40 --json --out out
"""


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
    _options.add_path(where, "mm, or voxels with --frame IJK")
    where.add_argument("--frame", default="RAS", choices=("RAS", "LPS", "IJK"), help="frame of the points (RAS)")
    where.add_argument("--entry-face", default="auto", metavar="FACE", help="free face, x- to z+ (nearest to entry)")
    how = parser.add_argument_group("how")
    how.add_argument("--steps", type=int, default=20, metavar="N", help="insertion steps (20)")
    _options.add_nodes(how)
    _options.add_seed(how, "of the phantom's speckle")
    _models.add_arguments(parser)
    what = parser.add_argument_group("what comes out")
    _folds.add_argument(what)
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
    insertion = _insertion(args, volume, path, tissues)
    with staged_folder(args.out) as folder:
        outcome = _insert(insertion, path, args)
        images = {f"warped{suffix}": volume}
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
    if "solver_shape" in summary:
        solver = " x ".join(map(str, summary["solver_shape"]))
        return f"finite elements on {solver} nodes, error estimate {100 * summary['error_estimate']:.2g} %"
    if "landmarks" in summary:
        return f"{summary['landmarks']} landmarks, {summary['anchors']} anchors"
    return f"model {summary['model']}"


def _strain_line(summary: dict[str, Any]) -> list[str]:
    if summary.get("small_strain", True):
        return []
    place = ", ".join(f"{x:.0f}" for x in summary["largest_strain_ras_mm"])
    return [
        f"strain        {summary['largest_strain']:.2f} at ({place}) mm: beyond {SMALL:g}, where the linear theory "
        "is a rough guide"
    ]


def _insertion(args: argparse.Namespace, volume: Volume, path: Needle, tissues: TissueMap | None) -> NeedleInsertion:
    grid = volume.grid(args.nodes)
    face = grid.nearest_face(path.entry) if args.entry_face == "auto" else args.entry_face
    return NeedleInsertion(_models.make(args, Tissue(grid, entry_face=face), tissues))


def _insert(insertion: NeedleInsertion, path: Needle, args: argparse.Namespace) -> Outcome:
    step_ms = []
    steps = insertion.run(path.entry, path.tip, args.steps)
    for _ in track(range(args.steps), args.steps, "inserting", quiet=args.quiet):
        start = time.perf_counter()
        next(steps).on_grid()
        step_ms.append(1e3 * (time.perf_counter() - start))
    insertion.settle()  # the needle rests at its target
    return Outcome(insertion, path, insertion.field, step_ms)
