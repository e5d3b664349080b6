"""The paper's results, computed: tuning, errors by mesh and depth, times, baselines and readings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._digest import digest
from ..bench import machine
from ..fem import FiniteElementModel, history_of
from ..geometry.grid import Grid
from ..geometry.tissue import Tissue
from ..io.labels import read_labels
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.insertion import Insertion
from . import amortising, dense_steps, drift, specimens, step_times
from .insertions import PlannedInsertion, held_out_insertions, tuning_insertions
from .metrics import Errors
from .models_compared import compare_friction, compare_held, equal_to_scikit_fem, held_factors
from .notebook import Notebook
from .objective import Objective, errors_at_target
from .plan import Plan
from .readings import compare_readings
from .reference import Reference, errors_along
from .specimens import Specimen
from .thin_plate import ThinPlate, plane_errors
from .tuning import search

Array = NDArray[np.float64]
Row = dict[str, Any]

PARTS = ("tuning", "target", "errors", "drift", "plane", "readings", "amortised", "models", "anatomy", "times", "dense")
"""Of the study, in the order they are computed; the last two want a machine that does nothing else."""


def run_study(plan: Plan, notebook: Notebook, only: Collection[str] = PARTS) -> Row:
    """Return every figure of the report, or those of some parts; what the notebook holds is not computed again."""
    study = Study(plan, notebook)
    labels = None if plan.labels is None else str(plan.labels)
    return {"plan": asdict(plan) | {"labels": labels}} | {
        name: getattr(study, name)() for name in PARTS if name in only
    }


class Study:
    """The parts of the study: a method each, which returns rows that JSON holds and keeps them in a notebook."""

    def __init__(self, plan: Plan, notebook: Notebook) -> None:
        self._plan = plan
        self._notebook = notebook

    def tuning(self) -> Row:
        """The parameters nearest to finite elements, and the front they are from."""
        plan = self._plan
        settings = self._settings("population", "generations", "tuning_depths")
        return self._notebook.part("tuning", settings, partial(_tune, plan))

    @cached_property
    def _models(self) -> dict[str, NeedleTissueModel]:
        """The paper's model with the tuned parameters and with the printed ones."""
        return {"tuned": NeedleTissueModel(**self.tuning()["parameters"]), "paper": NeedleTissueModel.paper()}

    def target(self) -> Row:
        """Mean errors on the tuning mesh at full depth, of both models, on tuned and on held-out insertions."""
        return self._on_the_tuning_mesh("errors_at_the_target", partial(_at_target, self._plan, self._models))

    def errors(self) -> list[Row]:
        """Errors by mesh, depth and insertion."""
        plan, models = self._plan, self._models
        return [
            row
            for side in plan.sides
            for insertion in held_out_insertions()
            for row in self._notebook.part(
                f"errors_{side}_{insertion.name}",
                self._settings("depths") | {"side": side, "models": _parameters(models)},
                partial(_errors, plan, side, insertion, models),
            )
        ]

    def drift(self) -> list[Row]:
        """How far pinned nodes move, by anchors and updates."""
        insertions = _chosen(self._plan.scope.insertions)
        return self._on_the_tuning_mesh("drift", partial(drift.measure, self._plan.sides[0], insertions))

    def plane(self) -> list[Row]:
        """The 2-D thin plate and the 3-D spline, in the needle's plane and off it."""
        return self._on_the_tuning_mesh("thin_plate", partial(_plane, self._plan, self._models["tuned"]))

    def readings(self) -> list[Row]:
        """What the paper can mean."""
        return self._on_the_tuning_mesh("readings", partial(_readings, self._plan))

    def amortised(self) -> Row:
        """Parameters by site, direction and depth beside the tuned set, on insertions that neither has seen."""
        plan, tuned = self._plan, self._models["tuned"]
        how = {"side": plan.sides[0], "count": plan.drawn, "alone": plan.alone, "evaluations": plan.fits}
        compute = partial(amortising.compare_sets, tuned, workers=plan.workers, **how)
        return self._notebook.part("amortised", how | {"tuned": asdict(tuned)}, compute)

    def models(self) -> Row:
        """The three models against finite elements, cube by cube."""
        scope, tuned = self._plan.scope, self._models["tuned"]
        settings = {"scope": asdict(scope), "tuned": asdict(tuned)}
        factors = self._notebook.part("models_factors", settings, partial(held_factors, scope, tuned))

        def compare(name: str, insertion: PlannedInsertion) -> Row:
            friction = compare_friction(scope, specimens.cube(name, scope.shown), insertion, tuned)
            return friction | {"held": compare_held(scope, name, insertion, tuned, factors)}

        parts = [
            (name, self._notebook.part(f"models_{name}_{one.name}", settings, partial(compare, name, one)))
            for one in _chosen(scope.insertions)
            for name in scope.cubes
        ]
        return _gathered(parts) | {"held": [row for _, part in parts for row in part["held"]], "factors": factors}

    def anatomy(self) -> Row:
        """The same in the tissue of the kidney scene, and in that of a label map where one is given."""
        scope, tuned, labels = self._plan.scope, self._models["tuned"], self._plan.labels
        found = [specimens.kidney(scope.shown**3)]
        if labels is not None:
            found.append(specimens.patient(specimens.name_of(labels), read_labels(labels), scope.shown**3))

        def compare(specimen: Specimen, insertion: PlannedInsertion) -> Row:
            scikit_fem = equal_to_scikit_fem(scope, specimen, insertion)
            return compare_friction(scope, specimen, insertion, tuned) | {"scikit_fem": scikit_fem}

        parts = [
            (
                specimen.name,
                self._notebook.part(
                    f"anatomy_{specimen.name.replace(' ', '_')}_{one.name}",
                    {"scope": asdict(scope), "tuned": asdict(tuned), "voxels": digest(specimen.tissues.labels.voxels)},
                    partial(compare, specimen, one),
                ),
            )
            for specimen in found
            for one in specimen.insertions[: scope.real]
        ]
        return _gathered(parts) | {"scikit_fem": [part["scikit_fem"] for _, part in parts]}

    def times(self) -> list[Row]:
        """Milliseconds of a step, by mesh; they are of this machine: another one takes its own."""
        engines = self._plan.timed
        made_with = {"engines": engines, "models": step_times.MODELS, "on": machine.processor()}
        return [
            self._notebook.part(
                f"times_{side}", {"side": side, **made_with}, partial(step_times.measure, side, engines)
            )
            for side in self._plan.sides
        ]

    def dense(self) -> list[Row]:
        """Milliseconds of a dense step, by landmarks."""
        side, counts = self._plan.dense_side, self._plan.dense_counts
        made_with = {"side": side, "counts": counts, "on": machine.processor()}
        return self._notebook.part("dense_steps", made_with, partial(dense_steps.measure, side, counts))

    def _on_the_tuning_mesh(self, name: str, compute: Callable[[], Any]) -> Any:
        settings = self._settings("depths") | {"side": self._plan.sides[0], "models": _parameters(self._models)}
        return self._notebook.part(name, settings, compute)

    def _settings(self, *names: str) -> Row:
        return {name: getattr(self._plan, name) for name in ("seed", *names)}


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


def _chosen(names: Sequence[str]) -> list[PlannedInsertion]:
    held_out = {insertion.name: insertion for insertion in held_out_insertions()}
    return [held_out[name] for name in names]


def _gathered(parts: list[tuple[str, Row]]) -> Row:
    """The rows of all parts, and of each specimen the maps of the first."""
    maps: Row = {}
    for name, part in parts:
        maps.setdefault(name, part["maps"])
    return {"friction": [row for _, part in parts for row in part["rows"]], "maps": maps}


def _parameters(models: dict[str, NeedleTissueModel]) -> Row:
    return {name: asdict(model) for name, model in models.items()}
