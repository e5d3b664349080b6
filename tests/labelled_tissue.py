"""The labelled cubes in the elastic solver, and the same cells in the reference finite elements."""

import numpy as np

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.fem import FiniteElementModel
from sonospline.mechanics import LineForce, Material, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticSolver

NEEDLE = ss.Needle((0, 0.3, 0.5), (0.6, 0.5, 0.5))


def bone_of(contrast):
    """A bar of bone so many times as stiff as the tissue around it."""
    tissues = labelled_cube("bone", voxels=48)
    bone = Material(stiffness_kpa=contrast, rigid=True)
    return TissueMap(tissues.labels, {**tissues.materials, 1: bone})


def consistent_load(load, needle, grid):
    """Nodal forces of a force per volume that is linear between the nodes, as the reference takes it."""
    forces = np.moveaxis((load.body_force(grid.points, needle) @ grid.direction).reshape(*grid.shape, 3), -1, 0)
    for axis, (count, spacing) in enumerate(zip(grid.shape, grid.spacing, strict=True), 1):
        mass = np.diag(np.full(count, 4.0)) + np.eye(count, k=1) + np.eye(count, k=-1)
        mass[0, 0] = mass[-1, -1] = 2
        forces = np.moveaxis(np.tensordot(mass * spacing / 6, forces, (1, axis)), 0, axis)
    return forces


def away_from_reference(tissues, nodes, *, integration="mean_dilatation", **options):
    """Largest difference of the two converged fields, over the peak."""
    tissue = ss.Tissue(ss.Grid.unit_cube(nodes))
    solver = ElasticSolver(tissue, tissues, nodes=nodes**3, integration=integration)
    assert solver.grid.shape == tissue.grid.shape
    model = FiniteElementModel(tissue, solver.moduli, integration=integration, **options)
    found = solver.equilibrium(consistent_load(LineForce(), NEEDLE, solver.grid), tolerance=2e-5).displacement
    return largest_difference(np.moveaxis(found, 0, -1), model.solve(LineForce(), NEEDLE))
