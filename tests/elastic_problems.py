"""Problems with a known answer, for any finite element engine."""

import numpy as np

import sonospline as ss
from sonospline.fem.engine import System
from sonospline.fem.mesh import cells
from sonospline.mechanics import Material

GRADIENT = np.array([[0.02, -0.01, 0.03], [0.015, -0.02, 0.01], [-0.005, 0.01, 0.025]])


def largest_difference(a, b):
    """Relative to the peak."""
    return np.abs(a - b).max() / np.abs(b).max()


def on_grid(grid, *, element, integration="full", solver="direct", poissons_ratio=0.3, tolerance=1e-12):
    """A system whose whole boundary is prescribed."""
    return System(
        points=grid.points,
        cells=cells(grid, element),
        pinned=grid.on_faces(ss.FACES).ravel(),
        material=Material(stiffness_kpa=2.0, poissons_ratio=poissons_ratio),
        integration=integration,
        solver=solver,
        tolerance=tolerance,
    )


def system_of(solver):
    """The solver's operator, to be assembled by scikit-fem and factored."""
    return System(
        points=solver.grid.points,
        cells=cells(solver.grid, "hexahedron"),
        pinned=solver.free.ravel() == 0,
        material=solver.moduli,
        integration=solver.integration,
        solver="direct",
        tolerance=1e-12,
    )


def patch_error(engine_type, grid, **options):
    """Largest error, relative to the largest displacement, where the exact one is linear."""
    system = on_grid(grid, **options)
    exact = system.points @ GRADIENT.T + (0.1, -0.2, 0.3)
    prescribed = np.where(system.pinned[:, None], exact, np.nan)  # nothing else may be read
    found, _ = engine_type(system).solve(np.zeros_like(exact), prescribed)
    return np.abs(found - exact).max() / np.abs(exact).max()


def manufactured_error(engine_type, nodes, **options):
    """L2 error, relative, for u = c sin(pi x) sin(pi y) sin(pi z) on the unit cube."""
    system = on_grid(ss.Grid.unit_cube(nodes), **options)
    force = _force(system.points, system.material)
    found, _ = engine_type(system).solve(force, np.zeros_like(force))
    at_centres = found[system.cells].mean(axis=1)
    exact = _exact(system.points[system.cells].mean(axis=1))
    return np.linalg.norm(at_centres - exact) / np.linalg.norm(exact)


_AMPLITUDE = np.array([0.3, -0.5, 0.2])


def _exact(points):
    return np.prod(np.sin(np.pi * points), axis=1)[:, None] * _AMPLITUDE


def _force(points, material):
    """-div sigma = -(lambda + mu) grad div u - mu laplace u of the exact displacement."""
    sine, cosine = np.sin(np.pi * points), np.cos(np.pi * points)
    hessian = np.empty((len(points), 3, 3))
    for a in range(3):
        for b in range(3):
            factors = [cosine[:, k] if (a != b and k in (a, b)) else sine[:, k] for k in range(3)]
            hessian[:, a, b] = (1 if a != b else -1) * np.pi**2 * np.prod(factors, axis=0)
    first_lame, shear = material.first_lame, material.shear_modulus
    return -(first_lame + shear) * hessian @ _AMPLITUDE + 3 * np.pi**2 * shear * _exact(points)
