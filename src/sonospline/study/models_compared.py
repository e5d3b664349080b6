"""The three models of tissue and finite elements on the same loads, in homogeneous and in labelled tissue."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..fem.held_shaft import held_shaft
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics import LABELLED_CUBES, labelled_cube
from ..mechanics.labelled_cubes import TISSUES
from ..mechanics.line_force import LineForce
from ..mechanics.material import Material
from ..mechanics.shaft_displacement import ShaftDisplacement
from ..mechanics.tissue_map import TissueMap
from ..models import registry
from ..models.elastic import ElasticInsertion, ElasticSolver
from ..models.insertion import NeedleInsertion
from ..models.maker import make
from ..models.spline.insertion import Insertion
from ..models.spline.interaction import NeedleTissueModel
from .insertions import PlannedInsertion, equal_steps, tuning_insertions
from .metrics import displacement_errors

Array = NDArray[np.float64]
Row = dict[str, Any]

_REFERENCE_ERROR = 1e-4
_DIGITS = 4
"""Of the numbers of a picture."""


@dataclass(frozen=True)
class Scope:
    """How much is compared."""

    insertions: tuple[str, ...] = ("H3", "H1", "H2", "H4", "H5")
    """Names of the held-out insertions; the first is drawn. H3 lies in the plane that all inclusions meet."""
    fine: int = 97
    """Nodes a side of the reference; every second of them is compared."""
    side: int = 25
    """Nodes a side of the live solver, and of the reference of case D."""
    depths: int = 5
    """Equal steps to the target at which errors are measured."""
    steps: int = 60
    """Of an elastic insertion."""
    cubes: tuple[str, ...] = LABELLED_CUBES

    @property
    def display(self) -> Tissue:
        """The nodes that are compared."""
        return Tissue(Grid.unit_cube((self.fine + 1) // 2))


def compare_friction(scope: Scope, name: str, plan: PlannedInsertion, tuned: NeedleTissueModel) -> Row:
    """Return the errors of every model in a labelled cube, at each depth, on load case F.

    The reference is the live solver on a fine grid, converged. The kernels do not know the
    stiffness: they were tuned in homogeneous tissue on this load.
    """
    tissue, tissues = scope.display, labelled_cube(name)
    needles = _needles(scope, plan)
    whole, depths = needles[-1], [(k + 1) / scope.depths for k in range(scope.depths)]
    fine = ElasticSolver(tissue, tissues, nodes=scope.fine**3)
    states = (fine.solve(LineForce(), needle, tolerance=_REFERENCE_ERROR) for needle in needles)
    expected = [np.moveaxis(state.displacement, 0, -1)[::2, ::2, ::2].astype(float) for state in states]
    found = _without_labels(scope, plan, tuned) if len(tissues.materials) > 1 else _kernel_fields(scope, plan, tuned)
    live = ElasticInsertion(tissue, tissues, LineForce(), nodes=scope.side**3)
    found = {**found, "elastic": _live(live, needles, scope.steps)}
    for model, insertion in _labelled(tissue, tissues).items():
        found[model] = _live(insertion, needles, scope.steps)
    labels = tissues.labels_at(tissue.grid.points).reshape(tissue.grid.shape)
    rows: list[Row] = []
    for model, fields in found.items():
        for depth, needle, field, reference in zip(depths, needles, fields, expected, strict=True):
            errors = _errors(field, reference, tissue, needle)
            rows.append({"cube": name, "insertion": plan.name, "model": model, "depth": depth} | errors)
        rows[-1]["tissues"] = _by_tissue(name, labels, fields[-1], expected[-1])
    maps: Row = {"reference": _slice(expected[-1])} | {m: _slice(f[-1] - expected[-1]) for m, f in found.items()}
    maps["labels"] = labels[:, labels.shape[1] // 2].tolist()
    maps["needle"] = (np.stack([whole.entry, whole.tip])[:, ::2] / tissue.grid.spacing[0]).tolist()
    return {"rows": rows, "maps": maps}


def held_factors(scope: Scope, tuned: NeedleTissueModel) -> dict[str, float]:
    """Return what the field of each kernel, as tuned for case F, is to be multiplied by on case D.

    Least squares on the tuning insertions, in homogeneous tissue: which nodes are held depends
    on the mesh, and between them tissue lags behind.
    """
    tissue = Tissue(Grid.unit_cube(scope.side))
    solver = ElasticSolver(tissue, Material(), nodes=scope.side**3)
    needles = [plan.on(tissue) for plan in tuning_insertions()]
    moved = [held_shaft(solver, ShaftDisplacement(), needle) for needle in needles]
    factors = {}
    for model, insertion in _kernels(tissue, tuned).items():
        fields = [_field(insertion, needle) for needle in needles]
        factors[model] = float(sum(map(np.vdot, fields, moved)) / sum(map(np.vdot, fields, fields)))
    return factors


def compare_held(
    scope: Scope, name: str, plan: PlannedInsertion, tuned: NeedleTissueModel, factors: dict[str, float]
) -> list[Row]:
    """Return the errors of every model in a labelled cube, at full depth, on load case D.

    The reference is that of the live solver's own nodes.
    """
    tissue, load = Tissue(Grid.unit_cube(scope.side)), ShaftDisplacement()
    needle = plan.on(tissue)
    expected = held_shaft(ElasticSolver(tissue, labelled_cube(name), nodes=scope.side**3), load, needle)
    found = {model: factors.get(model, 1.0) * u for model, u in _held_without_labels(scope, plan, tuned).items()}
    if name == "homogeneous":
        del found["one stiffness"]
    return [
        {"cube": name, "insertion": plan.name, "model": model} | _errors(field, expected, tissue, needle)
        for model, field in found.items()
    ]


def _errors(field: Array, reference: Array, tissue: Tissue, needle: Needle) -> Row:
    """Errors, and that at the tip over the largest displacement."""
    errors = asdict(displacement_errors(field, reference, grid=tissue.grid, tip=needle.tip))
    return errors | {"tip_share": errors["at_tip"] / float(np.linalg.norm(reference, axis=-1).max())}


@lru_cache(maxsize=1)  # the same in every cube
def _kernel_fields(scope: Scope, plan: PlannedInsertion, tuned: NeedleTissueModel) -> dict[str, list[Array]]:
    """Each kernel's displacement at each depth, case F."""
    needles = _needles(scope, plan)
    return {
        model: [_field(insertion, needle) for needle in needles]
        for model, insertion in _kernels(scope.display, tuned).items()
    }


