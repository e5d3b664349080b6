"""NumPy twin of the core's nodal loads: forces at points, smoothed by a Gaussian, on trilinear elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import numbered, require, require_spacing, same_length

Array = NDArray[np.float64]
Single = NDArray[np.float32]


def nodal_forces(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    points: Array,
    amounts: Array,
    direction: Array,
    width: float,
    mirrored: list[bool],
) -> Single:
    """Return the nodal load (3, nx, ny, nz) of forces at points: their integrals times the hat functions.

    Parameters
    ----------
    shape, spacing
        Of the nodes.
    points : (m, 3) ndarray
        Where the forces act, from the first node along the grid's axes.
    amounts : (m,) ndarray
        How large they are.
    direction : (3,) ndarray
        Along which all of them act.
    width : float
        Of the Gaussian that smooths each in three dimensions.
    mirrored : list of bool
        Beyond which of the faces x-, x+, y-, y+, z-, z+ the Gaussian is brought back by a mirror; what lies
        beyond the others is lost.
    """
    x, y, z = _shares(shape, spacing, points, width, mirrored)
    same_length("points", points, "amounts", amounts)
    force = np.einsum("pi,pj,pk->ijk", amounts[:, None] * x, y, z, optimize=True)
    return np.multiply.outer(direction, force).astype(np.float32)


def nodal_force_vectors(
    shape: tuple[int, int, int],
    spacing: tuple[float, float, float],
    points: Array,
    forces: Array,
    width: float,
    mirrored: list[bool],
) -> Single:
    """Return :func:`nodal_forces` of forces (m, 3), each along its own direction."""
    x, y, z = _shares(shape, spacing, points, width, mirrored)
    same_length("points", points, "forces", forces)
    return np.einsum("pa,pi,pj,pk->aijk", forces, x, y, z, optimize=True).astype(np.float32)


def _shares(
    shape: tuple[int, int, int], spacing: tuple[float, float, float], points: Array, width: float, mirrored: list[bool]
) -> list[Array]:
    """Of each axis the shares (m, n) of its nodes in the points."""
    require(numbered(shape, 2), "shape has fewer than two nodes along an axis, or too many")
    require_spacing(spacing)
    require(bool(np.isfinite(points).all()), "points are not finite")
    require(bool(np.isfinite(width)) and width > 0, "width is not a length above 0")
    return [
        _shares_of_axis(points[:, a], n, h, width, mirrored[2 * a], mirrored[2 * a + 1])
        for a, (n, h) in enumerate(zip(shape, spacing, strict=True))
    ]


def _shares_of_axis(at: Array, nodes: int, h: float, width: float, low_mirrored: bool, high_mirrored: bool) -> Array:
    """Integrals (m, nodes) of Gaussians at places along an axis times its hat functions."""
    share = _within(at, nodes, h, width)
    if low_mirrored:
        share += _within(-at, nodes, h, width)
    if high_mirrored:
        share += _within(2 * (nodes - 1) * h - at, nodes, h, width)
    return share


def _within(at: Array, nodes: int, h: float, width: float) -> Array:
    """What of each Gaussian lies within the axis; on its ends half a hat is beyond."""
    from scipy.special import erfc

    z = (np.arange(nodes) * h - at[:, None]) / width
    passed = 0.5 * erfc(-z / np.sqrt(2))
    ramp = z * passed + np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    slope = np.diff(ramp, axis=1) * (width / h)
    return np.diff(np.hstack([passed[:, :1], slope, passed[:, -1:]]), axis=1)
