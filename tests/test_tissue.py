"""The tissue: a grid and its pinned faces."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonospline as ss
from sonospline.mechanics import Material
from sonospline.models.elastic import ElasticInsertion


@pytest.mark.parametrize("entry_face", ss.FACES)
def test_five_faces_and_the_rim_of_the_sixth_are_pinned(entry_face, a_tilted_grid):
    tissue = ss.Tissue(a_tilted_grid, entry_face=entry_face)
    assert set(tissue.pinned_faces) == set(ss.FACES) - {entry_face}
    free = np.argwhere(~tissue.pinned)
    axis, last = "xyz".index(entry_face[0]), np.array(a_tilted_grid.shape) - 1
    # Free: the interior, and the open face without its rim.
    assert len(free) == np.prod([n - (1 if a == axis else 2) for a, n in enumerate(a_tilted_grid.shape)])
    on_open_face = free[:, axis] == (0 if entry_face[1] == "-" else last[axis])
    assert on_open_face.sum() == np.prod(np.delete(np.array(a_tilted_grid.shape) - 2, axis))


def test_paper_cube_pins_2929_nodes():
    assert ss.Tissue(ss.Grid.unit_cube(25)).pinned.sum() == 2929


def test_boundary_drift_is_the_largest_move_of_a_pinned_node(unit_tissue):
    displacement = np.zeros((13, 13, 13, 3))
    displacement[0, 6, 6] = 9  # the open face may move
    displacement[5, 6, 7] = 9  # and so may the interior
    assert unit_tissue.boundary_drift(displacement) == 0
    displacement[12, 6, 6] = [0, 3, 4]
    displacement[0, 0, 6] = [0, 0, 2]  # the rim of the open face is pinned
    assert unit_tissue.boundary_drift(displacement) == 5


def test_bad_tissue_is_refused():
    with pytest.raises(ValueError, match=r"grid = 53 is not a Grid; make one"):
        ss.Tissue(53)
    with pytest.raises(ValueError, match=r"entry_face = 'top' is not known; choose one of x-"):
        ss.Tissue(ss.Grid.unit_cube(3), entry_face="top")


def header(rng, tilted):
    """A box as a float32 header gives it, and a function from places (shares of the box) to printed points."""
    shape, spacing = rng.integers(20, 400, 3), rng.uniform(0.3, 5, 3).astype(np.float32)
    origin = rng.uniform(-400, 400, 3).astype(np.float32)
    axes = Rotation.from_quat(rng.normal(size=4)).as_matrix() if tilted else np.diag(rng.choice([-1, 1], 3))
    axes = axes.astype(np.float32)
    sides = (shape - 1).astype(np.float32) * spacing
    grid = ss.Grid.covering(sides.astype(float), nodes=1000, origin=origin, direction=axes)
    return grid, lambda share: origin + axes @ (np.asarray(share, np.float32) * sides)


PRINTS = {"float32": lambda point: [float(str(x)) for x in point], "3 decimals": lambda point: np.round(point, 3)}


@pytest.mark.slow
@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("print_", PRINTS.values(), ids=PRINTS)
def test_a_point_on_a_face_is_inside_however_it_was_printed(rng, print_, tilted):
    for _ in range(200):
        grid, place = header(rng, tilted)
        share = rng.random(3)
        share[rng.integers(3)] = rng.integers(2)
        ss.Tissue(grid).check_inside(entry=np.array(print_(place(share)), float))


@pytest.mark.parametrize("make", [ss.Insertion, ss.KelvinletInsertion, lambda t: ElasticInsertion(t, Material())])
def test_every_model_takes_a_printed_face_as_the_face(make, rng):
    grid, place = header(rng, tilted=True)
    insertion = make(ss.Tissue(grid))
    exact, printed = (
        ss.Needle(as_(place((0, 0.4, 0.5))), as_(place((0.5, 0.5, 0.5))))
        for as_ in (lambda point: point.astype(float), lambda point: np.round(point.astype(float), 3))
    )
    there, here = (insertion.advance(needle).on_grid().copy() for needle in (exact, printed))
    assert np.abs(there - here).max() < 1e-2 * np.abs(there).max()


@pytest.mark.parametrize("tilted", [False, True])
def test_a_point_outside_is_told_the_way_in(rng, tilted):
    """What the message names is taken, and it names the face and the distance."""
    for _ in range(50):
        grid, _ = header(rng, tilted)
        tissue = ss.Tissue(grid)
        local = grid.extent / 2
        axis = int(rng.integers(3))
        local[axis] = grid.extent[axis] + 12.5
        with pytest.raises(ValueError, match=f"12.5 beyond its face {'xyz'[axis]}[+];") as refused:
            tissue.check_inside(tip=grid.world(local[None])[0])
        numbers = [float(x) for x in re.findall(r"-?[\d.]+(?:e-?\d+)?", str(refused.value).split(";")[1])]
        if tilted:
            tissue.check_inside(tip=np.array(numbers))
        else:
            tissue.check_inside(low=np.array(numbers[::2]), high=np.array(numbers[1::2]))


@pytest.mark.parametrize("share", [-1e-4, 1.0001])
def test_a_point_a_little_outside_is_outside(share, a_tilted_grid):
    tissue = ss.Tissue(a_tilted_grid)
    with pytest.raises(ValueError, match="lies outside the tissue"):
        tissue.check_inside(tip=a_tilted_grid.world((share * a_tilted_grid.extent)[None])[0])


def test_distance_to_pinned_faces_by_hand(unit_tissue):
    points = np.array([[0, 0.5, 0.5], [0.9, 0.5, 0.5], [0.5, 0.2, 0.7], [0.5, 0.5, 0], [1 + 1e-9, 0.5, 0.5]])
    np.testing.assert_allclose(unit_tissue.distance_to_pinned(points), [0.5, 0.1, 0.2, 0, 0], atol=1e-12)
