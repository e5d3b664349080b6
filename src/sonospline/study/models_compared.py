"""The three models of tissue and finite elements on the same loads, in homogeneous, labelled and real tissue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..elasticity import ElasticSolver
from ..fem import FiniteElementModel
from ..fem.consistent_load import consistent_load
from ..fem.held_shaft import held_shaft
from ..geometry.grid import Grid
from ..geometry.needle import Needle, equal_steps
from ..geometry.tissue import Tissue
from ..mechanics import LABELLED_CUBES, labelled_cube
from ..mechanics.interaction import NeedleTissueModel
from ..mechanics.loads import LineLoad
from ..mechanics.material import Material
from ..mechanics.shaft_displacement import ShaftDisplacement
from ..models import registry
from ..models.elastic import ElasticModel
from ..models.insertion import NeedleInsertion
from ..models.maker import make
from ..models.spline.insertion import Insertion
from .drawn_plane import DrawnPlane
from .insertions import PlannedInsertion, tuning_insertions
from .metrics import displacement_errors
from .model_fields import REFERENCE_ERROR, at_pose, converged, elastic, factor, honesty, live
from .specimens import Specimen

Array = NDArray[np.float64]
Row = dict[str, Any]

_SMALLEST_TISSUE, _STILL = 3e-3, 0.03
"""A tissue with fewer of the nodes that move, or that moves by less of the mean, has no error of its own."""


@dataclass(frozen=True)
class Scope:
    """How much is compared."""

    insertions: tuple[str, ...] = ("H3", "H1", "H2", "H4", "H5")
    """Names of the held-out insertions into cubes; the first, drawn, lies in the plane that all inclusions meet."""
    fine: int = 97
    """Nodes a side of the reference; every second of them is compared. In real anatomy: of a cube of as many nodes."""
    side: int = 25
    """Nodes a side of the live solver in cubes, and of the reference of case D."""
    depths: int = 5
    """Equal steps to the target at which errors are measured."""
    steps: int = 60
    """Of an elastic insertion."""
    cubes: tuple[str, ...] = LABELLED_CUBES
    real: int = 3
    """Insertions into each real anatomy; none leaves it out."""
    checked: int = 25
    """Nodes a side of a cube of as many nodes as scikit-fem solves there, too."""

    @property
    def shown(self) -> int:
        """Nodes a side that are compared."""
        return (self.fine + 1) // 2


def compare_friction(scope: Scope, specimen: Specimen, plan: PlannedInsertion, tuned: NeedleTissueModel) -> Row:
    """Return the errors of every model in a specimen, at each depth, under friction and a force at the tip.

    The reference is the elastic model on a fine grid, converged at each depth. The kernels do not know the
    stiffness: they were tuned in homogeneous tissue, on case F. In real anatomy, whose forces and stiffnesses
    they were not tuned on, each model without labels is multiplied by the ``factor`` that fits it best.
    """
    tissue, tissues = specimen.tissue, specimen.tissues
    needles = equal_steps(plan.on(tissue), scope.depths)
    expected = converged(specimen, needles, scope.fine**3)
    found = dict(_kernel_fields(tissue, plan, scope.depths, tuned))
    if len(tissues.materials) > 1:
        load = specimen.load_without_labels()
        found["one stiffness"] = _one_stiffness(scope, specimen.real, tissue, specimen.uniform, load, plan)
    factors = {model: factor(fields[-1], expected[-1]) if specimen.real else 1.0 for model, fields in found.items()}
    found = {model: [factors[model] * field for field in fields] for model, fields in found.items()}
    insertion = elastic(specimen, None if specimen.real else scope.side**3)
    found["elastic"] = live(insertion, needles, scope.steps)
    published = honesty(insertion, found["elastic"][-1])
    for model, insertion in _labelled(specimen).items():
        found[model] = live(insertion, needles, scope.steps)
    labels = tissues.labels_at(tissue.grid.points).reshape(tissue.grid.shape)
    rows: list[Row] = []
    for model, fields in found.items():
        for number, (needle, field, reference) in enumerate(zip(needles, fields, expected, strict=True), 1):
            place = {"specimen": specimen.name, "insertion": plan.name, "model": model, "depth": number / scope.depths}
            rows.append(place | _errors(field, reference, tissue, needle))
        rows[-1] |= {
            "tissues": _by_tissue(specimen.names, labels, fields[-1], expected[-1]),
            "factor": factors.get(model, 1.0),
            **(published if model == "elastic" else {}),
        }
    plane = DrawnPlane.of(tissue, needles[-1])
    maps: Row = {model: plane.size(fields[-1] - expected[-1]) for model, fields in found.items()}
    maps |= {"reference": plane.size(expected[-1]), "labels": plane.cut(labels).tolist()}
    maps["needle"] = plane.ends(needles[-1])
    return {"rows": rows, "maps": maps}


def equal_to_scikit_fem(scope: Scope, specimen: Specimen, plan: PlannedInsertion) -> Row:
    """Return the largest difference, over the peak, of the elastic solver's converged field and scikit-fem's.

    Both solve for the same nodal forces on the same cells, the solver's own.
    """
    solver = ElasticSolver(specimen.tissue, specimen.tissues, nodes=scope.checked**3)
    load, needle = specimen.load_without_labels(), plan.on(specimen.tissue)
    forces = consistent_load(load, needle, solver.nodes)
    found = np.moveaxis(solver.equilibrium(forces, tolerance=REFERENCE_ERROR).displacement, 0, -1)
    tissue = Tissue(solver.grid, specimen.tissue.entry_face)
    model = FiniteElementModel(tissue, solver.moduli, integration=solver.integration, solver="direct")
    expected = model.solve(load, needle) @ solver.grid.direction
    return {
        "specimen": specimen.name,
        "insertion": plan.name,
        "nodes": solver.grid.node_count,
        "difference": float(np.abs(found - expected).max() / np.abs(expected).max()),
    }


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
        factors[model] = factor(np.stack([at_pose(insertion, needle) for needle in needles]), np.stack(moved))
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
        {"specimen": name, "insertion": plan.name, "model": model} | _errors(field, expected, tissue, needle)
        for model, field in found.items()
    ]


def _errors(field: Array, reference: Array, tissue: Tissue, needle: Needle) -> Row:
    """Errors, and that at the tip over the largest displacement."""
    errors = asdict(displacement_errors(field, reference, grid=tissue.grid, tip=needle.tip))
    return errors | {"tip_share": errors["at_tip"] / float(np.linalg.norm(reference, axis=-1).max())}


@lru_cache(maxsize=1)  # the same in every cube
def _kernel_fields(
    tissue: Tissue, plan: PlannedInsertion, depths: int, tuned: NeedleTissueModel
) -> dict[str, list[Array]]:
    """Each kernel's displacement at each depth."""
    needles = equal_steps(plan.on(tissue), depths)
    return {
        model: [at_pose(insertion, needle) for needle in needles]
        for model, insertion in _kernels(tissue, tuned).items()
    }


