"""The paper's results, computed: tuning, errors by mesh and depth, times, baselines and readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._extras import present
from ..fem import FiniteElementModel, history_of
from ..geometry.grid import Grid
from ..geometry.tissue import Tissue
from ..models.spline.insertion import Insertion
from ..models.spline.interaction import NeedleTissueModel
from . import step_times
from .insertions import PlannedInsertion, held_out_insertions, tuning_insertions
from .metrics import Errors
from .models_compared import Scope, compare_friction, compare_held, held_factors
from .notebook import Notebook
from .objective import Objective, errors_at_target
from .parallel import usable_processors
from .readings import compare_readings
from .reference import Reference, errors_along
from .thin_plate import ThinPlate, plane_errors
from .tuning import GENERATIONS, POPULATION, search

Array = NDArray[np.float64]
Row = dict[str, Any]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Plan:
    """How much of the study is done, and with which engine."""

    seed: int
    solver: str
    """Of the references, which scikit-fem computes: "multigrid", or "direct" where Pardiso is at hand."""
    timed: dict[str, str]
    """The engine each solver is timed with."""
    sides: tuple[int, ...] = (25, 31, 37, 43, 48, 53)
    """Nodes a side of the meshes errors and times are measured on; the first is tuned on."""
    depths: int = 10
    """Equal steps to the target at which errors are measured."""
    tuning_depths: int = 2
    """How many of them are tuned on; a divisor of their number."""
    population: int = POPULATION
    generations: int = GENERATIONS
    scope: Scope = field(default_factory=Scope)
    """How much the three models are compared."""
    workers: int = field(default_factory=usable_processors, compare=False)

    @classmethod
    def full(cls, seed: int) -> Plan:
        """Return the whole study, timed with the paper's own engine, FEniCSx, and the fastest factor at hand."""
        pardiso = present("pypardiso")
        timed = dict.fromkeys(("from_scratch", "multigrid", "direct"), "fenicsx")
        return cls(
            seed,
            "direct" if pardiso else "multigrid",
            timed | {"direct": "scikit-fem"} if pardiso else timed,
        )

    @classmethod
    def quick(cls, seed: int) -> Plan:
        """Return a study of a few minutes: two meshes, a small search, the engine that pip installs."""
        timed = dict.fromkeys(("from_scratch", "multigrid", "direct"), "scikit-fem")
        return cls(
            seed,
            "multigrid",
            timed,
            sides=(25, 31),
            depths=2,
            tuning_depths=1,
            population=16,
            generations=12,
            scope=Scope(("H3",), fine=49, depths=4),
        )


def run_study(plan: Plan, notebook: Notebook) -> Row:
    """Return every figure of the report; parts that the notebook holds are not computed again."""
    tuning = notebook.part("tuning", _settings(plan, "population", "generations", "tuning_depths"), lambda: _tune(plan))
    models = {"tuned": NeedleTissueModel(**tuning["parameters"]), "paper": NeedleTissueModel.paper()}
    return {
        "plan": asdict(plan),
        "tuning": tuning,
        "target": _part(notebook, plan, "errors at the target", models, lambda: _at_target(plan, models)),
        "errors": [
            row
            for side in plan.sides
            for insertion in held_out_insertions()
            for row in notebook.part(
                f"errors_{side}_{insertion.name}",
                _settings(plan, "depths") | {"side": side, "models": _parameters(models)},
                lambda side=side, insertion=insertion: _errors(plan, side, insertion, models),  # type: ignore[misc]
            )
        ],
        "times": [
            notebook.part(
                f"times_{side}",
                {"side": side, "engines": plan.timed, "models": step_times.MODELS},
                lambda side=side: step_times.measure(side, plan.timed),  # type: ignore[misc]
            )
            for side in plan.sides
        ],
        "plane": _part(notebook, plan, "thin plate", models, lambda: _plane(plan, models["tuned"])),
        "readings": _part(notebook, plan, "readings", models, lambda: _readings(plan)),
        "models": _models(plan, notebook, models["tuned"]),
    }


def reference_of(plan: Plan, insertion: PlannedInsertion, side: int) -> Reference:
    """Return the finite element reference of an insertion into the unit cube.

    The first one asked for of a mesh brings along those of all insertions the mesh is used for: what the
    mesh needs is made once, and each processor solves for an insertion of its own.
    """
    everyone = held_out_insertions() + (tuning_insertions() if side == plan.sides[0] else ())
    alone = plan.solver == "direct"  # Pardiso takes all processors by itself, and one caller at a time
    references = _references(everyone, side, plan.depths, plan.solver, 1 if alone else plan.workers)
    return next(reference for reference in references if reference.plan.name == insertion.name)


@lru_cache(maxsize=1)  # a mesh's references are let go with the next mesh
def _references(
    insertions: tuple[PlannedInsertion, ...], side: int, steps: int, solver: str, workers: int
) -> tuple[Reference, ...]:
    model = FiniteElementModel(Tissue(Grid.unit_cube(side)), solver=solver)

    def history(tissue: Tissue, entry: ArrayLike, target: ArrayLike, steps: int) -> Array:
        return history_of(model, entry, target, steps)

    def solve(insertion: PlannedInsertion) -> Reference:
        return Reference.solve(insertion, model.tissue, steps=steps, history=history)

    with ThreadPoolExecutor(workers) as pool:
        return tuple(pool.map(solve, insertions))


