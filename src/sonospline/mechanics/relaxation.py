"""How the stress of strained tissue falls with time, and how the strain of loaded tissue grows.

Stress relaxes by a sum of exponentials, G(t) = g_inf + sum g_b e^(-t / tau_b) with G(0) = 1, at a constant Poisson's
ratio: generalised Maxwell tissue. Where all tissue relaxes alike a load creeps by the inverse of it, 1 / (s G~(s)) in
Laplace's domain: 1 + sum J_b (1 - e^(-t / lambda_b)), and no solver needs to know.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown

Array = NDArray[np.float64]

LARGEST_EXPONENT = 0.4
"""Of a power law: beyond it four terms are 4 % off, and leave a fortieth of the stress."""

_DECADES_S = (0.1, 1.0, 10.0, 100.0)
_FITTED = 61
"""Times at which the power law is fitted, as many in each decade."""


class ExponentialStep(NamedTuple):
    """A step in time of branches dv/dt = (f - v) / tau, exact where f changes linearly within it."""

    kept: Array
    """(terms,) e^(-dt / tau): what is left of a branch's distance from f."""
    ramp: Array
    """(terms,) (1 - kept) tau / dt: what is left of the change of f; 1 where dt = 0."""

    @classmethod
    def of(cls, times_s: Sequence[float], dt: float) -> ExponentialStep:
        """Return the step of branches of such time constants, in s."""
        x = dt / np.asarray(times_s, float)
        return cls(np.exp(-x), np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0))

    def branches(self, v: Array, before: ArrayLike, now: ArrayLike) -> Array:
        """Return the branches (terms, ...) after the step, from those before it and f (...) at its two ends."""
        old, new = np.asarray(before, float), np.asarray(now, float)
        kept, ramp = (values.reshape(-1, *(1,) * old.ndim) for values in self)
        return np.asarray(v + (1 - kept) * (old - v) + (1 - ramp) * (new - old))

    def __repr__(self) -> str:
        return f"ExponentialStep({len(self.kept)} terms)"


@dataclass(frozen=True)
class Creep:
    """What strain does under a constant load: J(t) = 1 + sum J_b (1 - e^(-t / lambda_b)), of the elastic answer.

    Made by :attr:`PronySeries.creep`. Filtered forces v_b, dv_b/dt = (f - v_b) / lambda_b, keep the past: tissue
    answers to f + sum J_b v_b as elastic tissue does to f.

    Parameters
    ----------
    amounts : tuple of float
        J_b, at or above zero.
    times_s : tuple of float
        lambda_b in s.

    Examples
    --------
    A force of 2 N at two of three places, held for 5 s; :meth:`PronySeries.modulus` is the inverse:

    >>> import numpy as np
    >>> from sonospline.mechanics import PronySeries
    >>> creep = PronySeries(fractions=(0.3, 0.3), times_s=(0.5, 10)).creep
    >>> held, v = np.array([2.0, 0, 2]), np.zeros((2, 3))
    >>> v = creep.step(5.0).branches(v, held, held)
    >>> creep.answer(held, v).round(3).tolist(), (2 * creep.compliance(5.0)).round(3).tolist()
    ([3.344, 0.0, 3.344], 3.344)
    """

    amounts: tuple[float, ...]
    times_s: tuple[float, ...]

    def compliance(self, t: ArrayLike) -> Array:
        """Return J at times (...) in s since the load began."""
        grown = -np.expm1(-np.multiply.outer(np.asarray(t, float), 1 / np.array(self.times_s)))
        return np.asarray(1 + grown @ np.array(self.amounts))

    def step(self, dt: float) -> ExponentialStep:
        """Return the step of the filtered forces over dt, in s."""
        return ExponentialStep.of(self.times_s, dt)

    def answer(self, forces: ArrayLike, filtered: Array) -> Array:
        """Return what tissue answers to as elastic tissue does: f + sum J_b v_b, of forces (...) and v (terms, ...)."""
        return np.asarray(np.asarray(forces, float) + np.tensordot(self.amounts, filtered, 1))

    def jump(self, dt: float) -> float:
        """Return how much of an elastic answer a change of the force over dt has at its end."""
        return 1 + float((1 - self.step(dt).ramp) @ np.array(self.amounts))


