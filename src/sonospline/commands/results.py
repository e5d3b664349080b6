"""``sonospline results``: what a skills lab has kept: where participants stand, learning curves, tables."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..io.staging import staged_folder
from ..lab.cusum import Cusum
from ..lab.result_store import ResultStore
from ..lab.result_tables import write_tables

HELP = "show and export what a skills lab has kept: standings, learning curves, tables"
EXAMPLES = """examples:
  sonospline results course.db                                     # where everybody stands
  sonospline results course.db --add K-17 K-18 --group Tuesday     # participants, by codes: no names are kept
  sonospline results course.db --curve K-17 "Vessel, in plane"     # a learning curve (CUSUM)
  sonospline results course.db --export tables                     # attempts.csv and attempts.parquet, every metric
  sonospline results postgresql+pg8000://lab@localhost/course --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("database", metavar="FILE|ADDRESS", help="a file of SQLite, or an address of PostgreSQL")
    parser.add_argument("--add", nargs="+", metavar="CODE", help="add participants; makes the file where there is none")
    parser.add_argument("--group", metavar="NAME", help="of those who are added, or whose standings are shown")
    parser.add_argument("--curve", nargs=2, metavar=("CODE", "EXERCISE"), help="show a learning curve")
    parser.add_argument(
        "--rates", nargs=2, type=float, metavar=("P0", "P1"), default=(0.10, 0.25),
        help="shares of failures that are and are not acceptable (0.10 0.25)",
    )  # fmt: skip
    parser.add_argument("--export", type=Path, metavar="DIR", help="folder to write every attempt to, as tables")
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its report."""
    test = Cusum(*args.rates)
    if "://" not in args.database and not args.add and not Path(args.database).exists():
        raise ValueError(f"database = {args.database!r}: there is no such file; --add CODE makes it")
    with ResultStore(args.database) as store:
        store.add_participants(args.add or (), group=args.group)
        report: dict[str, Any] = {"database": store.name}
        report["participants"] = [{"code": code, "group": group} for code, group in store.participants()]
        report["standings"] = [
            one._asdict() | {"last": one.last.isoformat(timespec="seconds")}
            for one in store.standings(group=args.group)
        ]
        if args.curve:
            curve = store.curve(*args.curve, test=test)
            report["curve"] = {
                "participant": args.curve[0], "exercise": args.curve[1], "sums": curve.sums.tolist(),
                "upper": test.upper, "lower": test.lower, "decision": curve.decision,
                "decisions": [{"attempt": attempt, "decision": said} for attempt, said in curve.decisions],
            }  # fmt: skip
        if args.export:
            attempts = list(store.attempts())
            with staged_folder(args.export) as folder:
                report["files"] = list(write_tables(attempts, folder))
    return report


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the report as a few lines for a person."""
    lines = [f"{len(report['participants'])} participants in {report['database']}"]
    if report["standings"]:
        lines.append(f"  {'code':16} {'exercise':32} {'passed':>9} {'error':>9} {'blind':>9}  last")
    lines += [
        f"  {one['participant']:16} {one['exercise'][:32]:32} {one['passed']:3} of {one['attempts']:<2}"
        f" {_mm(one['final_error_mm'])} {_mm(one['blind_advance_mm'])}  {'passed' if one['last_passed'] else 'not yet'}"
        for one in report["standings"]
    ]
    if "curve" in report:
        lines += _curve(report["curve"])
    if "files" in report:
        lines.append(f"{', '.join(report['files'])} in {args.export}")
    return "\n".join(lines)


def _mm(value: float | None) -> str:
    return f"{'-':>9}" if value is None else f"{value:6.1f} mm"


def _curve(curve: dict[str, Any]) -> list[str]:
    """A line for each attempt: how far the curve is between the line below and the line above."""
    lines = [f"{curve['participant']} at {curve['exercise']}: {curve['decision']}; CUSUM, attempt by attempt:"]
    said = {one["attempt"]: f"  {one['decision']}" for one in curve["decisions"]}
    low, high = min([curve["lower"], *curve["sums"]]), max([curve["upper"], *curve["sums"]])
    for attempt, at in enumerate(curve["sums"], 1):
        bar = " " * round(40 * (at - low) / (high - low)) + "o"
        lines.append(f"  {attempt:4} {at:7.2f} {bar:41}{said.get(attempt, '')}".rstrip())
    return lines
