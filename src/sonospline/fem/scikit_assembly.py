"""The matrices of a system, by scikit-fem.

A stiffness is Hooke's law applied to integrals of products of two derivatives, so only scalar
matrices are integrated: six instead of nine times as many entries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from .engine import System

Array = NDArray[np.float64]

_VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
"""Place of a strain's component among xx, yy, zz, yz, xz, xy."""
_CENTRE = (np.full((3, 1), 0.5), np.ones(1))
"""The one-point quadrature of a hexahedron: point and weight."""


@dataclass(frozen=True, eq=False)
class Matrices:
    """The matrices of a system; those that act on displacements have a 3 x 3 block for a pair of nodes."""

    mass: Any
    """(N, N) consistent mass matrix of one component."""
    stiffness: Any
    """(3N, 3N), all nodes."""
    free: Any
    """The rows and columns of the stiffness that belong to nodes not pinned."""


def assemble(system: System) -> Matrices:
    """Return the matrices of a system."""
    basis, mean_basis, mass_basis = _bases(system)
    products = _derivative_products(basis)
    mean = products if mean_basis is basis else _derivative_products(mean_basis)
    dilatation = mean if system.integration == "mean_dilatation" else products
    layered, excess = system.layers
    of_layered = {axes: product[..., layered] for axes, product in mean.items()}
    local = len(basis.element_dofs)
    rows = np.tile(basis.element_dofs, (local, 1, 1))  # [column, row, cell], as scikit-fem orders its entries
    columns = np.swapaxes(rows, 0, 1)
    nodes = len(system.points)
    pairs, place = np.unique(rows.ravel() * np.int64(nodes) + columns.ravel(), return_inverse=True)
    laplace = products[0, 0] + products[1, 1] + products[2, 2]
    lame, shear = system.moduli
    blocks = np.empty((len(pairs), 3, 3))
    for a in range(3):
        for b in range(3):
            entries = lame * dilatation[a, b] + shear * products[b, a] + (shear * laplace if a == b else 0)
            for (c, d), product in of_layered.items():
                entries[..., layered] += excess[:, _VOIGT[a, c], _VOIGT[b, d]] * product
            blocks[:, a, b] = np.bincount(place, weights=entries.ravel())
    if len(system.springs):
        blocks[np.searchsorted(pairs, np.arange(nodes) * (nodes + np.int64(1)))] += system.springs
    starts = np.searchsorted(pairs, np.arange(nodes + 1) * nodes).astype(np.int32)
    numbers = (pairs % nodes).astype(np.int32)
    return Matrices(
        _form(lambda u, v, _: u * v).assemble(mass_basis),
        _block_matrix(blocks, numbers, starts),
        _between(blocks, numbers, starts, np.flatnonzero(~system.pinned)),
    )


def _bases(system: System) -> tuple[Any, Any, Any]:
    """Bases for the stiffness, its parts of the mean strain and the mass; quadrature is exact on parallelepipeds."""
    skfem = require("skfem")
    points = np.ascontiguousarray(system.points.T)
    if system.cells.shape[1] == 4:
        mesh, element = skfem.MeshTet(points, np.ascontiguousarray(system.cells.T)), skfem.ElementTetP1()
        constant = skfem.Basis(mesh, element, intorder=1)
        return constant, constant, skfem.Basis(mesh, element, intorder=2)
    corners = skfem.MeshHex.elem.refdom.p.T @ (1, 2, 4)  # its own order of the tensor-product corners
    cells = np.ascontiguousarray(system.cells[:, corners.astype(int)].T)
    mesh, element = skfem.MeshHex(points, cells, validate=False), skfem.ElementHex1()
    full = skfem.Basis(mesh, element, intorder=2)
    # The gradient of a trilinear displacement at the centre is its mean over a parallelepiped.
    return full, skfem.Basis(mesh, element, quadrature=_CENTRE), full


def _derivative_products(basis: Any) -> dict[tuple[int, int], Array]:
    """Integrals over each cell of d_a v_i d_b u_j, as [j, i, cell], for each a and b."""
    local = len(basis.element_dofs)
    products = {}
    for a in range(3):
        for b in range(a, 3):
            form = _form(lambda u, v, _, a=a, b=b: v.grad[a] * u.grad[b])
            products[a, b] = form.coo_data(basis).data.reshape(local, local, -1)
            products[b, a] = np.swapaxes(products[a, b], 0, 1)
    return products


def _form(integrand: Any) -> Any:
    return require("skfem").BilinearForm(integrand)


def _block_matrix(blocks: Array, columns: NDArray[np.int32], starts: NDArray[np.int32]) -> Any:
    from scipy.sparse import bsr_matrix

    size = 3 * (len(starts) - 1)
    return bsr_matrix((blocks, columns, starts), shape=(size, size))


def _between(blocks: Array, columns: NDArray[np.int32], starts: NDArray[np.int32], nodes: NDArray[np.int64]) -> Any:
    """The block matrix of some of the nodes among themselves."""
    from scipy.sparse import csr_matrix

    size = len(starts) - 1
    numbered = csr_matrix((np.arange(len(columns)), columns, starts), shape=(size, size))
    part = numbered[nodes][:, nodes]
    return _block_matrix(blocks[part.data], part.indices, part.indptr)
