"""Time per step of finite elements, three ways, and of the models: one run, one thread each.

Run as a program it prints JSON; :func:`measure` does so in a fresh process, because the
threads of BLAS and of the direct solver are fixed when they are first loaded.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np

from ..fem import FiniteElementModel
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics import labelled_cube
from ..mechanics.line_force import LineForce
from ..models.elastic import ElasticInsertion
from ..models.insertion import NeedleInsertion
from ..models.kelvinlet import KelvinletInsertion
from ..models.spline.insertion import Insertion
from ..models.spline.interaction import NeedleTissueModel
from .insertions import equal_steps, held_out_insertions
from .timing import steps_ms

Row = dict[str, Any]

STEPS = 20
MODELS = ("ours", "kelvinlet", "elastic", "elastic_fine")
"""The paper's spline, the Kelvinlet, and finite elements: on 25^3 nodes up-sampled, and on about the nodes shown."""

_LIVE_NODES = 25**3
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "SONOSPLINE_THREADS"), "1")
_TURNS = 3
"""So many of the last steps are timed; one before them makes what is kept."""
_LARGE = 20_000
"""Nodes beyond which a step from scratch, hundreds of iterations over seconds, is timed once."""
_TOLERANCE = 1e-8
"""Of conjugate gradients."""


def measure(side: int, engines: dict[str, str]) -> Row:
    """Return the medians for a cube of ``side`` nodes a side, from a process of its own with one thread.

    Parameters
    ----------
    side : int
        Nodes a side.
    engines : dict of str to str
        The engine of :class:`FiniteElementModel` for each of its solvers that is to be timed.

    Raises
    ------
    RuntimeError
        That process failed; the last line it said is quoted.
    """
    command = [sys.executable, "-m", __name__, str(side), json.dumps(engines)]
    done = subprocess.run(command, env=os.environ | _ONE_THREAD, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["nothing"]
        raise RuntimeError(f"timing {side}^3 failed: {said[-1]}")
    row: Row = json.loads(done.stdout)
    return row


def timed(side: int, engines: dict[str, str]) -> Row:
    """Return the medians, in milliseconds, of this process."""
    tissue = Tissue(Grid.unit_cube(side))
    needles = equal_steps(held_out_insertions()[1].on(tissue), STEPS)
    row: Row = {"side": side, "nodes": tissue.grid.node_count, "engines": engines} | _models(tissue, needles)
    for solver, engine in engines.items():
        model = FiniteElementModel(tissue, engine=engine, solver=solver, tolerance=_TOLERANCE)
        if solver != "from_scratch":
            row[f"{solver}_first_ms"] = _finite_element_ms(model, needles[-_TURNS - 1])
        turns = 1 if solver == "from_scratch" and tissue.grid.node_count > _LARGE else _TURNS
        row[f"{solver}_ms"] = float(np.median([_finite_element_ms(model, needle) for needle in needles[-turns:]]))
    return row


def _models(tissue: Tissue, needles: list[Needle]) -> Row:
    """A step of each model, all nodes evaluated: the median of the last half of the steps of three insertions."""
    spline = Insertion(tissue, NeedleTissueModel.paper())
    body, load = labelled_cube("body"), LineForce()
    fine = ElasticInsertion(tissue, body, load, nodes=tissue.grid.node_count)
    drag = KelvinletInsertion(tissue)  # keeps nothing from step to step
    insertions: dict[str, NeedleInsertion] = {
        "ours": spline,
        "elastic": ElasticInsertion(tissue, body, load, nodes=_LIVE_NODES),
        "elastic_fine": fine,
    }
    spent: dict[str, list[float]] = {name: [] for name in insertions}
    for _ in range(3):
        for name, insertion in insertions.items():
            spent[name] += steps_ms(insertion, needles)[STEPS // 2 :]
    spent["kelvinlet"] = steps_ms(drag, needles[-_TURNS:])
    return {f"{name}_ms": float(np.median(times)) for name, times in spent.items()} | {
        "ours_range_ms": [min(spent["ours"]), max(spent["ours"])],
        "landmarks": spline.landmark_count + len(spline.anchors),
        "elastic_fine_nodes": fine.solver.grid.node_count,
    }


def _finite_element_ms(model: FiniteElementModel, needle: Needle) -> float:
    model.solve(LineForce(), needle)
    return 1e3 * model.times[-1].total_s


if __name__ == "__main__":
    json.dump(timed(int(sys.argv[1]), json.loads(sys.argv[2])), sys.stdout)
