"""``sonospline tune``: find the parameters whose field is nearest to finite elements."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .._extras import require
from ..geometry.grid import Grid
from ..geometry.tissue import Tissue
from ..io.canvas import attempt
from ..io.staging import staged_folder
from ..io.writing import write_json, write_text
from ..mechanics.interaction import NeedleTissueModel
from ..study import front_files
from ..study.insertions import PlannedInsertion, held_out_insertions, tuning_insertions
from ..study.objective import TUNABLES, Objective, errors_at_target
from ..study.parallel import dask_executor, usable_processors
from ..study.reference import Reference
from ..study.tuning import GENERATIONS, POPULATION, ParetoFront, search
from . import _limits, _options, _parameters, _tune_forces
from ._progress import bar, track

HELP = "tune the model's parameters to finite elements with NSGA-II, or what tissues resist to measured forces"
EXAMPLES = """examples:
  sonospline tune --out tuned                      # three insertions at 25^3, a few minutes
  sonospline insert --parameters tuned/parameters.toml --out out
  sonospline tune --side 13 --population 8 --generations 5 --json --out tuned
  sonospline tune --forces slow.csv fast.csv --out fitted      # friction, cutting and rupture force of tissues
  sonospline tune --dask tcp://10.0.0.1:8786 --population 96 --generations 100 --out tuned
"""
_LIMITS: _limits.Limits = {
    "side": _limits.Whole(5, 2000, bytes_each=10_000, power=3),
    "steps": _limits.Whole(1, 1000),
    "population": _limits.Whole(2, 100_000),
    "generations": _limits.Whole(1, 1_000_000),
    "seed": _limits.SEED,
    "workers": _limits.Whole(1, max(64, 8 * usable_processors())),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    what = parser.add_argument_group("what is compared")
    what.add_argument("--side", type=int, default=25, metavar="N", help="nodes along each side of the cube (25)")
    what.add_argument(
        "--steps", type=int, default=2, metavar="N", help="equal steps whose errors count (2: half and full depth)"
    )
    forces = parser.add_argument_group("or: what tissues resist, from measured forces")
    forces.add_argument(
        "--forces", nargs="+", type=Path, metavar="CURVE",
        help="CSV of depth_mm, force_n and, where they are known, tissue (at that depth, undeformed) and speed_mm_s",
    )  # fmt: skip
    forces.add_argument("--materials", type=Path, metavar="FILE", help="TOML of what else the tissues are (assumed)")
    how = parser.add_argument_group("how it is searched")
    how.add_argument(
        "--population", type=int, default=POPULATION, metavar="N", help=f"designs a generation ({POPULATION})"
    )
    how.add_argument("--generations", type=int, default=GENERATIONS, metavar="N", help=f"generations ({GENERATIONS})")
    _options.add_seed(how, "of the search")
    how.add_argument("--workers", type=int, metavar="N", help="processes (one a processor)")
    how.add_argument("--dask", metavar="ADDRESS", help="run on the Dask cluster of this scheduler instead")
    _options.add_output(parser.add_argument_group("what comes out"))


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its summary."""
    _limits.check(args, _LIMITS)
    if args.forces:
        return _tune_forces.run(args)
    workers = args.workers or usable_processors()
    require("pymoo")
    tissue = Tissue(Grid.unit_cube(args.side))
    with staged_folder(args.out) as folder, _executor(args.dask, workers) as (executor, parts):
        tuning = _references("reference, to tune on", tuning_insertions(), tissue, args)
        start = time.perf_counter()
        with bar("searching", quiet=args.quiet) as progress:
            front = search(
                Objective(tuning),
                population=args.population,
                generations=args.generations,
                seed=args.seed,
                workers=parts,
                executor=executor,
                progress=progress,
            )
        seconds = time.perf_counter() - start
        held_out = _references("reference, held out", held_out_insertions(), tissue, args)
        summary = _summary(front, tuning, held_out, args) | {"search_seconds": seconds}
        return _write(front, summary, folder)


