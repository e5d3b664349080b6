"""``sonospline record``: write down a session without a page, driven by a table of poses or by a scripted hand."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..io.pose_table import PoseRow, read_poses
from ..lab.attempt_record import AttemptRecord
from ..lab.result_store import ResultStore
from ..simulator.scene import Scene
from ..simulator.scene_maker import make_scene
from ..simulator.session import Session
from ..training.attempt import Attempt
from ..training.exercise import SHIPPED_EXERCISES, Exercise
from ..training.hands import Expert, Hand, Novice, performed
from ..training.recorder import Recorder
from . import _limits
from ._progress import track

HELP = "record a session without a page: from a table of poses, or an exercise that a scripted hand does"
EXAMPLES = """examples:
  sonospline record --scene gel --poses hand.csv --out hand.mcap           # a tracked hand over a scene
  sonospline record --exercise vessel-in-plane --hand expert --out e.mcap  # an exercise, seed 0, done by a script
  sonospline record --exercise mine.toml --hand novice --seed 3 --out n.mcap --database course.db --participant S-1
  sonospline replay hand.mcap                                              # every frame again, and the metrics
"""
HANDS: dict[str, Callable[[], Hand]] = {
    "expert": Expert,
    "expert-across": lambda: Expert(across=True),
    "novice": Novice,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="a new .mcap file")
    parser.add_argument("--poses", type=Path, metavar="CSV", help="time_s, entry and tip, rows of ProbeToReference")
    parser.add_argument("--scene", default=None, metavar="NAME|FILE", help="of the poses (kidney)")
    parser.add_argument("--model", metavar="NAME", help="which model of tissue answers the poses (as the scene says)")
    parser.add_argument("--exercise", metavar="NAME|FILE", help=f"{', '.join(SHIPPED_EXERCISES)}, or a file")
    parser.add_argument("--hand", choices=HANDS, default=None, help="who does the exercise (expert)")
    parser.add_argument("--seed", type=int, default=0, help="of the exercise's start (0)")
    parser.add_argument("--database", metavar="FILE|ADDRESS", help="keep the attempt in a lab's results")
    parser.add_argument("--participant", metavar="CODE", help="whose attempt it is, by the code")
    parser.add_argument("--quiet", action="store_true", help="say nothing meanwhile")
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its report."""
    _limits.check(args, {"seed": _limits.Whole(0, 2**63 - 1)})
    if (args.poses is None) == (args.exercise is None):
        raise ValueError("one source is needed: give --poses CSV, or --exercise NAME")
    if args.out.exists():
        raise ValueError(f"out = {str(args.out)!r} is there already; give a new file")
    if args.poses is not None:
        for option in ("hand", "database", "participant"):
            if getattr(args, option) is not None:
                raise ValueError(f"--{option} belongs to --exercise; leave it out with --poses")
        return _from_poses(args)
    for option in ("scene", "model"):
        if getattr(args, option) is not None:
            raise ValueError(f"--{option} belongs to --poses; the exercise names its own")
    if (args.database is None) != (args.participant is None):
        raise ValueError("--database and --participant belong together; give both, or none")
    return _by_hand(args)


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the report as a few lines for a person."""
    lines = [f"recording     {report['steps']:,} steps, {report['seconds']:.1f} s of {report['scene']} in {args.out}"]
    if "verdict" in report:
        lines.append(f"{report['exercise']}, seed {report['seed']}: {report['verdict']}")
    if "attempt" in report:
        lines.append(f"kept as attempt {report['attempt']} of {report['participant']}")
    return "\n".join(lines)


def _from_poses(args: argparse.Namespace) -> dict[str, Any]:
    rows = read_poses(args.poses)
    session = Session(args.scene or "kidney", model=args.model)
    with _recorder(args.out, session.scene) as recorder:
        for number, (row, dt) in enumerate(track(list(_steps(rows)), len(rows), "recording", quiet=args.quiet)):
            needles = {} if row.needle is None else {"needle": row.needle}
            try:
                recorder.add(session.step(needles=needles, probe_to_reference=row.probe_to_reference, dt=dt))
            except ValueError as error:
                raise ValueError(f"pose {number + 1} of {args.poses.name}, at {row.time_s:g} s: {error}") from None
    return {"scene": session.scene.spec.name, "steps": len(rows), "seconds": rows[-1].time_s - rows[0].time_s}


@contextmanager
def _recorder(out: Path, scene: Scene) -> Iterator[Recorder]:
    """A recorder; a file in which nothing was recorded does not stay."""
    with Recorder(out, scene) as recorder:
        try:
            yield recorder
        except BaseException:
            if not recorder.count:
                out.unlink()
            raise


def _steps(rows: list[PoseRow]) -> Iterator[tuple[PoseRow, float]]:
    """Each row, and the seconds since the one before."""
    before = rows[0].time_s
    for row in rows:
        yield row, row.time_s - before
        before = row.time_s


def _by_hand(args: argparse.Namespace) -> dict[str, Any]:
    """An exercise done by a script; where it is to be kept, the database and the code are asked for first."""
    shipped = args.exercise in SHIPPED_EXERCISES
    exercise = Exercise.shipped(args.exercise) if shipped else Exercise.read(args.exercise)
    scene = make_scene(exercise.scene_file(None if shipped else Path(args.exercise).parent))
    store = None if args.database is None else ResultStore(args.database)
    if store is not None and args.participant not in dict(store.participants()):
        store.add_participant(args.participant)
    began = datetime.now(UTC)
    with _recorder(args.out, scene) as recorder:
        attempt = Attempt(exercise, scene, seed=args.seed, on_frame=recorder.add)
        result = performed(attempt, HANDS[args.hand or "expert"]())
    report = {
        "scene": scene.spec.name, "steps": attempt.frame.number + 1, "seconds": result.metrics["time_s"],
        "exercise": exercise.name, "seed": args.seed, "ended": result.ended, "passed": result.passed,
        "verdict": result.verdict,
    }  # fmt: skip
    if store is not None:
        with store:
            kept = AttemptRecord.of(result, began=began, recording=args.out)
            report |= {"participant": args.participant, "attempt": store.add(args.participant, kept)}
    return report
