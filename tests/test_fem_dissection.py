"""The order in which a factor eliminates nodes."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

import sonospline as ss
from sonospline.fem.dissection import nested_dissection


def laplacian(shape):
    """The 27-point graph Laplacian of a lattice, made definite."""
    index = np.indices(shape).reshape(3, -1).T
    pairs = KDTree(index).query_pairs(1.8, output_type="ndarray")
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    count = len(index)
    coupled = csr_matrix((np.full(len(rows), -1.0), (rows, columns)), shape=(count, count))
    return coupled + csr_matrix((np.full(count, 27.0), (np.arange(count),) * 2))


@pytest.mark.parametrize("shape", [(9, 8, 7), (40, 3, 2), (2, 2, 2)])
def test_every_node_is_eliminated_once(shape, a_rotation):
    grid = ss.Grid(shape=shape, spacing=(1, 2, 0.5), direction=a_rotation)
    order = nested_dissection(grid.points, laplacian(grid.shape))
    assert np.array_equal(np.sort(order), np.arange(grid.node_count))


def test_the_factor_is_smaller_than_with_the_orderings_of_superlu():
    grid = ss.Grid.unit_cube(17)
    matrix = laplacian(grid.shape)
    order = nested_dissection(grid.points, matrix)
    options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    ours = splu(matrix[order][:, order].tocsc(), permc_spec="NATURAL", **options)
    for theirs in ("MMD_AT_PLUS_A", "COLAMD", "NATURAL"):
        assert ours.nnz < 0.95 * splu(matrix.tocsc(), permc_spec=theirs, **options).nnz


def test_nodes_in_one_place_are_left_as_they_are():
    order = nested_dissection(np.zeros((50, 3)), csr_matrix(np.ones((50, 50))))
    assert np.array_equal(order, np.arange(50))
