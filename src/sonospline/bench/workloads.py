"""What a session is made of, each part as one call that can be timed: steps of models, and a picture.

As a program it answers a race: for each line that names a part, milliseconds of some calls in a row, as JSON.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from .. import _core
from ..elasticity.solver import ElasticSolver
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.labelled_cubes import labelled_cube
from ..mechanics.line_force import LineForce
from ..models.spline.insertion import Insertion
from ..simulator.console import Console
from ..simulator.session import Session
from .timing import elapsed_ms

IN_A_ROW = 16
"""Calls of a turn: a live loop has its caches warm, and every eighth elastic step measures its error."""
_PASS_STEPS = 80


class Workload(NamedTuple):
    """A part of a session, and how it is made ready."""

    threads: int
    make: Callable[[], Callable[[], object]]


def _needles() -> itertools.cycle[Needle]:
    """Needles of a slow pass, and back out."""
    whole = Needle((0, 0.413, 0.578), (0.617, 0.531, 0.469))
    inwards = [Needle(whole.entry, whole.at(t)) for t in np.linspace(0.5, 1, _PASS_STEPS)]
    return itertools.cycle(inwards + inwards[::-1])


def elastic(side: int) -> Callable[[], object]:
    """Return a step of live finite elements of a labelled cube."""
    solver, needles = ElasticSolver(Tissue(Grid.unit_cube(53)), labelled_cube("body"), nodes=side**3), _needles()
    state = solver.rest

    def step() -> object:
        nonlocal state
        state = solver.step(state, LineForce(), next(needles))
        return state

    return step


def spline() -> Callable[[], object]:
    """Return a step of the paper's model, with 300 landmarks, on 53^3 nodes."""
    insertion, needles = Insertion(Tissue(Grid.unit_cube(53))), _needles()
    return lambda: insertion.advance(next(needles)).on_grid()


def render(scene: str = "kidney") -> Callable[[], object]:
    """Return the picture of a scene with a needle in it, as its page shows it: every part on."""
    session = Session(scene)
    console = Console(session)
    length = session.scene.spec.needle.length_mm
    console.step(console.command.with_needle(depth=length / 2))
    shown = session.last
    assert shown is not None
    imager = session.scene.see(shown.probe, shown.probe_to_reference)
    needle, frames = next(iter(shown.needles.values())), itertools.count()
    return lambda: imager.render(shown.field, needle, frame=next(frames), settings=shown.settings)


WORKLOADS = {
    "elastic step, 25^3, one thread": Workload(1, partial(elastic, 25)),
    "elastic step, 53^3, two threads": Workload(2, partial(elastic, 53)),
    "spline step, 53^3, one thread": Workload(1, spline),
    "render of the kidney, two threads": Workload(2, render),
}
"""Parts by the names that reports give them."""


def main() -> None:
    """Say which instruction set this is, then time the parts that are asked for until nobody asks."""
    _say(_core.instruction_set())
    ready: dict[str, Callable[[], object]] = {}
    for line in sys.stdin:
        name = json.loads(line)
        if _core.native is not None:
            _core.native.set_thread_count(WORKLOADS[name].threads)
        if name not in ready:
            ready.clear()
            ready[name] = WORKLOADS[name].make()
            ready[name]()
        _say([elapsed_ms(ready[name]) for _ in range(IN_A_ROW)])


def _say(found: object) -> None:
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
