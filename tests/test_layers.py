"""Cells of several tissues are stiff along their layers and soft across, and what that is worth on coarse grids."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.elasticity import ElasticSolver
from sonospline.geometry.volume import Volume
from sonospline.mechanics import LineForce, Material, TissueMap
from sonospline.mechanics import layers as layers_module
from sonospline.mechanics.cell_samples import CellSamples
from sonospline.mechanics.cell_slopes import directions
from sonospline.mechanics.layers import excess_of_layers, turned

SIDE = 100.0
LOAD, NEEDLE = LineForce(30.0, 700.0, 5.0), ss.Needle((0, 30, 50), (60, 50, 50))
TILTED = np.array([1.0, -0.5, 0.35]) / np.linalg.norm([1.0, -0.5, 0.35])


def fascia(normal=TILTED, *, offset=22.9, thickness=2.0, stiffness=20.0, voxels=96):
    """A stiff sheet across a cube of 100 mm."""
    x, y, z = np.meshgrid(*[(np.arange(voxels) + 0.5) * SIDE / voxels] * 3, indexing="ij")
    depth = normal[0] * x + normal[1] * y + normal[2] * z - offset
    labels = ((depth >= 0) & (depth < thickness)).astype(np.uint8)
    volume = Volume(voxels=labels, spacing=(SIDE / voxels,) * 3, origin=np.full(3, SIDE / voxels / 2))
    return TissueMap(volume, {0: Material(10), 1: Material(10 * stiffness)})


def grid_of(nodes):
    return ss.Grid(shape=(nodes,) * 3, spacing=SIDE / (nodes - 1))


def isotropic(lame, shear):
    stiffness = np.zeros((6, 6))
    stiffness[:3, :3] = lame
    return stiffness + shear * np.diag([2.0, 2, 2, 1, 1, 1])


def test_layers_of_one_tissue_have_its_stiffness(rng):
    normal = rng.normal(size=(1, 3))
    normal /= np.linalg.norm(normal)
    moduli = np.full((4, 1), 9.0), np.full((4, 1), 2.0)
    excess = excess_of_layers(*moduli, np.full((4, 1), 0.25), normal, (np.array([5.0]), np.array([1.0])))
    np.testing.assert_allclose(excess[0], isotropic(9, 2) - isotropic(5, 1), atol=1e-12)


def test_layers_are_in_series_across_and_side_by_side_along(rng):
    """What each layer does is solved for: strains along the layers are shared, stresses across them are."""
    lame, shear, shares = rng.uniform(1, 9, (3, 1)), rng.uniform(1, 9, (3, 1)), np.array([[0.2], [0.5], [0.3]])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    excess = excess_of_layers(lame, shear, shares, turn[:, 2][None], (np.zeros(1), np.zeros(1)))[0]
    strain = rng.normal(size=(3, 3))
    strain = strain + strain.T
    local = turn.T @ strain @ turn
    # unknown strain of each layer across: e_zz, e_yz, e_xz; equal stress in all, the given mean
    energy, parts = 0.0, shares[:, 0]
    across = {
        (2, 2): (lame + 2 * shear)[:, 0],
        (1, 2): 2 * shear[:, 0],
        (0, 2): 2 * shear[:, 0],
    }
    of_layer = np.repeat(local[None], 3, axis=0)
    for (i, j), stiffness in across.items():
        pressed = lame[:, 0] * (local[0, 0] + local[1, 1]) if i == j else 0 * stiffness
        stress = (local[i, j] + (parts * pressed / stiffness).sum()) / (parts / stiffness).sum()
        of_layer[:, i, j] = of_layer[:, j, i] = (stress - pressed) / stiffness
    for part, first, second, e in zip(parts, lame[:, 0], shear[:, 0], of_layer, strict=True):
        energy += part * (first * np.trace(e) ** 2 + 2 * second * (e * e).sum())
    voigt = np.append(strain.diagonal(), [2 * strain[a, b] for a, b in ((1, 2), (0, 2), (0, 1))])
    assert voigt @ excess @ voigt == pytest.approx(energy)


@pytest.mark.parametrize("thickness", [2.0, 30.0], ids=["a sheet within a cell", "a wall thicker than cells"])
def test_the_direction_across_layers_is_found_to_a_few_degrees(thickness):
    tissues, grid = fascia(thickness=thickness), grid_of(25)
    cells = CellSamples(tissues.labels, tissues.labels.voxels, grid, 0)
    found = directions(cells, np.argwhere(cells.mixed), np.log([1.0, 20.0]), np.array(grid.spacing))
    angle = np.degrees(np.arccos(np.minimum(1, np.abs(found @ TILTED))))
    assert np.sqrt((angle**2).mean()) < 6


@pytest.mark.parametrize("normal", [(1.0, 0, 0), (0, 1.0, 0)])
def test_a_sheet_along_the_cells_keeps_its_tension_and_yields_across(normal):
    layers = fascia(np.array(normal), offset=26.0, stiffness=30.0).moduli(grid_of(25)).layers
    assert len(layers.cells) == 24 * 24
    normal_axis = int(np.argmax(normal))
    shear = layers.excess[:, [3, 4, 5], [3, 4, 5]]  # in the planes across x, y, z
    along_the_sheet = np.arange(3) == normal_axis
    assert (layers.excess[:, normal_axis, normal_axis] < 0).all()
    assert (shear[:, along_the_sheet] > 0).all() and (shear[:, ~along_the_sheet] < 0).all()


def test_tissue_of_like_stiffness_has_no_layers():
    assert not len(fascia(stiffness=1.4).moduli(grid_of(13)).layers.cells)
    assert len(fascia(stiffness=1.6).moduli(grid_of(13)).layers.cells)


def away(tissues, nodes, expected, display):
    """Mean difference of the converged field from a finer one, over its mean."""
    solver = ElasticSolver(display, tissues, nodes=nodes**3)
    found = solver.field(solver.solve(LOAD, NEEDLE, tolerance=1e-3)).on_grid()
    return np.linalg.norm(found - expected, axis=-1).mean() / np.linalg.norm(expected, axis=-1).mean()


@pytest.mark.slow
@pytest.mark.parametrize(("coarse", "fine", "most"), [(13, 49, 0.1), (25, 97, 0.03), (49, 97, 0.015)])
def test_a_sheet_thinner_than_the_cells_is_resolved_by_its_layers(monkeypatch, coarse, fine, most):
    """At least twice as well as by the mean of its moduli; its voxels are the cells of the finer grid."""
    tissues = fascia(thickness=SIDE / (fine - 1) * 2, voxels=fine - 1)
    display = ss.Tissue(grid_of(min(fine, 49)))
    reference = ElasticSolver(display, tissues, nodes=fine**3)
    expected = reference.field(reference.solve(LOAD, NEEDLE, tolerance=1e-3)).on_grid()
    layered = away(tissues, coarse, expected, display)
    monkeypatch.setattr(layers_module, "LEAST_CONTRAST", np.inf)
    assert layered < most
    assert layered < 0.5 * away(tissues, coarse, expected, display)


def test_layers_seen_along_other_axes_are_those_of_a_turned_normal(a_rotation):
    lame, shear, half = np.array([[3.0], [40.0]]), np.array([[1.0], [9.0]]), np.full((2, 1), 0.5)
    mean = np.array([5.0]), np.array([2.0])
    expected = excess_of_layers(lame, shear, half, (TILTED @ a_rotation)[None], mean)
    np.testing.assert_allclose(
        turned(excess_of_layers(lame, shear, half, TILTED[None], mean), a_rotation), expected, atol=1e-9
    )
