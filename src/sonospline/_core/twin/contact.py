"""NumPy twin of the core's contact: forces within bounds that bring points to rest, along a shaft and across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import shaft
from .checks import require

Array = NDArray[np.float64]

_FORWARD = 1e-9
"""mN, and the direction of friction where the tip has just come by."""
_ALL = 1 - 1e-9
"""Of the most friction of a point: with that it slides. Found again, where nothing moves, it differs by rounding."""
_THERE = 1e-9
"""mm that a tip is before a membrane which it is at."""


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


def cut_on(
    compliance: Array,
    behind: Array,
    bond: Array,
    resistance: Array,
    anchors: Array,
    axial: Array,
    tip: float,
    cut: float,
    sliding: NDArray[np.uint8],
    used: NDArray[np.uint8],
    apart: float,
    reuse: float,
    speed: float,
    membrane: float,
    rupture: float,
    slow: float,
    sweeps: int,
    tolerance: float,
    ends: float,
    grown: float,
    most: int,
) -> tuple[Array, Array, float, float, NDArray[np.uint8], NDArray[np.uint8], Array, float, bool]:
    """Let points of a track stick and slip, and its tip cut on until it rests, breaks a membrane or needs more points.

    Parameters
    ----------
    compliance : (m, m) ndarray
        Displacement of points by forces, both along the shaft; symmetric.
    behind : (m,) ndarray
        How far behind the tip the place on the needle is that each point is at, under the forces of before.
    bond : (m + 1,) ndarray
        How far a force moves a point along the shaft that it sticks to; the tip's last.
    resistance : (4, m) ndarray
        As of :func:`sonospline._core.shaft.friction_bounds`.
    anchors, axial : (m,) ndarray
        Where on the needle points stick, behind the tip, and the friction there.
    tip, cut : float
        Force of the tip, and the length of the cut.
    sliding, used : (m,) ndarray of uint8
        Which points slide, and which the tip has left since it cut there.
    apart, reuse, speed : float
        Length of the track from point to point; friction where it is used; of the needle.
    membrane, rupture : float
        Length of the track at the next membrane, and the force under which that breaks.
    slow, sweeps, tolerance
        Of the search for forces: each change of one is held back as if its point gave way by ``slow`` of its own less.
    ends : float
        The tip rests where tissue is ahead of it by more than that below zero.
    grown : float
        Of the friction of a point all along the shaft, which one that slides may lack.
    most : int
        Times that forces are found.

    Returns
    -------
    anchors, axial, tip, cut, sliding, used
        As above, afterwards. Points are to be added where the cut is as long as the track.
    bounds : (m,) ndarray
        Of the friction.
    reached : float
        Length of the track at the tip.
    breaks : bool
        Whether the tip breaks the membrane.
    """
    m = len(behind)
    require(compliance.shape == (m, m), "compliance is not square, of the length of behind")
    require(all(len(values) == m for values in (anchors, axial)), "anchors or axial is not of the length of behind")
    require(len(sliding) == len(used) == m, "sliding or used is not of the length of behind")
    require(len(bond) == m + 1, "bond is not one longer than behind")
    require(resistance.shape == (4, m), "resistance is not four of the length of behind")
    require(bool((compliance.diagonal() >= 0).all()), "compliance has a diagonal below 0")
    require(bool((resistance >= 0).all()) and rupture >= 0, "resistance or rupture is below 0")
    require(bool((bond > 0).all()), "bond is not above 0")
    require(slow >= 0, "slow is below 0")
    require(0 <= sweeps <= 100_000 and 0 <= most <= 100_000, "sweeps or most is not between 0 and 100000")
    along, slides, left = apart * np.arange(m, dtype=float), sliding != 0, used != 0

    def bounds_now() -> Array:
        length = shaft.lengths(along, anchors, cut, apart)
        return shaft.friction_bounds(length, resistance, slides, left, reuse, speed)

    bounds, breaks, end = bounds_now(), False, shaft.share_of_end(along, cut, apart)
    for _ in range(most):
        new = (bounds > 0) & (axial == 0) & ~slides  # what the tip has newly come past slides along the shaft
        slides, axial = slides | new, np.where(new, _FORWARD, axial)
        bounds = bounds_now()
        cutting, there = float(end @ resistance[3]), membrane <= cut + _THERE
        limit = max(rupture, cutting) if there else cutting
        behind, anchors, axial, tip = stick_slip(
            compliance, behind, end, bond, anchors, axial, tip, slides, bounds, limit, slow, sweeps, tolerance
        )
        left = left | ((anchors < -apart / 2) & (along < cut))
        slides = (np.abs(axial) >= _ALL * bounds) & (bounds > 0)
        ahead = -float(end @ behind)
        if tip < limit or ahead > -ends:
            bounds = bounds_now()
            rubs = slides | ((bounds > 0) & (axial == 0))
            if not (rubs & (bounds - np.abs(axial) > grown * apart * resistance[0])).any():
                break
            continue
        if there:
            breaks = True
            break
        cut += min(-ahead, apart, membrane - cut)
        if along[-1] <= cut:
            break
        before, end, bounds = end, shaft.share_of_end(along, cut, apart), bounds_now()
        behind = behind - compliance @ (tip * (end - before))
    reached = cut + min(0.0, float(end @ behind))
    return anchors, axial, tip, cut, slides.view(np.uint8), left.view(np.uint8), bounds, reached, breaks


def stick_slip(
    compliance: Array,
    behind: Array,
    end: Array,
    bond: Array,
    anchors: Array,
    axial: Array,
    tip: float,
    slides: NDArray[np.bool_],
    bounds: Array,
    limit: float,
    slow: float,
    sweeps: int,
    tolerance: float,
) -> tuple[Array, Array, Array, float]:
    """Return where points (m,) are behind the tip, where on the needle they stick, and the forces there and of the tip.

    A point that sticks is a bond times its force beside its anchor; where it slips, the anchor comes along. The share
    of each point in the one that the tip is at is ``end`` (m,), friction is within ``bounds`` (m,) and the tip's force
    within ``limit``; what is held back of a change of forces changes the way to rest, and not rest.
    """
    m = len(behind)
    # Points that slide rub along all of the shaft that they have come to stand for.
    start = np.where(slides, np.sign(axial) * bounds, axial)
    moved = compliance @ (start - axial)
    behind, anchors = behind - moved, np.where(slides, anchors - moved - bond[:-1] * (start - axial), anchors)
    rows = np.vstack([np.eye(m), end])
    whole, before = rows @ compliance @ rows.T, np.append(start, tip)
    slower = slow * whole.diagonal()
    apart = np.append(anchors - behind, -end @ behind) - whole @ before - slower * before
    whole[np.diag_indices(m + 1)] += slower + bond
    low, high = np.append(-bounds, 0.0), np.append(bounds, limit)
    forces, _ = clipped_forces(whole, apart, low, high, before, sweeps, tolerance)
    axial, reached = forces[:-1], float(forces[-1])
    behind = behind - compliance @ (axial - start + (reached - tip) * end)
    anchors = np.where(np.abs(axial) >= bounds, behind - bond[:-1] * axial, anchors)
    return behind, anchors, axial, reached


def held_across(
    compliance: Array,
    places: Array,
    axis: Array,
    held: NDArray[np.uint8],
    offsets: Array,
    lateral: Array,
    share: float,
    bond: float,
    soft: float,
    least: float,
) -> tuple[Array, Array]:
    """Return the forces (m, 3) across a shaft by which it holds points of tissue beside its axis, and how far aside.

    Parameters
    ----------
    compliance : (3 m, 3 m) ndarray
        Of all points, along the axes of the world; symmetric.
    places : (m, 3) ndarray
        Where they are, seen from a place on the axis.
    axis : (3,) ndarray
        A unit vector along the shaft.
    held : (m,) ndarray of uint8
        Which points it holds.
    offsets, lateral : (m, 3) ndarray
        How far beside the axis those are to be, and the forces on them; others are where they are, without force.
    share : float
        Of the compliance that answers to a change of forces.
    bond : float
        Of a point's own compliance, how far its force moves it along the shaft.
    soft : float
        Of the compliance of each point by itself, by which it gives way to the shaft.
    least : float
        By so much it gives way in any case.
    """
    m, holds = len(held), held != 0
    require(compliance.shape == (3 * m, 3 * m), "compliance is not square, of three times held")
    require(all(len(rows) == m for rows in (places, offsets, lateral)), "places, offsets or lateral is not of held")
    require(share > 0, "share is not above 0")
    require(bond >= 0 and soft >= 0 and least >= 0, "bond, soft or least is below 0")
    axes, n = shaft.axes_across(axis), int(holds.sum())
    beside = places @ axes.T
    forces = np.where(holds[:, None], lateral @ axes.T, 0.0)
    blocks = compliance.reshape(m, 3, m, 3)
    own = np.einsum("iaia->i", blocks) / 3
    lacks = (offsets @ axes.T - beside - bond * own[:, None] * forces)[holds]
    across = share * np.einsum("pa,iajb,qb->ipjq", axes, blocks[holds][:, :, holds], axes).reshape(2 * n, 2 * n)
    across[np.diag_indices(2 * n)] += soft * across.diagonal() + least
    forces[holds] += np.linalg.solve(across, lacks.ravel()).reshape(n, 2)
    return forces @ axes, np.where(holds[:, None], offsets, beside @ axes)
