"""``sonospline reproduce``: every table and figure of the paper, with the paper's number beside ours."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .._extras import require
from ..bench import machine
from ..fem import fenicsx
from ..geometry.grid import Grid
from ..geometry.layered_block import layered_block
from ..geometry.tissue import Tissue
from ..geometry.volume import Volume
from ..io.canvas import attempt
from ..io.labels import read_labels
from ..io.staging import staged_folder
from ..io.volumes import read_volume
from ..io.writing import write_json, write_text
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.insertion import Insertion
from ..study import front_files, report, specimens, study
from ..study.figure_curves import draw_curves
from ..study.figure_mesh import draw_mesh
from ..study.figure_models import draw_depths, draw_maps
from ..study.figure_slices import Compared, draw_slices
from ..study.insertions import PlannedInsertion, held_out_insertions, tuning_insertions
from ..study.model_fields import elastic
from ..study.notebook import Notebook
from ..study.plan import Plan
from ..study.tuning import ParetoFront
from . import _limits, _options
from ._progress import say

HELP = "regenerate the paper's tables and figures, and compare its claims"
EXAMPLES = """examples:
  sonospline reproduce --quick --out paper     # two meshes, a small search: four minutes
  sonospline reproduce --out paper             # everything, hours; stopped, it goes on where it was
  sonospline reproduce --quick --image liver_ultrasound.mha --out paper
  sonospline reproduce --labels abdomen_labels.nii.gz --out paper     # the models in a patient's anatomy, too
  sonospline reproduce --only models anatomy --out paper     # these now, on a machine that is busy
  sonospline reproduce --only times dense --out paper        # and these when it is quiet
"""
_LOOK = 1000
"""Nodes of a specimen that is only looked at: its labels are refused before the first hour, not after it."""
_PACKAGES = ("sonospline", "numpy", "scipy", "scikit-fem", "pyamg", "pypardiso", "pymoo")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--quick", action="store_true", help="25^3 and 31^3, a small search, scikit-fem only")
    _options.add_seed(parser, "of the search")
    parser.add_argument(
        "--labels", type=Path, metavar="FILE", help="label map to compare the models in, its names in a CSV beside it"
    )
    parser.add_argument(
        "--only", nargs="+", choices=study.PARTS, metavar="PART",
        help="compute and keep these parts, write no report: " + ", ".join(study.PARTS),
    )  # fmt: skip
    parser.add_argument("--image", type=Path, metavar="FILE", help="3-D image shown in Fig. 2 (a generated phantom)")
    _options.add_output(parser)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its results."""
    _limits.check(args, {"seed": _limits.SEED})
    for package in ("skfem", "pyamg", "pymoo"):
        require(package)
    if not args.quick:
        fenicsx.interpreter()  # said now, not after an hour
    image = read_volume(args.image) if args.image else layered_block(args.seed)
    if args.labels:
        elastic(specimens.patient(specimens.name_of(args.labels), read_labels(args.labels), _LOOK), _LOOK)
    plan = (Plan.quick if args.quick else Plan.full)(args.seed, args.labels)
    notebook = _notebook(args.out, say(quiet=args.quiet))  # before the staging: it stays where a run fails
    if args.only:
        study.run_study(plan, notebook, args.only)
        return {"verb": "reproduce", "about": _about(plan), "parts": args.only}
    with staged_folder(args.out, summary="results.json") as folder:
        results = study.run_study(plan, notebook)
        _draw(plan, results, image, folder)
        about = _about(plan)
        write_text(folder / "report.md", report.write(results, about))
        files = sorted([*(file.name for file in folder.iterdir()), "results.json"])
        summary = {"verb": "reproduce", "about": about, **results, "files": files}
        write_json(folder / "results.json", summary)
    return summary


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what a person wants to see first."""
    if args.only:
        return f"kept     {', '.join(args.only)}, in {args.out / 'parts'}; a run without --only writes the report"
    mean = summary["target"]["tuned"]["held_out"]["mean"]
    row = summary["times"][-1]
    ratios = ", ".join(
        f"{row[f'{solver}_ms'] / row['ours_ms']:,.0f} ({name})"
        for name, solver in zip(report.BASELINE_NAMES, report.BASELINES, strict=True)
    )
    return (
        f"held-out insertions at {summary['tuning']['side']}^3: MAE {mean['mae']:.2e}, "
        f"{mean['relative']:.0%} of the mean displacement\n"
        f"{row['side']}^3: {row['ours_ms']:.2f} ms a step, times faster than FEM: {ratios}\n\n"
        f"report   {args.out / 'report.md'}"
    )


def _notebook(out: Path, tell: Callable[[str], None]) -> Notebook:
    try:
        return Notebook(out / "parts", tell)
    except OSError as error:
        raise ValueError(f"--out {str(out)!r} cannot be written ({error.strerror}); choose another folder") from None


def _draw(plan: Plan, results: dict[str, Any], image: Volume, folder: Path) -> None:
    model = NeedleTissueModel(**results["tuning"]["parameters"])
    tissue = Tissue(Grid.unit_cube(plan.sides[0]))
    straight, oblique = tuning_insertions()[0], held_out_insertions()[0]
    attempt(lambda: draw_mesh(tissue, straight.on(tissue), NeedleTissueModel.paper(), folder / "figure_1.png"))
    compared = (_compared(plan, straight, model, tissue), _compared(plan, oblique, model, tissue))
    attempt(lambda: draw_slices(*compared, image, folder / "figure_2.png"))
    curves = study.mean_rows([row for row in results["errors"] if row["model"] == "tuned"], "side", "depth")
    attempt(lambda: draw_curves(curves, results["times"], folder / "figure_3.png"))
    attempt(lambda: draw_maps(results["models"]["maps"], folder / "models_maps.png"))
    attempt(lambda: draw_maps(results["anatomy"]["maps"], folder / "models_anatomy.png"))
    attempt(lambda: draw_depths(results["models"]["friction"], folder / "models_depth.png"))
    objectives = np.array(results["tuning"]["front"])
    front = ParetoFront(np.zeros((len(objectives), 7)), objectives)
    attempt(lambda: front_files.draw(front, tuple(plan.name for plan in tuning_insertions()), folder / "front.png"))


def _compared(plan: Plan, insertion: PlannedInsertion, model: NeedleTissueModel, tissue: Tissue) -> Compared:
    reference = study.reference_of(plan, insertion, plan.sides[0]).last
    needle = reference.needle(0)
    return Compared(tissue.grid, needle, Insertion(tissue, model).advance(needle), reference.displacements[0])


def _about(plan: Plan) -> dict[str, Any]:
    versions = {name: machine.version_of(name) for name in _PACKAGES}
    if "fenicsx" in plan.timed.values():
        versions["DOLFINx"] = fenicsx.version()
    return {
        "date": time.strftime("%Y-%m-%d"),
        "seed": plan.seed,
        "machine": machine.describe([]),
        "versions": versions,
    }
