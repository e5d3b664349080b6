"""Which membranes a curve of force shows: what a tip breaks through, so that the force falls at once."""

from __future__ import annotations

import numpy as np

from .force_curve import ForceCurve
from .least_squares import CUTTING, RUPTURE, Dents, Solution, solved

_WITHIN_MM = 2.0
"""A fall takes no longer."""
_OVER_NOISE, _OF_PEAK = 6.0, 0.05
"""How large it is at least: times the noise, and of the largest force."""
_MOST = 8
_DEEPEST_MM = 40.0
"""A dent."""
_ALIKE = 1.1
"""Ratio of what two explanations leave that does not decide between them: a thin tissue that rubs much is like a
membrane a little before."""
_MORE = 1.15
"""Force that a membrane holds, over the cutting force of the tissue before it."""


def membranes_of(curve: ForceCurve) -> Dents:
    """The membranes that a curve shows: the falls of its force that are worth a value more, each at the best layer."""
    found: Dents = {}
    best = solved([curve], [found], {})
    for depth in falls(curve):
        tries = [{**found, number: depth} for number in _may_give_way(curve, found, depth)]
        tried = [
            (trial, solution)
            for trial in tries
            for solution in (solved([curve], [trial], start) for start in (best.values, {}))
            if _is_membrane(curve, trial, depth, solution)
        ]
        if min((one.worth for _, one in tried), default=np.inf) < best.worth - np.log(len(curve.depths_mm)):
            # Of layers that explain it alike, the first that the tip meets.
            least = min(one.left for _, one in tried)
            found, best = next((trial, one) for trial, one in tried if one.left <= _ALIKE * least)
    return found


def _is_membrane(curve: ForceCurve, dents: Dents, depth: float, solution: Solution) -> bool:
    """Whether what breaks at a depth holds more than the tissue before it, whose cutting force falls off there, too."""
    number = next(number for number, at in dents.items() if at == depth)
    if number == 0:
        return True
    before = solution.values[CUTTING, curve.tissues[number - 1][0]]
    return solution.values[RUPTURE, curve.tissues[number][0]] > _MORE * before


def _may_give_way(curve: ForceCurve, dents: Dents, depth: float) -> list[int]:
    """Layers whose membrane may be what breaks at a depth: met before, and in the order of those that are known."""
    return [
        number
        for number, (_, begin) in enumerate(curve.tissues)
        if number not in dents and depth - _DEEPEST_MM < begin < depth
        if all((number < other) == (depth < at) for other, at in dents.items())
        if all(begin > curve.tissues[other][1] for other, at in dents.items() if at < depth)
    ]


def falls(curve: ForceCurve) -> list[float]:
    """Return the depths at which the force falls at once, the largest fall first."""
    depths, force = curve.depths_mm, curve.force_n
    ends = np.maximum(np.searchsorted(depths, depths + _WITHIN_MM, side="right"), np.arange(len(depths)) + 2)
    fall = np.array([force[i] - force[i : ends[i]].min() for i in range(len(depths))])
    least = max(_OVER_NOISE * curve.noise_n, _OF_PEAK * force.max())
    found: list[float] = []
    for number in np.argsort(-fall):
        if fall[number] < least or len(found) == _MOST:
            break
        steepest = number + int(np.argmax(-np.diff(force[number : ends[number]])))
        depth = float(depths[steepest : steepest + 2].mean())
        if all(abs(depth - known) > _WITHIN_MM for known in found):
            found.append(depth)
    return found
