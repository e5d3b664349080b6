"""Time per step of finite elements, three ways, of the models and of the paper's dense step: one run, one thread."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..bench.contenders import PaperStep
from ..bench.problem import Problem
from ..bench.timing import several, steps_ms
from ..fem import FiniteElementModel
from ..geometry.grid import Grid
from ..geometry.needle import Needle, equal_steps
from ..geometry.tissue import Tissue
from ..mechanics import labelled_cube
from ..mechanics.interaction import NeedleTissueModel
from ..mechanics.line_force import LineForce
from ..models.elastic import ElasticInsertion
from ..models.insertion import NeedleInsertion
from ..models.kelvinlet import KelvinletInsertion
from ..models.spline.insertion import Insertion
from .insertions import held_out_insertions
from .one_thread import in_one_thread

Row = dict[str, Any]

STEPS = 20
MODELS = ("ours", "kelvinlet", "elastic", "elastic_fine")
"""The paper's spline, the Kelvinlet, and finite elements: on 25^3 nodes up-sampled, and on about the nodes shown."""

_LIVE_NODES = 25**3
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
    row: Row = in_one_thread(timed, side, engines)
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
    fine = ElasticInsertion(tissue, body, load, load_at="undeformed", nodes=tissue.grid.node_count)
    drag = KelvinletInsertion(tissue)  # keeps nothing from step to step
    insertions: dict[str, NeedleInsertion] = {
        "ours": spline,
        "elastic": ElasticInsertion(tissue, body, load, load_at="undeformed", nodes=_LIVE_NODES),
        "elastic_fine": fine,
    }
    spent: dict[str, list[float]] = {name: [] for name in insertions}
    for _ in range(3):
        for name, insertion in insertions.items():
            spent[name] += steps_ms(insertion, needles)[STEPS // 2 :]
    spent["kelvinlet"] = steps_ms(drag, needles[-_TURNS:])
    return {f"{name}_ms": float(np.median(times)) for name, times in spent.items()} | {
        "ours_range_ms": [min(spent["ours"]), max(spent["ours"])],
        "dense_ms": several(partial(PaperStep().step, Problem.of(spline))),
        "landmarks": spline.landmark_count + len(spline.anchors),
        "elastic_fine_nodes": fine.solver.grid.node_count,
    }


def _finite_element_ms(model: FiniteElementModel, needle: Needle) -> float:
    model.solve(LineForce(), needle)
    return 1e3 * model.times[-1].total_s