@dataclass(frozen=True)
class PronySeries:
    """Normalised modulus of relaxation G(t) = g_inf + sum g_b e^(-t / tau_b); G(0) = 1.

    Parameters
    ----------
    fractions : sequence of float, default: ()
        g_b, at or above zero, less than 1 together: the stress of strain that is held falls, and not to nothing.
    times_s : sequence of float, default: ()
        tau_b in s, above zero, one for each fraction.

    Raises
    ------
    ValueError
        Fractions or times out of range, or not as many: such tissue is not passive.

    Examples
    --------
    >>> from sonospline.mechanics import PronySeries
    >>> series = PronySeries(fractions=(0.3, 0.3), times_s=(0.5, 10))
    >>> round(series.long_term, 3), series.modulus([0, 0.5, 60]).round(3).tolist()
    (0.4, [1.0, 0.796, 0.401])
    >>> [round(amount, 2) for amount in series.creep.amounts], [round(time, 2) for time in series.creep.times_s]
    ([0.4, 1.1], [0.71, 17.67])
    """

    fractions: tuple[float, ...] = ()
    times_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, positive in (("fractions", False), ("times_s", True)):
            object.__setattr__(self, name, _numbers(name, getattr(self, name), positive=positive))
        if len(self.fractions) != len(self.times_s):
            raise ValueError(
                f"fractions = {shown(self.fractions)} and times_s = {shown(self.times_s)} differ in number; "
                "give one time constant for each fraction"
            )
        if sum(self.fractions) >= 1:
            raise ValueError(
                f"fractions = {shown(self.fractions)} are 1 or more together, which leaves held tissue no stress; "
                "give less than 1 in all"
            )

    @classmethod
    def power_law(cls, exponent: float) -> PronySeries:
        """Return G(t) ~ t^-exponent from 0.1 to 100 s as four terms, a decade apart; none where it is 0.

        The non-negative least squares fit, of relative errors: 0.6 % at an exponent of 0.1, 1.8 % at 0.25. Porcine
        liver, kidney, brain and heart follow such laws (doi 10.3389/fbioe.2024.1386955); an exponent of 0.05
        to 0.25 is assumed.

        Parameters
        ----------
        exponent : float
            From 0, elastic, to 0.4.

        Raises
        ------
        ValueError
            An exponent out of range.

        Examples
        --------
        >>> from sonospline.mechanics import PronySeries
        >>> [round(fraction, 3) for fraction in PronySeries.power_law(0.1).fractions]
        [0.201, 0.168, 0.125, 0.126]
        """
        exponent = relaxation_exponent("exponent", exponent)
        if exponent == 0:
            return cls()
        from scipy.optimize import nnls

        t = np.geomspace(_DECADES_S[0], _DECADES_S[-1], _FITTED)
        terms = np.exp(-np.divide.outer(t, (np.inf, *_DECADES_S)))
        found = nnls(terms * t[:, None] ** exponent, np.ones_like(t))[0]
        return cls(tuple((found[1:] / found.sum()).tolist()), _DECADES_S)

    @property
    def long_term(self) -> float:
        """g_inf, what is left of the stress in the end."""
        return 1 - sum(self.fractions)

    def modulus(self, t: ArrayLike) -> Array:
        """Return G at times (...) in s since the strain began."""
        left = np.exp(-np.multiply.outer(np.asarray(t, float), 1 / np.array(self.times_s)))
        return np.asarray(self.long_term + left @ np.array(self.fractions))

    @cached_property
    def creep(self) -> Creep:
        """The same as a compliance, for any number of terms.

        With rates k_b = 1 / tau_b and v_b = (g_b k_b)^(1/2), 1 / (s G~) = 1 + v . (s + K - v v^T)^-1 v: its
        poles are the eigenvalues of a symmetric matrix, which is definite as the fractions are less than 1 together.
        """
        rates = 1 / np.array(self.times_s)
        v = np.sqrt(np.array(self.fractions) * rates)
        poles, vectors = np.linalg.eigh(np.diag(rates) - np.outer(v, v))
        amounts, times = (v @ vectors) ** 2 / poles, 1 / poles
        return Creep(tuple(amounts[::-1].tolist()), tuple(times[::-1].tolist()))

    def __repr__(self) -> str:
        terms = ", ".join(f"{g:.3g} in {tau:g} s" for g, tau in zip(self.fractions, self.times_s, strict=True))
        return f"PronySeries({terms or 'elastic'})"


def relaxation_exponent(name: str, value: float) -> float:
    """Return the exponent of a power law that passive tissue may follow, or raise ValueError."""
    exponent = _validate.number(name, value)
    if exponent > LARGEST_EXPONENT:
        raise ValueError(
            f"{name} = {exponent:g} is out of range; give 0, elastic, to {LARGEST_EXPONENT:g} (soft tissue: 0.05 to "
            "0.25), as more would leave held tissue hardly any stress"
        )
    return exponent


def _numbers(name: str, values: Sequence[float], *, positive: bool) -> tuple[float, ...]:
    try:
        given = tuple(values)
    except TypeError:
        raise ValueError(f"{name} = {shown(values)} is no sequence; give one number for each term") from None
    return tuple(_validate.number(f"{name}[{i}]", value, positive=positive) for i, value in enumerate(given))
