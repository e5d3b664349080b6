"""The band of an expert: what somebody who can do an exercise reaches, metric by metric."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

_ROUNDED = 1e-5
"""Of a value: attempts are kept with six digits."""
_FILE = "expert_band.json"


@dataclass(frozen=True)
class Band:
    """What attempts of an expert have reached in one metric.

    Parameters
    ----------
    mean, deviation : float
        Of them; the deviation is that of a sample.
    low, high : float
        The least and the most.
    attempts : int
        How many.

    Examples
    --------
    >>> from sonospline.training import Band
    >>> Band.of([1.0, 2.0, 3.0]).z(4.0)
    2.0
    """

    mean: float
    deviation: float
    low: float
    high: float
    attempts: int

    @classmethod
    def of(cls, values: list[float]) -> Band:
        """Return that of some values, two at least."""
        n = len(values)
        if n < 2:
            raise ValueError(f"values has {n} attempts; a band has two at least")
        mean = math.fsum(values) / n
        deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (n - 1))
        return cls(mean, deviation, min(values), max(values), n)

    def z(self, value: float) -> float:
        """Return how many deviations a value is from the mean; NaN where all attempts were alike, but for rounding."""
        alike = self.high - self.low <= _ROUNDED * max(abs(self.low), abs(self.high))
        return math.nan if alike else (value - self.mean) / self.deviation


def shipped_band(exercise: str) -> dict[str, Band]:
    """Return the band of each metric of a shipped exercise, by the scripted expert; empty of one that is not shipped.

    The expert knows where the target is, which a trainee has to find: its times are no band for people.
    ``scripts/make_expert_band.py`` made the attempts.
    """
    rows = _table()["exercises"].get(exercise, {})
    known = {name: [value for value in values if value is not None] for name, values in rows.items()}
    return {name: Band.of(values) for name, values in known.items() if len(values) > 1}


def band_made_by() -> str:
    """Return in words how the shipped bands were made."""
    return str(_table()["made_by"])


@cache
def _table() -> Any:
    return msgspec.json.decode(files(__package__).joinpath(_FILE).read_bytes())