def describe(summary: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what a person wants to see first."""
    if args.forces:
        return _tune_forces.describe(summary, args)
    lines = [
        f"front         {len(summary['front'])} designs of {summary['evaluations']}, "
        f"{summary['search_seconds']:.0f} s, seed {summary['seed']}",
        f"{'chosen':14s}" + ", ".join(f"{t.symbol} {summary['parameters'][t.name]:.4f}" for t in TUNABLES),
        "",
        f"{'at the target, ' + str(summary['side']) + '^3':26s}{'MAE':>10s}{'RMSE':>10s}{'rel':>7s}{'at tip':>10s}",
    ]
    for model, label in (("tuned", "tuned"), ("table_1", "Table I")):
        for group, which in (("tuning", "tuned on"), ("held_out", "held out")):
            mean = summary["errors"][model][group]["mean"]
            lines.append(
                f"{label + ', ' + which:26s}{mean['mae']:10.2e}{mean['rmse']:10.2e}"
                f"{mean['relative']:7.3f}{mean['at_tip']:10.2e}"
            )
    nothing = summary["errors"]["tuned"]["held_out"]["mean"]
    lines.append(f"{'doing nothing, held out':26s}{nothing['zero_mae']:10.2e}{nothing['zero_rmse']:10.2e}{1:7.3f}")
    return "\n".join([*lines, "", f"parameters    {args.out / 'parameters.toml'}"])


@contextmanager
def _executor(address: str | None, workers: int) -> Iterator[tuple[Executor | None, int]]:
    if address is None:
        yield None, workers
        return
    with dask_executor(address) as found:
        yield found


def _references(
    label: str, plans: tuple[PlannedInsertion, ...], tissue: Tissue, args: argparse.Namespace
) -> tuple[Reference, ...]:
    followed = track(plans, len(plans), label, quiet=args.quiet)
    return tuple(Reference.solve(plan, tissue, steps=args.steps) for plan in followed)


def _summary(
    front: ParetoFront, tuning: tuple[Reference, ...], held_out: tuple[Reference, ...], args: argparse.Namespace
) -> dict[str, Any]:
    names = tuple(reference.plan.name for reference in tuning)
    groups = {"tuning": tuning, "held_out": held_out}
    models = {"tuned": front.model(), "table_1": NeedleTissueModel.paper()}
    return {
        "verb": "tune",
        "side": args.side,
        "steps": args.steps,
        "population": args.population,
        "generations": args.generations,
        "evaluations": args.population * args.generations,
        "seed": args.seed,
        "unit": "side",
        "parameters": asdict(front.model()),
        "at_a_bound": _at_a_bound(front),
        "errors": {
            model: {
                group: {name: asdict(errors) for name, errors in errors_at_target(references, parameters).items()}
                for group, references in groups.items()
            }
            for model, parameters in models.items()
        },
        "front": front_files.rows(front, names),
    }


def _at_a_bound(front: ParetoFront) -> list[str]:
    """Parameters whose best value lies at the end of its range, where a better one may lie beyond."""
    return [
        tunable.name
        for tunable, value in zip(TUNABLES, front.designs[front.chosen], strict=True)
        if min(value - tunable.low, tunable.high - value) < 0.01 * (tunable.high - tunable.low)
    ]


def _write(front: ParetoFront, summary: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Write the files of a run; return the summary with their names."""
    names = tuple(name for name in summary["errors"]["tuned"]["tuning"] if name != "mean")
    front_files.write_csv(front, names, folder / "front.csv")
    attempt(lambda: front_files.draw(front, names, folder / "front.png"))
    mean = summary["errors"]["tuned"]["held_out"]["mean"]
    remarks = [
        f"sonospline tune: side {summary['side']}, steps {summary['steps']}, population {summary['population']}, "
        f"generations {summary['generations']}, seed {summary['seed']}",
        f"held-out insertions: MAE {mean['mae']:.3e} sides, {mean['relative']:.3f} of the mean displacement",
    ]
    write_text(folder / "parameters.toml", _parameters.text(front.model(), remarks))
    summary = summary | {"files": sorted([*(file.name for file in folder.iterdir()), "summary.json"])}
    write_json(folder / "summary.json", summary)
    return summary
