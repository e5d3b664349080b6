"""The tissue: a grid and its pinned faces."""

import numpy as np
import pytest

import sonospline as ss


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