def mean_rows(rows: Sequence[Row], *keys: str) -> list[Row]:
    """Return the means of all errors over rows that agree in ``keys``, in order of appearance."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    averaged = [name for name in _ERRORS if rows and rows[0].get(name) is not None]
    return [
        dict(zip(keys, values, strict=True)) | {f: float(np.mean([row[f] for row in group])) for f in averaged}
        for values, group in groups.items()
    ]


_ERRORS = (*(f.name for f in fields(Errors)), "tip_share")


def _tune(plan: Plan) -> Row:
    every = plan.depths // plan.tuning_depths
    references = tuple(
        reference_of(plan, i, plan.sides[0]).at(range(every - 1, plan.depths, every)) for i in tuning_insertions()
    )
    front = search(
        Objective(references),
        population=plan.population,
        generations=plan.generations,
        seed=plan.seed,
        workers=plan.workers,
    )
    return {
        "parameters": asdict(front.model()),
        "front": front.objectives.tolist(),
        "chosen": front.chosen,
        "evaluations": plan.population * plan.generations,
        "side": plan.sides[0],
    }


def _at_target(plan: Plan, models: dict[str, NeedleTissueModel]) -> Row:
    """Mean errors on the tuning mesh at full depth, of both models, on tuned and on held-out insertions."""
    groups = {"tuning": tuning_insertions(), "held_out": held_out_insertions()}
    references = {
        name: tuple(reference_of(plan, insertion, plan.sides[0]).last for insertion in group)
        for name, group in groups.items()
    }
    return {
        name: {
            group: {which: asdict(errors) for which, errors in errors_at_target(chosen, model).items()}
            for group, chosen in references.items()
        }
        for name, model in models.items()
    }


def _errors(plan: Plan, side: int, insertion: PlannedInsertion, models: dict[str, NeedleTissueModel]) -> list[Row]:
    reference = reference_of(plan, insertion, side)
    return [
        {"side": side, "insertion": insertion.name, "model": name, "depth": depth} | asdict(errors)
        for name, model in models.items()
        for depth, errors in zip(
            reference.depths,
            errors_along(Insertion(reference.tissue, model), reference, method="accurate"),
            strict=True,
        )
    ]


def _plane(plan: Plan, model: NeedleTissueModel) -> list[Row]:
    """The 2-D thin plate and the 3-D spline, in the needle's plane and off it."""
    rows = []
    for insertion in held_out_insertions():
        reference = reference_of(plan, insertion, plan.sides[0]).last
        plate = ThinPlate(reference, model).errors()
        ours = np.asarray(Insertion(reference.tissue, model).advance(reference.needle(0)).on_grid("direct"))
        for name, errors in (
            ("thin plate, other planes at rest", plate.still),
            ("thin plate, every plane alike", plate.carried),
            ("3-D spline", plane_errors(reference, ours)),
        ):
            for where in ("in_plane", "off_plane"):
                rows.append(
                    {"model": name, "where": where, "insertion": insertion.name} | asdict(getattr(errors, where))
                )
    return rows


def _readings(plan: Plan) -> list[Row]:
    references = [reference_of(plan, i, plan.sides[0]).last for i in tuning_insertions()]
    return compare_readings(references)


def _models(plan: Plan, notebook: Notebook, tuned: NeedleTissueModel) -> Row:
    """The three models against finite elements, cube by cube."""
    scope = plan.scope
    settings = {"scope": asdict(scope), "tuned": asdict(tuned)}
    insertions = {insertion.name: insertion for insertion in held_out_insertions()}
    factors = notebook.part("models_factors", settings, lambda: held_factors(scope, tuned))
    rows: dict[str, list[Row]] = {"friction": [], "held": []}
    maps: Row = {}
    for insertion in (insertions[one] for one in scope.insertions):
        for name in scope.cubes:

            def compute(name: str = name, insertion: PlannedInsertion = insertion) -> Row:
                friction = compare_friction(scope, name, insertion, tuned)
                return friction | {"held": compare_held(scope, name, insertion, tuned, factors)}

            part = notebook.part(f"models_{name}_{insertion.name}", settings, compute)
            rows["friction"] += part["rows"]
            rows["held"] += part["held"]
            maps.setdefault(name, part["maps"])
    return {**rows, "maps": maps, "factors": factors}


def _part(
    notebook: Notebook, plan: Plan, name: str, models: dict[str, NeedleTissueModel], compute: Callable[[], Any]
) -> Any:
    settings = _settings(plan, "depths") | {"side": plan.sides[0], "models": _parameters(models)}
    return notebook.part(name.replace(" ", "_"), settings, compute)


def _settings(plan: Plan, *names: str) -> Row:
    return {name: getattr(plan, name) for name in ("seed", *names)}


def _parameters(models: dict[str, NeedleTissueModel]) -> Row:
    return {name: asdict(model) for name, model in models.items()}
