"""Friction, cutting force and rupture force of each tissue that a needle passes, fitted to its force against depth.

By least squares on the closed form. How far a membrane dents is read where the force falls at once; whether a fall is a
membrane, and which, the fit decides: by Bayes' information criterion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._by_bits import ByBits
from ...mechanics.material import Material
from ...mechanics.material_table import BACKGROUND, MaterialTable
from .closed_form import lengths_in, tip_along
from .force_curve import ForceCurve
from .least_squares import (
    CUTTING,
    FASTER,
    FRICTION,
    RUPTURE,
    SMALL,
    UNITS,
    VISCOUS,
    Dents,
    Key,
    Solution,
    best_solved,
    layers_of,
)
from .membranes_shown import membranes_of

Array = NDArray[np.float64]

_ASKED = (FRICTION, VISCOUS, CUTTING, RUPTURE, FASTER)
"""What the fit is made for; the rest comes with it."""
_KNOWN = 0.5
"""Of a value, that its standard error is at most, where the curves tell it; or what is next to nothing."""
_LEAST_CUT_MM = 1.0
"""A tip that has cut on by less in a tissue says nothing of its cutting force."""


class Estimate(NamedTuple):
    """A value and its standard error; infinite where the curves say nothing about it."""

    value: float
    error: float
    known: bool
    """Whether the curves tell it: an error of at most half of the value, or next to none."""


@dataclass(frozen=True, eq=False, repr=False)
class ForceFit(ByBits):
    """Values of tissues and membranes, and how well they explain the curves."""

    values: Mapping[Key, Estimate]
    passed_mm: Mapping[str, float]
    """Longest way of a shaft in each tissue."""
    dents: tuple[Dents, ...]
    """Of each curve."""
    modelled_n: tuple[Array, ...]
    """Force of each curve as the values have it."""
    residual_n: float
    """Root of the mean square of what they leave."""
    explained: float
    """Share of the variance that they explain."""

    @property
    def untold(self) -> tuple[str, ...]:
        """What the curves do not tell, a line each."""
        lines = [self._untold(key, found) for key, found in self.values.items() if not found.known and key[0] in _ASKED]
        if not any(kind == VISCOUS for kind, _ in self.values):
            lines.append("viscous friction and the rate of rupture: give curves at two speeds or more")
        return tuple(lines)

    def _untold(self, key: Key, found: Estimate) -> str:
        kind, tissue = key
        value = "nothing is known of it" if np.isinf(found.error) else f"{found.value:.3g} +- {found.error:.2g}"
        if tissue not in self.passed_mm:
            return f"{kind} of {tissue}: {value} {UNITS[kind]}"
        return f"{kind} of {tissue}, passed for {self.passed_mm[tissue]:.1f} mm at most: {value} {UNITS[kind]}"

    def materials(self, table: MaterialTable, source: str) -> dict[str, Material]:
        """Return the tissues with what the curves tell; the rest is as a table has it."""
        return {tissue: self._material(tissue, table, source) for tissue in self.passed_mm}

    def __repr__(self) -> str:
        left = f"{self.residual_n:.3g} N left, {self.explained:.3%} explained"
        return f"ForceFit({len(self.passed_mm)} tissues, {len(self.modelled_n)} curves, {left})"

    def _material(self, tissue: str, table: MaterialTable, source: str) -> Material:
        try:
            known = table[tissue]
        except ValueError:
            known = table[BACKGROUND]
        fields = {FRICTION: "friction_n_per_mm", VISCOUS: "viscous_friction", CUTTING: "cutting_force_n"}
        fitted = {kind: found.value for (kind, of), found in self.values.items() if of == tissue and found.known}
        changes = {fields[kind]: round(value, 5) for kind, value in fitted.items() if kind in fields}
        names = ", ".join(kind for kind in fields if kind in fitted)
        says = f"{names} fitted to {source}; the rest {known.source}" if names else known.source
        return replace(known, **changes, track_friction_n_per_mm=None, source=says)  # type: ignore[arg-type]


def fit_forces(curves: Sequence[ForceCurve]) -> ForceFit:
    """Return friction, cutting and rupture force of the tissues on the way of needles.

    Parameters
    ----------
    curves : sequence of ForceCurve
        Tissues and membranes of one name have the same values in all of them.

    Raises
    ------
    ValueError
        No curves.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.contact.calibration import ForceCurve, Layer, fit_forces, force_along
    >>> depths = np.arange(0.2, 60, 0.2)
    >>> true = force_along(depths, [Layer("fat", 0, 0.02, 0.3, 1.5), Layer("muscle", 25, 0.05, 0.8)])
    >>> fit = fit_forces([ForceCurve(depths, true, (("fat", 0), ("muscle", 25)))])
    >>> [round(fit.values[key].value, 2) for key in list(fit.values)[:4]]
    [0.02, 0.05, 0.3, 0.8]
    """
    if not curves:
        raise ValueError("curves is empty; give at least one")
    if len({curve.name for curve in curves}) < len(curves):
        raise ValueError(f"curves: names {', '.join(curve.name for curve in curves)} are alike; give each its own")
    dents = tuple(membranes_of(curve) for curve in curves)
    return _fit_of(curves, dents, best_solved(curves, dents))


def _fit_of(curves: Sequence[ForceCurve], dents: tuple[Dents, ...], solution: Solution) -> ForceFit:
    values, residual = solution.values, solution.residual
    force = np.concatenate([curve.force_n for curve in curves])
    passed, cut = _ways(curves, dents, values)
    errors = dict(zip(values, _errors(solution), strict=True))
    for kind, tissue in values:
        if kind == CUTTING and cut[tissue] < _LEAST_CUT_MM:  # the tip has jumped through it
            errors[kind, tissue] = np.inf
        if kind == RUPTURE:
            errors[kind, tissue] = np.hypot(errors[kind, tissue], values[kind, tissue] * _unread(curves, dents, tissue))
    estimates = {
        key: Estimate(value, float(errors[key]), bool(errors[key] <= max(_KNOWN * abs(value), SMALL[key[0]])))
        for key, value in values.items()
    }
    explained = 1 - float(residual @ residual) / float(((force - force.mean()) ** 2).sum())
    ends = np.cumsum([len(curve.depths_mm) for curve in curves])[:-1]
    return ForceFit(estimates, passed, dents, tuple(np.split(force + residual, ends)), solution.left, explained)


def _ways(
    curves: Sequence[ForceCurve], dents: Sequence[Dents], values: Mapping[Key, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Longest shaft in each tissue, and how far a tip has cut on in it."""
    passed = {tissue: 0.0 for curve in curves for tissue, _ in curve.tissues}
    cut = dict(passed)
    for curve, found in zip(curves, dents, strict=True):
        layers = layers_of(curve, found, values)
        tip = tip_along(curve.depths_mm, layers)
        steps = np.gradient(curve.depths_mm)
        goes_on = (tip.force_n >= (1 - 1e-9) * tip.most_n) & ~tip.at_membrane
        for number, (layer, length) in enumerate(zip(layers, lengths_in(tip.cut_mm, layers)[-1], strict=True)):
            passed[layer.tissue] = max(passed[layer.tissue], float(length))
            cut[layer.tissue] += float(steps[goes_on & (tip.layer == number)].sum())
    return passed, cut


def _unread(curves: Sequence[ForceCurve], dents: Sequence[Dents], tissue: str) -> float:
    """Share of a rupture force that lies between the samples before and after the puncture."""
    shares = []
    for curve, found in zip(curves, dents, strict=True):
        for number, depth in found.items():
            name, begin = curve.tissues[number]
            if name == tissue:
                shares.append(0.5 * float(np.diff(curve.depths_mm).max()) / (depth - begin))
    return min(shares)


def _errors(solution: Solution) -> list[float]:
    """Standard errors: of what each column has of its own; residuals that follow each other count as fewer samples."""
    slopes, residual = solution.slopes, solution.residual
    n, k = slopes.shape
    follows = min(max(float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300), 0.0), 0.99)
    scale = float(np.sqrt(residual @ residual / max(1, n - k) * (1 + follows) / (1 - follows)))
    errors = []
    for number in range(k):
        column, others = slopes[:, number], np.delete(slopes, number, axis=1)
        own = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
        length, least = float(np.linalg.norm(own)), 1e-6 * float(np.linalg.norm(column))
        errors.append(scale / length if length > max(least, 1e-9) else np.inf)
    return errors
