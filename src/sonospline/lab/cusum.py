"""Learning curves: cumulative sums of failures, against the two lines at which a decision may be taken."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import log
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .._shown import figure
from .._validate import number

Array = NDArray[np.float64]
Decision = Literal["proficient", "needs teaching", "undecided"]


@dataclass(frozen=True, repr=False)
class Cusum:
    """The test that a learning curve is read by: Wald's sequential one, as skills are judged by it.

    Parameters
    ----------
    acceptable : float, default: 0.10
        Share of failures that is acceptable.
    unacceptable : float, default: 0.25
        Share of failures that is not; between the two nothing is decided.
    alpha : float, default: 0.1
        Chance to find fault with somebody who fails as rarely as is acceptable.
    beta : float, default: 0.1
        Chance to find no fault with somebody who fails as often as is not.

    Raises
    ------
    ValueError
        Not 0 < acceptable < unacceptable < 1, or a chance outside (0, 0.5).

    Notes
    -----
    A failure raises the curve by 1 - s, a success lowers it by s, with P = ln(p1 / p0), Q = ln((1 - p0) / (1 - p1)) and
    s = Q / (P + Q): it is the logarithm of the likelihood ratio over P + Q. Limits and steps: Bolsin and Colson,
    *Int. J. Qual. Health Care* 12 (2000) 433.

    Examples
    --------
    >>> from sonospline.lab import Cusum
    >>> curve = Cusum().curve([True, True, False, True] + 20 * [False])
    >>> curve.decision, curve.sums[:3].round(2).tolist()
    ('proficient', [0.83, 1.67, 1.5])
    """

    acceptable: float = 0.10
    unacceptable: float = 0.25
    alpha: float = 0.1
    beta: float = 0.1

    def __post_init__(self) -> None:
        for name in ("acceptable", "unacceptable", "alpha", "beta"):
            object.__setattr__(self, name, number(name, getattr(self, name), positive=True))
        if not self.acceptable < self.unacceptable < 1:
            raise ValueError(
                f"acceptable = {figure(self.acceptable)} and unacceptable = {figure(self.unacceptable)} are no two "
                "rising shares of failures; give e.g. 0.1 and 0.25"
            )
        for name in ("alpha", "beta"):
            if getattr(self, name) >= 0.5:
                raise ValueError(f"{name} = {figure(getattr(self, name))} is no small chance; give less than 0.5")

    @property
    def step(self) -> float:
        """By how much a success lowers the curve; a failure raises it by the rest to 1."""
        return log((1 - self.acceptable) / (1 - self.unacceptable)) / self._scale

    @property
    def upper(self) -> float:
        """How far a rise says "needs teaching"."""
        return log((1 - self.beta) / self.alpha) / self._scale

    @property
    def lower(self) -> float:
        """How far a fall, below zero, says "proficient"."""
        return -log((1 - self.alpha) / self.beta) / self._scale

    def curve(self, failed: Iterable[bool]) -> LearningCurve:
        """Return the curve of attempts, in the order in which they were made."""
        failures = np.array([bool(one) for one in failed], bool)
        return LearningCurve(self, failures)

    @property
    def _scale(self) -> float:
        return log(self.unacceptable / self.acceptable) + log((1 - self.acceptable) / (1 - self.unacceptable))

    def __repr__(self) -> str:
        return f"Cusum(acceptable={self.acceptable:g}, unacceptable={self.unacceptable:g})"


@dataclass(frozen=True, eq=False, repr=False)
class LearningCurve:
    """The cumulative sum of one participant at one exercise."""

    test: Cusum
    failed: NDArray[np.bool_]

    @property
    def sums(self) -> Array:
        """(n,) after each attempt."""
        found: Array = np.cumsum(np.where(self.failed, 1 - self.test.step, -self.test.step))
        return found

    @property
    def decisions(self) -> tuple[tuple[int, Decision], ...]:
        """Attempts, from 1 on, at which something was decided; the test then begins anew from there."""
        found: list[tuple[int, Decision]] = []
        begun = 0.0
        for attempt, at in enumerate(self.sums, 1):
            if at - begun >= self.test.upper:
                found.append((attempt, "needs teaching"))
            elif at - begun <= self.test.lower:
                found.append((attempt, "proficient"))
            else:
                continue
            begun = at
        return tuple(found)

    @property
    def decision(self) -> Decision:
        """The last one that was taken."""
        return self.decisions[-1][1] if self.decisions else "undecided"

    def __repr__(self) -> str:
        return f"LearningCurve({len(self.failed)} attempts, {int(self.failed.sum())} failed, {self.decision})"
