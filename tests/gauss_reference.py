"""Finite elements assembled here from scikit-fem's cells: the load by Gauss points, the nodes of rigid cells held."""

import numpy as np
import pyamg
import skfem
from scipy.sparse import coo_matrix, diags
from skfem.helpers import ddot, div, sym_grad

from judged_pass import mean_length

CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T


def cell_stiffness(spacing):
    """Dilatation and distortion (24, 24) of a cell of unit moduli, corner by corner: B-bar."""
    mesh = skfem.MeshHex.init_tensor(*[np.array([0.0, h]) for h in spacing])
    element = skfem.ElementVector(skfem.ElementHex1())
    full = skfem.Basis(mesh, element, intorder=3)
    middle = skfem.Basis(mesh, element, quadrature=(np.full((3, 1), 0.5), np.ones(1)))
    distortion = skfem.BilinearForm(lambda u, v, _: 2 * ddot(sym_grad(u), sym_grad(v))).assemble(full).toarray()
    dilatation = skfem.BilinearForm(lambda u, v, _: div(u) * div(v)).assemble(middle).toarray()
    places = np.rint(mesh.p.T / spacing).astype(int)
    order = [int(np.flatnonzero((places == corner).all(axis=1))[0]) for corner in CORNERS]
    unknowns = full.nodal_dofs[:, order].T.ravel()
    return dilatation[np.ix_(unknowns, unknowns)], distortion[np.ix_(unknowns, unknowns)]


def mean_strain(spacing):
    """Mean strain (6, 24) of a cell, xx, yy, zz and twice yz, xz, xy, of its corners' displacements."""
    slopes = (2 * CORNERS - 1) / (4 * spacing)  # of each hat function, at the middle
    strain = np.zeros((6, 8, 3))
    for axis in range(3):
        strain[axis, :, axis] = slopes[:, axis]
    for row, (a, b) in enumerate(((1, 2), (0, 2), (0, 1)), start=3):
        strain[row, :, a], strain[row, :, b] = slopes[:, b], slopes[:, a]
    return strain.reshape(6, 24)


def corner_slices(cells):
    return [tuple(slice(start, start + n) for start, n in zip(corner, cells, strict=True)) for corner in CORNERS]


def gauss_load(grid, body_force, points=4):
    """Integrals (nx, ny, nz, 3) of a force per volume times the hat functions."""
    x, weights = np.polynomial.legendre.leggauss(points)
    x, weights, cells = (x + 1) / 2, weights / 2, np.array(grid.shape) - 1
    index, out = np.indices(cells).reshape(3, -1).T, np.zeros((*grid.shape, 3))
    for at in np.ndindex(points, points, points):
        place = x[list(at)]
        force = body_force(grid.world((index + place) * grid.spacing)) @ grid.direction
        force = force.reshape(*cells, 3) * weights[list(at)].prod() * np.prod(grid.spacing)
        for corner, where in zip(CORNERS, corner_slices(cells), strict=True):
            out[where] += np.where(corner, place, 1 - place).prod() * force
    return out


def field_under(tissue, moduli, load):
    """Displacement (nx, ny, nz, 3), along the grid's axes, under nodal forces (nx, ny, nz, 3)."""
    grid = moduli.grid
    number = np.arange(grid.node_count).reshape(grid.shape)
    corners = np.stack([number[where].ravel() for where in corner_slices(moduli.lame.shape)], axis=1)
    held = np.zeros(grid.node_count, bool) if moduli.walls.springs.size else grid.on_faces(tissue.pinned_faces).ravel()
    held[corners[moduli.rigid.ravel()]] = True
    springs = np.zeros((grid.node_count, 3))
    of_bone = np.ravel_multi_index(tuple(moduli.bone.cells.T), moduli.lame.shape)
    lame, shear = (values.ravel()[of_bone, None] for values in moduli.lame_moduli)
    across = shear + (lame + shear) * moduli.bone.facing
    stiff = 10 * np.prod(grid.spacing) ** (1 / 3) * moduli.bone.shares[..., None] * across[:, None]
    np.add.at(springs, corners[of_bone], stiff)
    springs += np.moveaxis(moduli.walls.at_nodes(moduli.shear) + np.zeros((3, *grid.shape)), 0, -1).reshape(-1, 3)
    dilatation, distortion = cell_stiffness(np.array(grid.spacing))
    entries = moduli.lame.reshape(-1, 1, 1) * dilatation + moduli.shear.reshape(-1, 1, 1) * distortion
    layered = np.ravel_multi_index(tuple(moduli.layers.cells.T), moduli.lame.shape)
    strain = mean_strain(np.array(grid.spacing))
    entries[layered] += np.prod(grid.spacing) * strain.T @ moduli.layers.excess @ strain
    unknowns = (3 * corners[:, :, None] + np.arange(3)).reshape(-1, 24)
    rows, columns = np.repeat(unknowns, 24, axis=1).ravel(), np.tile(unknowns, (1, 24)).ravel()
    free = np.flatnonzero(np.repeat(~held, 3))
    matrix = coo_matrix((entries.ravel(), (rows, columns)), shape=(3 * grid.node_count,) * 2).tocsr()
    matrix = (matrix + diags(springs.ravel())).tocsr()[free][:, free]
    found = np.zeros(3 * grid.node_count)
    solver = pyamg.smoothed_aggregation_solver(matrix, B=rigid_motions(grid.points)[free])
    found[free] = solver.solve(load.reshape(-1)[free], tol=1e-8, accel="cg", maxiter=500)
    return found.reshape(*grid.shape, 3)


def rigid_motions(points):
    about = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    motions = np.zeros((len(points), 3, 6))
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        motions[:, axis, axis] = 1
        motions[:, b, 3 + axis], motions[:, a, 3 + axis] = about[:, a], -about[:, b]
    return motions.reshape(-1, 6)


def same_cells(model, response, case):
    """How far a finished field is from this one under the same nodal forces, over the mean."""
    solver, solution = model.solver, response.state.solution
    expected = np.moveaxis(field_under(case.tissue, solver.moduli, np.moveaxis(solution.load, 0, -1)), -1, 0)
    return mean_length(solution.displacement - expected) / mean_length(expected)
