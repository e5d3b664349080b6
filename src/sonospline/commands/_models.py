"""The models of tissue a verb can choose from: what each is made of, and what to say of it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from .. import _validate
from ..geometry.tissue import Tissue
from ..mechanics.line_force import LineForce
from ..mechanics.material import Material
from ..mechanics.tissue_map import TissueMap
from ..models.elastic import ElasticInsertion
from ..models.insertion import NeedleInsertion
from ..models.kelvinlet import DragModel, KelvinletInsertion
from ..models.spline.insertion import Insertion
from ..models.spline.interaction import NeedleTissueModel
from ..models.spline.kernels import Biharmonic, Triharmonic
from . import _limits, _parameters
from ._progress import bar

MODELS = ("paper", "kelvinlet", "elastic")
KERNELS = {"biharmonic": Biharmonic, "triharmonic": Triharmonic}

LIMITS: _limits.Limits = {
    "max_landmarks": _limits.Whole(1, 1_000_000, bytes_each=16, power=2),
    "solver_nodes": _limits.Whole(8, 10**10, bytes_each=500),
    "smoothing": _limits.Real(0, 1e9),
    "drag": _limits.Real(0, 1e4),
    "stiffness": _limits.Real(0, 1e9),
    "poisson": _limits.Real(-1, 0.5),
}
"""Of their numbers; where a model itself is stricter, it says so."""

_ONLY = {
    "paper": ("parameters", "set", "kernel", "smoothing", "anchors", "max_landmarks", "accumulation"),
    "kelvinlet": ("drag",),
    "elastic": ("labels", "label_names", "materials", "stiffness", "solver_nodes"),
}
"""Options that mean something to one model only."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the models."""
    how = parser.add_argument_group("model")
    how.add_argument("--model", default="paper", choices=MODELS, help="tissue model (paper)")
    paper = parser.add_argument_group("--model paper")
    paper.add_argument("--parameters", type=Path, metavar="FILE", help="model parameters, TOML (Table I)")
    paper.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one model parameter, mm")
    paper.add_argument("--kernel", default="biharmonic", choices=tuple(KERNELS), help="spline kernel (biharmonic)")
    paper.add_argument("--smoothing", type=float, default=0.0, metavar="S", help="0 meets every landmark (0)")
    paper.add_argument("--anchors", default="5", metavar="N|all", help="anchors a face side, or every face node (5)")
    paper.add_argument("--max-landmarks", type=int, default=300, metavar="N", help="most landmarks (300)")
    paper.add_argument(
        "--accumulation",
        default="maximum",
        choices=("maximum", "incremental"),
        help="map from the reference, or Algorithm 1's moving mesh (maximum)",
    )
    drag = parser.add_argument_group("--model kelvinlet")
    drag.add_argument("--drag", type=float, metavar="MM", help="displacement at the shaft (0.028 of the side)")
    elastic = parser.add_argument_group("--model elastic")
    elastic.add_argument("--labels", type=Path, metavar="FILE", help="label image of the tissues")
    elastic.add_argument("--label-names", type=Path, metavar="CSV", help="their names (beside the image, .csv)")
    elastic.add_argument("--materials", type=Path, metavar="TOML", help="their materials (assumed ones)")
    elastic.add_argument("--stiffness", type=float, default=10.0, metavar="KPA", help="without labels (10)")
    elastic.add_argument("--solver-nodes", type=int, default=25**3, metavar="N", help="solver grid, about (15625)")
    both = parser.add_argument_group("--model kelvinlet and elastic")
    both.add_argument(
        "--poisson", type=float, default=0.45, metavar="NU", help="Poisson's ratio, without labels (0.45)"
    )


def check(args: argparse.Namespace, parser_defaults: dict[str, Any]) -> None:
    """Raise ValueError where an option is given that means nothing to the chosen model."""
    for model, names in _ONLY.items():
        for name in names:
            if model != args.model and getattr(args, name) != parser_defaults[name]:
                option = "--" + name.replace("_", "-")
                raise ValueError(f"{option} belongs to --model {model}, not to --model {args.model}; leave one out")


def read_tissues(args: argparse.Namespace) -> TissueMap | None:
    """Return the labelled tissue that was asked for, if any."""
    if args.labels is None:
        return None
    return TissueMap.read(args.labels, names=args.label_names, materials=args.materials)


def make(args: argparse.Namespace, tissue: Tissue, tissues: TissueMap | None) -> NeedleInsertion:
    """Return the insertion of the chosen model."""
    if args.model == "elastic":
        return _elastic(args, tissue, tissues)
    if args.model == "kelvinlet":
        drag = None if args.drag is None else _validate.number("--drag", args.drag)
        return KelvinletInsertion(tissue, DragModel.kelvinlet(tissue.grid.side, drag=drag, poissons_ratio=args.poisson))
    return _paper(args, tissue)


def facts(insertion: NeedleInsertion, args: argparse.Namespace) -> dict[str, Any]:
    """Return what a summary says of the model."""
    if isinstance(insertion, ElasticInsertion):
        strain, moduli = insertion.largest_strain(), insertion.solver.moduli
        return {
            "solver_shape": insertion.solver.grid.shape,
            "young_kpa": _young_range(moduli.lame, moduli.shear),
            "error_estimate": insertion.solution.error,
            "largest_strain": strain.largest,
            "largest_strain_ras_mm": strain.place.tolist(),
            "small_strain": strain.small,
        }
    if isinstance(insertion, KelvinletInsertion):
        return {
            "landmarks": insertion.landmark_count,
            "anchors": len(insertion.anchors),
            "model_mm": asdict(insertion.model),
        }
    assert isinstance(insertion, Insertion)
    return {
        "landmarks": insertion.landmark_count,
        "anchors": len(insertion.anchors),
        "accumulation": args.accumulation,
        "kernel": args.kernel,
        "model_mm": asdict(insertion.model),
    }


def _paper(args: argparse.Namespace, tissue: Tissue) -> Insertion:
    preset = NeedleTissueModel.paper_incremental if args.accumulation == "incremental" else NeedleTissueModel.paper
    model = _parameters.apply(preset(tissue.grid.side), args.parameters, args.set, tissue.grid.side)
    anchors = _anchors(args.anchors)
    with bar("factoring the faces", quiet=args.quiet or anchors != "all") as progress:
        return Insertion(
            tissue,
            model,
            kernel=KERNELS[args.kernel](),
            anchors=anchors,
            max_landmarks=args.max_landmarks,
            smoothing=args.smoothing,
            accumulation=args.accumulation,
            progress=progress,
        )


def _elastic(args: argparse.Namespace, tissue: Tissue, tissues: TissueMap | None) -> ElasticInsertion:
    if tissues is not None:
        return ElasticInsertion(tissue, tissues, nodes=args.solver_nodes)
    material = Material(args.stiffness, args.poisson)
    width = LineForce().width * tissue.grid.side
    load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=width)
    return ElasticInsertion(tissue, material, load, nodes=args.solver_nodes)


def _young_range(lame: Any, shear: Any) -> list[float]:
    young = shear * (3 * lame + 2 * shear) / (lame + shear)
    return [float(young.min()), float(young.max())]


def _anchors(text: str) -> int | Literal["all"]:
    if text == "all":
        return "all"
    try:
        count = int(text)
    except ValueError:
        raise ValueError(f"--anchors {text[:40]!r} is not a number; give anchors along a face side, or all") from None
    return _validate.count("--anchors", count, least=2, most=1000)
