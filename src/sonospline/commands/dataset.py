"""``sonospline dataset``: insertions with all that is true of them, as many as are asked for."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..dataset.checking import check
from ..dataset.factory import make_dataset
from ..dataset.layout import receipt_name
from ..dataset.reader import DataSet
from ..dataset.rebuilding import rebuild
from ..dataset.specification import Specification
from ..dataset.table_statistics import statistics
from . import _limits
from ._dataset_shown import lines_of
from ._progress import bar, say
from ._rate import rate

HELP = "make and read data sets: images of needle insertions with labels, displacement, poses and forces"
EXAMPLES = """examples:
  sonospline dataset make needles.toml --out needles                 # here; again after a kill: what is missing
  sonospline dataset make needles.toml --out needles --workers 8     # processes of this machine, by Dask
  sonospline dataset make needles.toml --out s3://bucket/needles --scheduler tcp://10.0.0.1:8786
  sonospline dataset show needles
  sonospline dataset check needles --remake 20                       # every hash, and 20 samples made again
  sonospline dataset stats needles --json
  sonospline dataset rebuild recipes --out full --form webdataset    # from recipes, bit for bit
  sonospline dataset episodes needle-steering --out steered          # of a hand, in the form of LeRobot v3
"""
_MOST_WORKERS = 4096
_ENVIRONMENTS = ("needle-steering", "probe-navigation")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's actions and their options."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    make = _action(actions, "make", "make a data set, or what is missing of it")
    make.add_argument("specification", type=Path, metavar="SPEC.toml", help="what it holds")
    _add_making(make)
    show = _action(actions, "show", "say what is in a data set")
    check_ = _action(actions, "check", "check every file against its hash")
    check_.add_argument("--remake", type=int, default=0, metavar="N", help="samples to make again, bit for bit (0)")
    check_.add_argument("--seed", type=int, default=0, help="of which samples those are (0)")
    check_.add_argument("--repair", action="store_true", help="forget damaged shards, so that make makes them again")
    stats = _action(actions, "stats", "say what its numbers are like")
    again = _action(actions, "rebuild", "make its samples again from their recipes")
    episodes = _action(actions, "episodes", "write episodes of a hand in the form of LeRobot v3, video lossy")
    episodes.add_argument("environment", choices=_ENVIRONMENTS, help="what it does")
    episodes.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new folder")
    episodes.add_argument("--episodes", type=int, default=100, metavar="N", help="how many (100)")
    episodes.add_argument("--seed", type=int, default=0, help="of the first; each has its own (0)")
    episodes.add_argument("--hand", choices=("scripted", "random"), default="scripted", help="what acts (scripted)")
    episodes.add_argument("--licence", default="unknown", help="under which they are handed on (unknown)")
    for one in (show, check_, stats, again):
        one.add_argument("dataset", metavar="DIR|ADDRESS", help="a folder, or an address such as s3://bucket/folder")
    for one in (check_, again):
        one.add_argument("--files", type=Path, metavar="DIR", help="where the files of its specification are seen from")
    again.add_argument("--form", choices=("zarr", "webdataset"), default="zarr", help="how they are stored (zarr)")
    _add_making(again)


def _action(actions: Any, name: str, help: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=help, description=help.capitalize() + ".")
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout")
    parser.add_argument("--quiet", action="store_true", help="say nothing meanwhile")
    return parser


def _add_making(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", required=True, metavar="DIR|ADDRESS", help="a folder, or an address of fsspec")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes of this machine (1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler, whose workers make it")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the action; return its report."""
    return {
        "make": _make, "show": _show, "check": _check, "stats": _stats, "rebuild": _rebuild, "episodes": _episodes
    }[args.action](args)  # fmt: skip


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the report as a few lines for a person."""
    return lines_of(report, args.action)


def _make(args: argparse.Namespace) -> dict[str, Any]:
    _check_making(args)
    asked = Specification.read(args.specification)
    with rate("making", quiet=args.quiet) as progress:
        made = make_dataset(asked, args.out, **_settings(args), progress=progress)
    return _report(made, args.out)


def _rebuild(args: argparse.Namespace) -> dict[str, Any]:
    _check_making(args)
    data = DataSet(args.dataset)
    with rate("making again", quiet=args.quiet) as progress:
        made = rebuild(data, args.out, form=args.form, folder=args.files, **_settings(args), progress=progress)
    return _report(made, args.out)


def _check_making(args: argparse.Namespace) -> None:
    _limits.check(args, {"workers": _limits.Whole(1, _MOST_WORKERS)})
    if args.scheduler is not None and args.workers != 1:
        raise ValueError("--workers are processes of this machine; leave it out with --scheduler, which has its own")


def _settings(args: argparse.Namespace) -> dict[str, Any]:
    return {"workers": args.workers, "scheduler": args.scheduler, "say": say(quiet=args.quiet)}


def _report(made: Any, out: str) -> dict[str, Any]:
    return {
        "out": out, "samples": made.samples, "made": made.made, "bytes_a_sample": made.bytes_a_sample,
        "hash": made.hash, "failed": {str(index): reason for index, reason in made.failed.items()},
    }  # fmt: skip


def _show(args: argparse.Namespace) -> dict[str, Any]:
    held = DataSet(args.dataset).manifest
    wanted = ("name", "description", "licence", "samples", "splits", "failed", "bytes_a_sample", "arrays", "labels")
    return {name: held[name] for name in (*wanted, "made_by", "hash", "specification")}


def _check(args: argparse.Namespace) -> dict[str, Any]:
    _limits.check(args, {"remake": _limits.Whole(0, 10**6), "seed": _limits.Whole(0, 2**63 - 1)})
    data = DataSet(args.dataset)
    with bar("checking", quiet=args.quiet) as progress:
        found = check(data, remade=args.remake, seed=args.seed, folder=args.files, progress=progress)
    report = {"files": found.files, "remade": found.remade, "problems": found.problems}
    shards = found.damaged if args.repair else []
    for shard in shards:
        data.store.remove(receipt_name(shard))
    if shards:
        report["forgotten"] = shards
    elif found.problems:  # of samples that are made otherwise, too: nothing that is made again mends those
        more = f", and {len(found.problems) - 1} more" if len(found.problems) > 1 else ""
        raise RuntimeError(f"{found.problems[0]}{more}")
    return report


def _stats(args: argparse.Namespace) -> dict[str, Any]:
    return statistics(DataSet(args.dataset))


def _episodes(args: argparse.Namespace) -> dict[str, Any]:
    from .. import envs

    _limits.check(args, {"episodes": _limits.Whole(1, 10**6), "seed": _limits.Whole(0, 2**31)})
    kinds: dict[str, tuple[Any, Any]] = {
        "needle-steering": (envs.NeedleSteering, envs.steer), "probe-navigation": (envs.ProbeNavigation, envs.navigate)
    }  # fmt: skip
    kind, hand = kinds[args.environment]
    seeds, policy = range(args.seed, args.seed + args.episodes), hand if args.hand == "scripted" else envs.at_random
    with rate("playing", quiet=args.quiet, words=("episodes", "not solved")) as progress:
        done = envs.write_lerobot(
            kind(observe="pixels"), policy, args.out, seeds, licence=args.licence, progress=progress
        )  # fmt: skip
    return {"out": str(args.out), **asdict(done)}