@lru_cache(maxsize=1)  # the same in every cube
def _one_stiffness(
    scope: Scope, real: bool, tissue: Tissue, material: Material, load: LineLoad, plan: PlannedInsertion
) -> list[Array]:
    """Finite elements that are told the load and no labels, at each depth."""
    load_at = "deformed" if real else "undeformed"
    insertion = NeedleInsertion(ElasticModel(tissue, material, load, load_at=load_at, nodes=scope.side**3))
    return live(insertion, equal_steps(plan.on(tissue), scope.depths), scope.steps)


@lru_cache(maxsize=1)
def _held_without_labels(scope: Scope, plan: PlannedInsertion, tuned: NeedleTissueModel) -> dict[str, Array]:
    """The same at full depth, case D."""
    tissue = Tissue(Grid.unit_cube(scope.side))
    uniform, needle = ElasticSolver(tissue, Material(), nodes=scope.side**3), plan.on(tissue)
    fields = {model: at_pose(insertion, needle) for model, insertion in _kernels(tissue, tuned).items()}
    return fields | {"one stiffness": held_shaft(uniform, ShaftDisplacement(), needle)}


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
    side = tissue.grid.side
    return {
        "Table I": Insertion(tissue, NeedleTissueModel.paper(side)),
        "tuned": Insertion(tissue, tuned.scaled(side)),
        **{name: NeedleInsertion(make(name, tissue)) for name in others},
    }


def _labelled(specimen: Specimen) -> dict[str, NeedleInsertion]:
    """The models that know labels, besides the one that has the reference's own load."""
    others = [name for name in registry.able("labels") if name != "elastic"]
    return {name: NeedleInsertion(make(name, specimen.tissue, specimen.tissues)) for name in others}


def _by_tissue(names: Mapping[int, str], labels: NDArray[np.integer], field: Array, reference: Array) -> Row:
    """Mean error over mean displacement within each tissue that is more than a few nodes, and moves."""
    error, size = (np.linalg.norm(values, axis=-1) for values in (field - reference, reference))
    moves = size > 0
    found = {}
    for label in np.unique(labels):
        here = moves & (labels == label)
        if here.sum() > _SMALLEST_TISSUE * moves.sum() and size[here].mean() > _STILL * size[moves].mean():
            found[names.get(int(label), "background")] = float(error[here].mean() / size[here].mean())
    return found
