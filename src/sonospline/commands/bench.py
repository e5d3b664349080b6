"""``sonospline bench``: the race against every peer, in one run."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from .. import _core
from ..bench import instruction_sets, live, machine, promises, race_report, suite
from ..io.canvas import attempt
from ..io.staging import staged_folder
from ..io.writing import write_json, write_text
from . import _limits, _options
from ._progress import say

HELP = "time everything against SciPy, VTK, ITK, KeOps, PyTorch and NumPy in one run, or the live simulator"
EXAMPLES = """examples:
  sonospline bench --out bench              # everything, about ten minutes
  sonospline bench --quick --out bench      # 25^3 only, no long peers, half a minute
  sonospline bench --live --out bench       # the simulator's latency: a scripted insertion through its WebSocket
  sonospline bench --isa avx512 --isa avx2 --out bench    # instruction sets against one another, in one run
  sonospline bench --json --out bench | python -m json.tool

Peers are optional: pip install 'sonospline[bench]'. One that is absent is a row that says so.
"""
_LIMITS: _limits.Limits = {
    "threads": _limits.Whole(1, 4096),
    "rounds": _limits.Whole(1, 1000),
    "seconds": _limits.Real(0.1, 86_400),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--threads", type=int, default=2, metavar="N", help="processors to hold the run to (2)")
    parser.add_argument("--rounds", type=int, default=5, metavar="N", help="turns of each contender (5)")
    parser.add_argument("--quick", action="store_true", help="small sizes only: a check, not a measurement")
    parser.add_argument("--live", action="store_true", help="measure the live simulator's latency instead")
    parser.add_argument(
        "--isa",
        action="append",
        metavar="NAME",
        help="race an instruction set at steps, pictures and poses; several",
    )
    parser.add_argument("--scene", default="kidney", metavar="NAME|FILE", help="its scene (kidney)")
    parser.add_argument("--seconds", type=float, default=12.0, metavar="S", help="how long to measure it (12)")
    _options.add_output(parser)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its results."""
    _limits.check(args, _LIMITS)
    if args.isa and (args.live or args.quick):
        raise ValueError(f"--isa goes not with {'--live' if args.live else '--quick'}; leave one out")
    isa = instruction_sets.checked(args.isa or ())
    processors = machine.pin(args.threads)
    if _core.backend() != "core":
        raise RuntimeError("the compiled core is not in use, so there is nothing to race; see sonospline doctor")
    if args.live:
        return _live(args, processors)
    if isa:
        return _race_of_sets(args, isa, processors)
    with staged_folder(args.out, summary="bench.json") as folder:
        measure = _measure_quick if args.quick else _measure
        before = machine.processor_ticks()
        results = {"machine": machine.describe(processors), **measure(args.rounds, say(quiet=args.quiet))}
        results["machine"]["withheld"] = machine.withheld_since(before)
        results["claims"] = [] if args.quick else promises.of_the_race(results)
        write_json(folder / "bench.json", results)
        write_text(folder / "bench.md", race_report.tables(results))
        attempt(lambda: race_report.draw_cost(results, folder / "cost.png"))
    return results


def describe(results: dict[str, Any], args: argparse.Namespace) -> str:
    """Return what a person wants to see first."""
    if args.live:
        return f"{live.report(results)}\n\neverything: {args.out / 'live.json'}"
    if args.isa:
        return f"{instruction_sets.report(results)}\n\neverything: {args.out / 'isa.json'}"
    shown = promises.table_of_promises(results["claims"]) if results["claims"] else race_report.tables(results)
    return f"{shown}\n\neverything: {args.out / 'bench.md'}, its picture: {args.out / 'cost.png'}"


def _live(args: argparse.Namespace, processors: list[int]) -> dict[str, Any]:
    with staged_folder(args.out, summary="live.json") as folder:
        before = machine.processor_ticks()
        results = {"machine": machine.describe(processors), **live.measure(args.scene, args.seconds)}
        results["machine"]["withheld"] = machine.withheld_since(before)
        write_json(folder / "live.json", results)
        write_text(folder / "live.md", live.report(results) + "\n")
    return results


def _race_of_sets(args: argparse.Namespace, names: tuple[str, ...], processors: list[int]) -> dict[str, Any]:
    with staged_folder(args.out, summary="isa.json") as folder:
        before = machine.processor_ticks()
        found = instruction_sets.measure(names, args.rounds, args.seconds, say(quiet=args.quiet))
        results = {"machine": machine.describe(processors), **found}
        results["machine"]["withheld"] = machine.withheld_since(before)
        write_json(folder / "isa.json", results)
        write_text(folder / "isa.md", instruction_sets.report(results) + "\n")
    return results


def _measure(rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    return {
        "whole_step": suite.whole_step((300, 1000), rounds, tell),
        "multilevel_against_direct": suite.multilevel_against_direct(
            ((53, 300), (53, 1000), (216, 1000)), rounds, tell
        ),
        "incremental": suite.incremental((20, 200), rounds, tell),
        "insertion_step": suite.insertion_step(rounds, tell),
        "sampling": suite.sampling(rounds, tell),
        "growth": suite.growth((25, 53, 100, 216, 464), (100, 300, 3000), rounds, tell),
        "all_nodes": suite.all_nodes((25, 48, 53, 100), (100, 300, 1000), rounds, tell),
    }


def _measure_quick(rounds: int, tell: Callable[[str], None]) -> dict[str, Any]:
    return {
        "whole_step": suite.whole_step((100,), rounds, tell, side=25),
        "multilevel_against_direct": suite.multilevel_against_direct(((25, 300),), rounds, tell),
        "incremental": suite.incremental((20,), rounds, tell, count=200),
        "insertion_step": suite.insertion_step(rounds, tell, side=13),
        "sampling": suite.sampling(rounds, tell),
        "growth": suite.growth((25, 31), (100,), rounds, tell, at=25),
        "all_nodes": suite.all_nodes((25,), (100,), rounds, tell),
    }
