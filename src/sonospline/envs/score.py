"""What an episode that was solved is worth: 1, less what the trainer's metrics say against how it was done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan

from .. import _validate
from ..training.metric import METRICS


@dataclass(frozen=True)
class Cost:
    """What a metric takes from the score: nothing at zero, all of its weight from ``worst`` on.

    Parameters
    ----------
    weight : float
        Taken at most.
    worst : float
        Value of the metric, in its unit, from which all of it is taken.
    """

    weight: float
    worst: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", _validate.number("weight", self.weight))
        object.__setattr__(self, "worst", _validate.number("worst", self.worst, positive=True))

    def of(self, value: float) -> float:
        """Return what a value costs; nothing where it is not known."""
        return 0.0 if isnan(value) else self.weight * min(max(value, 0.0) / self.worst, 1.0)


def check_costs(costs: Mapping[str, Cost]) -> dict[str, Cost]:
    """Return costs by the names of metrics.

    Raises
    ------
    ValueError
        A name of no metric, or weights of more than 1 together.
    """
    for name in costs:
        _validate.choice("costs", name, METRICS)
    total = sum(cost.weight for cost in costs.values())
    if total > 1 + 1e-12:
        raise ValueError(f"costs weigh {total:g} together; give weights of 1 at most, so that scores stay in 0 to 1")
    return dict(costs)


def score(metrics: Mapping[str, float], costs: Mapping[str, Cost]) -> float:
    """Return what is left of 1, between 0 and 1.

    Examples
    --------
    >>> from sonospline.envs.score import Cost, score
    >>> score({"time_s": 5.0, "passes": 1.0}, {"time_s": Cost(weight=0.2, worst=20.0)})
    0.95
    """
    return max(0.0, 1.0 - sum(cost.of(metrics[name]) for name, cost in costs.items()))
