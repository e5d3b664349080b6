"""A race of instruction sets: one process for each, which take turns at the parts of a session, in one run."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np

from .. import _core
from .._markdown import table
from . import live, promises
from .timing import Times
from .workloads import WORKLOADS

POSE = "pose to encoded frame, median"
_AT_MOST_MS = {
    ("elastic step, 25^3, one thread", "avx2"): 2.5, ("elastic step, 25^3, one thread", "avx512"): 1.0,
    ("elastic step, 53^3, two threads", "avx2"): 20.0,
    ("spline step, 53^3, one thread", "avx512"): 1.0,
    ("render of the kidney, two threads", "avx2"): 12.5, ("render of the kidney, two threads", "avx512"): 10.0,
    (POSE, "avx2"): 16.0,
}  # fmt: skip
"""What is promised, where something is."""


def checked(names: Sequence[str]) -> tuple[str, ...]:
    """Return instruction sets to race, each once; without the compiled core there are none, and no race.

    Raises
    ------
    ValueError
        One that this machine or build has not.
    """
    for name in names if _core.native is not None else ():
        if name not in (available := list(_core.native.instruction_sets())):
            raise ValueError(f"--isa {name} cannot run here; give some of {', '.join(available)}")
    return tuple(dict.fromkeys(names))


def measure(names: Sequence[str], rounds: int, seconds: float, tell: Callable[[str], None]) -> dict[str, Any]:
    """Return a row for each part of a session: milliseconds by instruction set, and the first one's ratio to each.

    Raises
    ------
    RuntimeError
        A process ended before its work was done.
    """
    rows = [_row(name, names, times) for name, times in _parts(names, rounds, tell).items()]
    tell(POSE)
    rows.append(_row(POSE, names, _poses(names, rounds, seconds)))
    return {"isa": rows, "claims": [claim for row in rows for claim in _claims(row)]}


def report(results: dict[str, Any]) -> str:
    """Return the results as Markdown."""
    names = results["isa"][0]["instruction_sets"]
    head = ("median of turns, ms (least)", *names, *(f"{name}, times {names[0]}" for name in names[1:]))
    lines = [
        (
            row["part"],
            *(f"{times['median_ms']:.2f} ({times['min_ms']:.2f})" for times in row["times"].values()),
            *(f"{ratio:.2f}" for ratio in row["ratios"].values()),
        )
        for row in results["isa"]
    ]
    return f"{table(head, lines)}\n\n{promises.table_of_promises(results['claims'])}"


def _parts(names: Sequence[str], rounds: int, tell: Callable[[str], None]) -> dict[str, dict[str, Times]]:
    with ExitStack() as stack:
        runners = {name: stack.enter_context(_runner(name)) for name in names}
        found = {}
        for part in WORKLOADS:
            tell(part)
            turns: dict[str, list[float]] = {name: [] for name in names}
            for turn in range(rounds + 1):  # the first one warms up
                for name in _in_turn(names, turn):
                    median = float(np.median(_asked(runners[name], part)))
                    turns[name] += [median] if turn else []
            found[part] = {name: Times(tuple(values)) for name, values in turns.items()}
        return found


def _poses(names: Sequence[str], rounds: int, seconds: float) -> dict[str, Times]:
    """Each set's server takes poses through its WebSocket, so many seconds over all rounds."""
    turns: dict[str, list[float]] = {name: [] for name in names}
    with ExitStack() as stack:
        servers = {name: stack.enter_context(live.serving("kidney", SONOSPLINE_ISA=name))[0] for name in names}
        for turn in range(rounds):
            for name in _in_turn(names, turn):
                page, _ = asyncio.run(live.drive(live.socket_of(servers[name]), live.WARM_UP_S + seconds / rounds))
                if not page.columns:
                    raise RuntimeError("no frame showed a new pose in time; take --seconds for longer")
                turns[name].append(float(np.median(page.columns["server_ms"])))
    return {name: Times(tuple(values)) for name, values in turns.items()}


def _in_turn(names: Sequence[str], turn: int) -> Sequence[str]:
    return names[::-1] if turn % 2 else names  # who comes first has the cooler processor


@contextmanager
def _runner(name: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "sonospline.bench.workloads"]
    environment = os.environ | {"SONOSPLINE_ISA": name}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as runner:
        try:
            if (chosen := _answer(runner)) != name:
                raise RuntimeError(f"the process for {name} runs on {chosen}")
            yield runner
        finally:
            runner.kill()


def _asked(runner: subprocess.Popen[str], part: str) -> Any:
    assert runner.stdin is not None
    runner.stdin.write(json.dumps(part) + "\n")
    runner.stdin.flush()
    return _answer(runner)


def _answer(runner: subprocess.Popen[str]) -> Any:
    assert runner.stdout is not None
    line = runner.stdout.readline()
    if not line:
        raise RuntimeError(f"a process of the race ended (exit code {runner.wait(10)}); see what it said")
    return json.loads(line)


def _row(part: str, names: Sequence[str], times: dict[str, Times]) -> dict[str, Any]:
    first = times[names[0]]
    return {
        "part": part, "instruction_sets": list(names),
        "times": {name: times[name].as_dict() for name in names},
        "ratios": {name: times[name].ratio_to(first) for name in names[1:]},
    }  # fmt: skip


def _claims(row: dict[str, Any]) -> list[promises.Row]:
    return [
        promises.promised(f"{row['part']}, {name}, ms", most, row["times"][name]["median_ms"], at_most=True)
        for name in row["instruction_sets"]
        if (most := _AT_MOST_MS.get((row["part"], name))) is not None
    ]