@lru_cache(maxsize=1)
def _without_labels(scope: Scope, plan: PlannedInsertion, tuned: NeedleTissueModel) -> dict[str, list[Array]]:
    """What the models that know no labels say: the kernels, and finite elements of one stiffness."""
    uniform = ElasticInsertion(scope.display, Material(), LineForce(), nodes=scope.side**3)
    return {
        **_kernel_fields(scope, plan, tuned),
        "one stiffness": _live(uniform, _needles(scope, plan), scope.steps),
    }


@lru_cache(maxsize=1)
def _held_without_labels(scope: Scope, plan: PlannedInsertion, tuned: NeedleTissueModel) -> dict[str, Array]:
    """The same at full depth, case D."""
    tissue = Tissue(Grid.unit_cube(scope.side))
    uniform, needle = ElasticSolver(tissue, Material(), nodes=scope.side**3), plan.on(tissue)
    fields = {model: _field(insertion, needle) for model, insertion in _kernels(tissue, tuned).items()}
    return fields | {"one stiffness": held_shaft(uniform, ShaftDisplacement(), needle)}


def _needles(scope: Scope, plan: PlannedInsertion) -> list[Needle]:
    return equal_steps(plan.on(scope.display), scope.depths)


def model_titles() -> dict[str, str]:
    """Return what the report calls each model that is compared: those of the registry, the paper's in two tunings."""
    names = registry.names()
    labelled = registry.able("labels")
    others = [name for name in names if name not in labelled and name != "paper"]
    return {
        "Table I": "paper, Table I",
        "tuned": "paper, tuned on F",
        **{name: name for name in others},
        "one stiffness": "elastic, one stiffness",
        **{name: name for name in labelled},
    }


def _kernels(tissue: Tissue, tuned: NeedleTissueModel) -> dict[str, NeedleInsertion]:
    """The models that know no labels."""
    others = [name for name in registry.names() if name != "paper" and name not in registry.able("labels")]
    return {
        "Table I": Insertion(tissue, NeedleTissueModel.paper()),
        "tuned": Insertion(tissue, tuned),
        **{name: NeedleInsertion(make(name, tissue)) for name in others},
    }


def _labelled(tissue: Tissue, tissues: TissueMap) -> dict[str, NeedleInsertion]:
    """The models that know labels, besides the one that has the reference's own load."""
    others = [name for name in registry.able("labels") if name != "elastic"]
    return {name: NeedleInsertion(make(name, tissue, tissues)) for name in others}


def _live(insertion: NeedleInsertion, needles: list[Needle], steps: int) -> list[Array]:
    """Fields at the poses of an insertion that takes so many steps to the last of them."""
    whole, fields = needles[-1], []
    for number, needle in enumerate(needles):
        first, last = (round(steps * k / len(needles)) for k in (number, number + 1))
        for step in range(first + 1, last + 1):
            insertion.advance(Needle(whole.entry, whole.at(step / steps)) if step < last else needle)
        fields.append(np.asarray(insertion.field.on_grid(), float))
    return fields


def _field(insertion: NeedleInsertion, needle: Needle) -> Array:
    insertion.reset()
    return np.asarray(insertion.advance(needle).on_grid("accurate"), float)


def _by_tissue(name: str, labels: NDArray[np.integer], field: Array, reference: Array) -> Row:
    """Mean error over mean displacement within each tissue."""
    error, size = (np.linalg.norm(values, axis=-1) for values in (field - reference, reference))
    moves = size > 0
    return {
        tissue: float(error[here].mean() / size[here].mean())
        for label, tissue in enumerate(TISSUES[name])
        if (here := moves & (labels == label)).any()
    }


def _slice(field: Array) -> list[list[float]]:
    """Length of a displacement on the middle plane across the second axis."""
    size = np.linalg.norm(field[:, field.shape[1] // 2], axis=-1)
    return [[float(f"{value:.{_DIGITS - 1}e}") for value in line] for line in size]
