"""NumPy twin of the core's contact: forces within bounds that bring points to rest, along a shaft and across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .checks import require

Array = NDArray[np.float64]


def clipped_forces(
    compliance: Array, apart: Array, low: Array, high: Array, start: Array, sweeps: int, tolerance: float
) -> tuple[Array, int]:
    """Return forces (n,) within bounds under which every point is where it is to be, or its force at a bound.

    With g = apart + compliance f, how far points are beyond where they are to be: g = 0 where a force is within its
    bounds, g >= 0 where it is at the lower one, g <= 0 where it is at the upper one. By projected Gauss-Seidel.

    Parameters
    ----------
    compliance : (n, n) ndarray
        Symmetric; its diagonal is above zero.
    apart : (n,) ndarray
        How far points are beyond where they are to be without any force.
    low, high : (n,) ndarray
        Bounds of each force, low <= high.
    start : (n,) ndarray
        Forces to begin with.
    sweeps : int
        At most.
    tolerance : float
        Largest change of a force in a sweep, times its compliance, at which it ends.

    Returns
    -------
    forces : (n,) ndarray
    sweeps : int
        How many it took.
    """
    n = len(apart)
    require(compliance.shape == (n, n), "compliance is not square, of the length of apart")
    require(all(len(values) == n for values in (low, high, start)), "low, high or start is not of the length of apart")
    diagonal = compliance.diagonal()
    require(bool((diagonal > 0).all()), "compliance has no diagonal above 0")
    require(bool((low <= high).all()), "low is above high")
    require(0 <= sweeps <= 100_000, "sweeps is not between 0 and 100000")
    forces: Array = np.clip(start, low, high)
    beyond = apart + compliance @ forces
    for sweep in range(sweeps):
        largest = 0.0
        for i in range(n):
            wanted = min(max(forces[i] - beyond[i] / diagonal[i], low[i]), high[i])
            change, forces[i] = wanted - forces[i], wanted
            beyond += compliance[i] * change
            largest = max(largest, abs(change) * diagonal[i])
        if largest <= tolerance:
            return forces, sweep + 1
    return forces, sweeps


def stick_slip(
    compliance: Array,
    behind: Array,
    end: Array,
    bond: Array,
    anchors: Array,
    axial: Array,
    tip: float,
    sliding: NDArray[np.uint8],
    bounds: Array,
    limit: float,
    slow: float,
    sweeps: int,
    tolerance: float,
) -> tuple[Array, Array, float, float]:
    """Return forces along a shaft that sticks to points of tissue or slips, and where on it each of them then is.

    A point that sticks is a bond times its force beside its anchor; where it slips, the anchor comes along.

    Parameters
    ----------
    compliance : (m, m) ndarray
        Displacement of points by forces, both along the shaft; symmetric.
    behind : (m,) ndarray
        How far behind the tip the place on the needle is that each point is at, under the forces of before.
    end : (m,) ndarray
        Share of each point in the one that the tip is at.
    bond : (m + 1,) ndarray
        How far a force moves a point along the shaft that it sticks to, for each unit of it; the tip's last.
    anchors, axial : (m,) ndarray
        Of before: how far behind the tip the place is that each point sticks to, and friction.
    tip : float
        Force of the tip before.
    sliding : (m,) ndarray of uint8
        Points whose friction is as large as it may be.
    bounds : (m,) ndarray
        How large that is.
    limit : float
        Largest force of the tip.
    slow : float
        Of the compliance of each point by itself, by which a change of a force counts for more than it moves: what
        the compliance has wrong then does not grow from step to step. It changes the way to rest, and not rest.
    sweeps, tolerance
        As of :func:`clipped_forces`.

    Returns
    -------
    axial, anchors : (m,) ndarray
    tip : float
    ahead : float
        How far tissue is ahead of the tip; below zero where the tip has to cut on.
    """
    m = len(behind)
    require(compliance.shape == (m, m), "compliance is not square, of the length of behind")
    same = all(len(values) == m for values in (end, anchors, axial, bounds))
    require(same, "end, anchors, axial or bounds is not of the length of behind")
    require(len(sliding) == m, "sliding is not of the length of behind")
    require(len(bond) == m + 1, "bond is not one longer than behind")
    own = compliance.diagonal()
    require(bool((own >= 0).all()), "compliance has a diagonal below 0")
    require(bool((bounds >= 0).all()) and limit >= 0, "bounds or limit is below 0")
    require(bool((bond > 0).all()), "bond is not above 0")
    require(slow >= 0, "slow is below 0")
    # Points that slide rub along all of the shaft that they have come to stand for.
    slides = sliding != 0
    grown = np.where(slides, np.sign(axial) * bounds, axial)
    moved = compliance @ (grown - axial)
    behind, anchors = behind - moved, np.where(slides, anchors - moved - bond[:-1] * (grown - axial), anchors)
    rows = np.vstack([np.eye(m), end])
    whole, before = rows @ compliance @ rows.T, np.append(grown, tip)
    slower = slow * whole.diagonal()
    apart = np.append(anchors - behind, -end @ behind) - whole @ before - slower * before
    whole[np.diag_indices(m + 1)] += slower + bond
    forces, _ = clipped_forces(
        whole, apart, np.append(-bounds, 0.0), np.append(bounds, limit), before, sweeps, tolerance
    )
    axial, reached = forces[:-1], float(forces[-1])
    behind = behind - compliance @ (axial - grown + (reached - tip) * end)
    anchors = np.where(np.abs(axial) >= bounds, behind - bond[:-1] * axial, anchors)
    return axial, anchors, reached, float(-end @ behind)


def forces_across(
    compliance: Array, axes: Array, held: NDArray[np.uint8], wanted: Array, soft: float, least: float
) -> Array:
    """Return the forces (n, 3) across a shaft that move the points it holds by what is wanted.

    Parameters
    ----------
    compliance : (3 m, 3 m) ndarray
        Of all points, along the axes of the world; symmetric.
    axes : (2, 3) ndarray
        Two unit vectors across the shaft.
    held : (m,) ndarray of uint8
        Which points it holds, n of them.
    wanted : (n, 3) ndarray
        How far each is to move.
    soft : float
        Of the compliance of each point by itself, by which it gives way to the shaft.
    least : float
        By so much it gives way in any case.
    """
    m, which = len(held), held != 0
    require(compliance.shape == (3 * m, 3 * m), "compliance is not square, of three times held")
    require(soft >= 0 and least >= 0, "soft or least is below 0")
    n = int(which.sum())
    require(len(wanted) == n, "wanted is not of the points held")
    blocks = compliance.reshape(m, 3, m, 3)[which][:, :, which]
    across = np.einsum("pa,iajb,qb->ipjq", axes, blocks, axes).reshape(2 * n, 2 * n)
    across[np.diag_indices(2 * n)] += soft * across.diagonal() + least
    found: Array = np.linalg.solve(across, (wanted @ axes.T).ravel()).reshape(n, 2) @ axes
    return found
