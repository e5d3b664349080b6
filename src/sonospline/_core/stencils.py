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


def hold(stencil: Single, springs: Single) -> None:
    """Add to the stencil of a coarser grid what springs (3, nx, ny, nz) at nodes of the finer become: P^T S P."""
    moving, coarse = stencil[0] > 0, stencil.shape[1:]
    held = np.argwhere(springs.any(axis=0))
    axes = [_parents(n, m, at) for n, m, at in zip(springs.shape[1:], coarse, held.T, strict=True)]
    parents, shares = [], []
    for corner in np.ndindex(2, 2, 2):
        node = tuple(first + second for (first, _), second in zip(axes, corner, strict=True))
        share = np.prod([weight if second else 1 - weight for (_, weight), second in zip(axes, corner, strict=True)], 0)
        node = tuple(np.minimum(at, m - 1) for at, m in zip(node, coarse, strict=True))  # beyond, a share is zero
        parents.append(np.ravel_multi_index(node, coarse))
        shares.append(share * moving[node])
    amounts = springs[:, *held.T]
    for p, q in np.ndindex(8, 8):
        place = sum(step * ((q >> bit & 1) - (p >> bit & 1)) for step, bit in ((9, 2), (3, 1), (1, 0)))
        if place >= 0:
            for axis in range(3):
                of_pair = amounts[axis] * shares[p] * shares[q]
                stencil[9 * place + 4 * axis] += np.bincount(parents[p], of_pair, moving.size).reshape(coarse)


def _parents(nodes: int, coarse: int, at: Index) -> tuple[Index, NDArray[np.float64]]:
    """The first of the two coarse nodes that nodes of an axis lie between, and their share of the second."""
    if nodes == coarse:
        return at, np.zeros(len(at))
    last = at == nodes - 1
    return np.where(last, coarse - 1, at // 2), np.where(last, 0.0, at % 2 / 2)


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
