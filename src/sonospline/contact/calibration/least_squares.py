"""Least squares of curves of force by what their tissues resist, on the closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ...mechanics.membranes import SPEED_MM_S
from .closed_form import Layer, force_along
from .force_curve import ForceCurve

Array = NDArray[np.float64]
Key = tuple[str, str]
"""What a value is of, and the tissue; a rupture force is that of the membrane before it."""
Dents = dict[int, float]
"""Depth at which the membrane before a layer is punctured, by number of the layer."""

FRICTION, VISCOUS, CUTTING, RUPTURE = "friction", "viscous friction", "cutting force", "rupture force"
FASTER = "rupture force more at e times the speed"
YIELDING, AHEAD = "stiffness", "tissue ahead"
"""Force that takes along what is ahead of a tip that cuts by 1 mm, one for all tissues without a membrane."""
UNITS = {FRICTION: "N/mm", VISCOUS: "N s/mm2", CUTTING: "N", RUPTURE: "N", FASTER: "N", YIELDING: "N/mm"}
SMALL = {FRICTION: 5e-3, VISCOUS: 5e-4, CUTTING: 0.05, RUPTURE: 0.05, FASTER: 0.05, YIELDING: 0.05}
"""What is next to nothing of each."""
_LOWEST, _HIGHEST = {FASTER: -np.inf, YIELDING: 0.02}, {YIELDING: 20.0}
_YIELDS_N_MM = 0.25
"""Where a fit begins that no membrane says more to."""
_STARTS = (0.6, 1.0, 1.6)
_MOST = 60
"""Evaluations."""
_SPEEDS = 1.5
"""Fastest over slowest curve from which on they tell what depends on speed."""


class Solution(NamedTuple):
    values: dict[Key, float]
    slopes: Array
    """(n, k) Change of the residual with each value."""
    residual: Array

    @property
    def left(self) -> float:
        """Root of the mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual**2) + 1e-12))

    @property
    def worth(self) -> float:
        """Bayes' information criterion: the lower the better."""
        n = len(self.residual)
        return float(2 * n * np.log(self.left) + len(self.values) * np.log(n))


def _keys(curves: Sequence[ForceCurve], dents: Sequence[Dents]) -> list[Key]:
    tissues = list(dict.fromkeys(tissue for curve in curves for tissue, _ in curve.tissues))
    around = {curve.tissues[number][0] for curve, found in zip(curves, dents, strict=True) for number in found}
    membranes = [tissue for tissue in tissues if tissue in around]
    speeds = [curve.speed_mm_s for curve in curves if curve.speed_mm_s is not None]
    rates = len(speeds) == len(curves) and max(speeds) > _SPEEDS * min(speeds)
    kinds = {FRICTION: tissues, CUTTING: tissues, RUPTURE: membranes, YIELDING: [AHEAD]}
    kinds.update({VISCOUS: tissues, FASTER: membranes} if rates else {})
    return [(kind, tissue) for kind, of in kinds.items() for tissue in of]


def best_solved(curves: Sequence[ForceCurve], dents: Sequence[Dents]) -> Solution:
    """Return the best of some fits: how tissue ahead of a tip yields has more than one answer that is best nearby."""
    yields = _first(curves, dents)[YIELDING, AHEAD]
    starts = [{(YIELDING, AHEAD): factor * yields} for factor in _STARTS]
    return min((solved(curves, dents, start) for start in starts), key=lambda one: one.left)


def solved(curves: Sequence[ForceCurve], dents: Sequence[Dents], start: Mapping[Key, float]) -> Solution:
    """Values of the least squares, from where others are known."""
    keys = _keys(curves, dents)
    first = _first(curves, dents)
    guess = [start.get(key, first[key]) for key in keys]
    low = [_LOWEST.get(kind, 0.0) for kind, _ in keys]
    high = [_HIGHEST.get(kind, np.inf) for kind, _ in keys]
    scales = [SMALL[kind] for kind, _ in keys]

    def residual(values: Array) -> Array:
        named = dict(zip(keys, values.tolist(), strict=True))
        return np.concatenate([_force(c, d, named) - c.force_n for c, d in zip(curves, dents, strict=True)])

    steps = [max(0.1 * scale / max(abs(value), scale), 1e-4) for scale, value in zip(scales, guess, strict=True)]
    found = least_squares(
        residual, np.clip(guess, low, high), bounds=(low, high), x_scale=scales, diff_step=steps, max_nfev=_MOST
    )
    return Solution(dict(zip(keys, found.x.tolist(), strict=True)), found.jac, found.fun)


def _first(curves: Sequence[ForceCurve], dents: Sequence[Dents]) -> dict[Key, float]:
    """Where the fit begins: values as they are read off a curve."""
    first: dict[Key, float] = dict.fromkeys(_keys(curves, dents), 0.0)
    yields = []
    for curve, found in zip(curves, dents, strict=True):
        slope, level = np.polyfit(curve.depths_mm, curve.force_n, 1)
        for number, (tissue, begin) in enumerate(curve.tissues):
            first[FRICTION, tissue] = max(float(slope), 0.2 * SMALL[FRICTION])
            first[CUTTING, tissue] = max(float(level), 0.1 * float(curve.force_n.max()))
            if number in found:
                peak = float(np.interp(found[number], curve.depths_mm, curve.force_n))
                first[RUPTURE, tissue] = max(peak - first[FRICTION, tissue] * begin, 0.3 * peak)
                yields.append(first[RUPTURE, tissue] / (found[number] - begin))
    first[YIELDING, AHEAD] = float(np.median(yields or [_YIELDS_N_MM]))
    return first


def _force(curve: ForceCurve, dents: Dents, values: Mapping[Key, float]) -> Array:
    return force_along(curve.depths_mm, layers_of(curve, dents, values))


def layers_of(curve: ForceCurve, dents: Dents, values: Mapping[Key, float]) -> list[Layer]:
    """The tissues of a curve; a membrane that dents breaks where it did, whatever the values."""
    speed = curve.speed_mm_s or SPEED_MM_S
    layers = []
    for number, (tissue, begin) in enumerate(curve.tissues):
        friction = values[FRICTION, tissue] + values.get((VISCOUS, tissue), 0.0) * speed
        rupture, yields = 0.0, values[YIELDING, AHEAD]
        if number in dents:
            rate = values.get((FASTER, tissue), 0.0) * np.log(speed / SPEED_MM_S)
            rupture = max(values[RUPTURE, tissue] + rate, 1e-3)
            yields = rupture / (dents[number] - begin)
        cutting = min(values[CUTTING, tissue], rupture or np.inf)
        layers.append(Layer(tissue, begin, friction, cutting, rupture, yields))
    return layers
