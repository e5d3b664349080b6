"""The labelled cubes in the elastic solver, and the same cells in the reference finite elements."""

import numpy as np

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.elasticity import ElasticSolver
from sonospline.fem import FiniteElementModel
from sonospline.fem.consistent_load import consistent_load
from sonospline.mechanics import LineForce, Material, TissueMap, labelled_cube

NEEDLE = ss.Needle((0, 0.3, 0.5), (0.6, 0.5, 0.5))


def bone_of(contrast):
    """A bar of bone so many times as stiff as the tissue around it."""
    tissues = labelled_cube("bone", voxels=48)
    bone = Material(stiffness_kpa=contrast)
    return TissueMap(tissues.labels, {**tissues.materials, 1: bone})


def bone_in_part(name="body"):
    """A cube whose stiffest tissue is bone, which ends within cells of 9^3 nodes."""
    tissues = labelled_cube(name, voxels=30)
    hardest = max(tissues.materials, key=lambda label: tissues.materials[label].stiffness_kpa)
    return TissueMap(tissues.labels, {**tissues.materials, hardest: Material(rigid=True)})


def away_from_reference(tissues, nodes, *, integration="mean_dilatation", **options):
    """Largest difference of the two converged fields, over the peak."""
    tissue = ss.Tissue(ss.Grid.unit_cube(nodes))
    solver = ElasticSolver(tissue, tissues, nodes=nodes**3, integration=integration)
    assert solver.grid.shape == tissue.grid.shape
    model = FiniteElementModel(tissue, solver.moduli, integration=integration, **options)
    found = solver.equilibrium(consistent_load(LineForce(), NEEDLE, solver.nodes), tolerance=2e-5).displacement
    return largest_difference(np.moveaxis(found, 0, -1), model.solve(LineForce(), NEEDLE))


def torso(**keywords):
    """A label map with names, 90 x 90 x 60 mm: bone behind, a liver with a vessel, a kidney, all on one side."""
    x, y, z = np.indices((31, 31, 21))
    labels = np.zeros(x.shape, np.uint8)
    labels[(x > 17) & (y > 12)] = 2
    labels[(x - 24) ** 2 + (z - 10) ** 2 < 9] = 3
    labels[(x - 14) ** 2 + (y - 20) ** 2 + (z - 10) ** 2 < 20] = 4
    labels[(x > 12) & (x < 20) & (y > 2) & (y < 8)] = 1
    names = {1: "vertebrae_L1", 2: "liver", 3: "aorta", 4: "kidney_left"}
    return ss.LabelMap(voxels=labels, spacing=(3.0, 3.0, 3.0), names=names, **keywords)
