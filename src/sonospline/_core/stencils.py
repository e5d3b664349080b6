"""Operators over the nodes of a lattice as 3 x 3 blocks to a node itself and to its 26 neighbours.

Half of the blocks are kept (126, nx, ny, nz): number 9 d + 3 a + b is component (a, b) of the block
from a node to its neighbour ``OFFSETS[d]``; blocks to the other neighbours are transposes of theirs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]
Index = NDArray[np.int64]
Lattice = tuple[int, int, int]

OFFSETS = tuple((x, y, z) for x in (0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if 9 * x + 3 * y + z >= 0)
"""Of the neighbours whose blocks are kept: the node itself and the 13 after it."""


def coarser(nodes: Lattice, halved: Sequence[bool] | NDArray[np.bool_]) -> Lattice:
    """Return the nodes of a grid that has every second one, and the last, along some axes."""
    x, y, z = (n // 2 + 1 if half else n for n, half in zip(nodes, halved, strict=True))
    return x, y, z


def nested(nodes: int, coarse: int) -> NDArray[np.int64]:
    """Return which nodes along an axis the coarse ones are."""
    return np.arange(nodes) if nodes == coarse else np.minimum(2 * np.arange(coarse), nodes - 1)


def to_sparse(stencil: Single) -> Any:
    """Return the operator as a sparse matrix over (component, node)."""
    from scipy.sparse import coo_matrix

    shape = stencil.shape[1:]
    size = 3 * int(np.prod(shape))
    rows, columns, values = [], [], []
    for entry, here, row, column in _entries(shape):
        block = stencil[entry][here].ravel().astype(float)
        itself = entry < 9  # a node's own block is kept whole
        rows += [row] if itself else [row, column]
        columns += [column] if itself else [column, row]
        values += [block] if itself else [block, block]
    joined = [np.concatenate(parts) for parts in (values, rows, columns)]
    return coo_matrix((joined[0], (joined[1], joined[2])), shape=(size, size)).tocsr()


def from_sparse(matrix: Any, shape: Lattice) -> Single:
    """Return a matrix over (component, node) as the blocks of a lattice; what lies beyond neighbours is none."""
    dense = matrix.tocsr()
    stencil = np.zeros((9 * len(OFFSETS), *shape), np.float32)
    for entry, here, row, column in _entries(shape):
        values = stencil[entry][here]
        values[...] = np.asarray(dense[row, column]).reshape(values.shape)
    return stencil


def _entries(shape: tuple[int, ...]) -> Iterator[tuple[int, tuple[slice, ...], Index, Index]]:
    """Of each entry of a stencil its number, the nodes that have that neighbour, and the matrix's rows and columns."""
    number = np.arange(np.prod(shape)).reshape(shape)
    for place, offset in enumerate(OFFSETS):
        here = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, shape, strict=True))
        there = tuple(slice(max(0, o), n - max(0, -o)) for o, n in zip(offset, shape, strict=True))
        for a, b in np.ndindex(3, 3):
            row, column = a * number.size + number[here].ravel(), b * number.size + number[there].ravel()
            yield 9 * place + 3 * a + b, here, row, column
