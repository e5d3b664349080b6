"""Breathing: how far the diaphragm is from where it rests, at any time.

Each breath is Lujan's curve, s = b sin^2n(pi t / T) from one rest to the next, which is his a - b cos^2n(pi t / T) with
rest at zero and time counted from there (Med. Phys. 26 (1999) 715). Its period and height are drawn anew for every
breath, from the seed and the breath's number alone: the same seed and time give the same bits, whatever was asked
before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import figure, shown

Array = NDArray[np.float64]

ORGAN_RATIO = 0.65
"""Of the kidney's excursion to the diaphragm's: 0.6 to 0.7 (PMC4539151)."""
LONGEST_S = 1e6
"""Time that is asked for, at most: eleven days of breaths."""

_BLOCK = 256
"""Breaths that are drawn together."""
_MOST_HOLDS = 1000


@dataclass(frozen=True)
class Spread:
    """A normal distribution cut off at both ends, of what differs from breath to breath.

    Parameters
    ----------
    mean, sd : float
        Of the whole normal distribution; sd at or above zero.
    low, high : float
        What is drawn lies between them; 0 < low <= mean <= high.

    Raises
    ------
    ValueError
        Ends that do not hold the mean, or a value that is no number.

    Examples
    --------
    >>> from sonospline.mechanics import Spread
    >>> Spread(17.3, 4.6, 9.0, 27.5).at([0.0, 0.5, 1.0]).round(2).tolist()
    [9.0, 17.43, 27.5]
    """

    mean: float
    sd: float
    low: float
    high: float

    def __post_init__(self) -> None:
        for name, positive in (("mean", True), ("sd", False), ("low", True), ("high", True)):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), positive=positive))
        if not self.low <= self.mean <= self.high:
            raise ValueError(
                f"mean = {figure(self.mean)} is not between low = {figure(self.low)} and high = {figure(self.high)}; "
                "give low <= mean <= high"
            )

    def at(self, shares: ArrayLike) -> Array:
        """Return the values below which given shares of all draws lie (quantiles), in the shape of ``shares``."""
        from scipy.special import ndtr, ndtri

        if self.sd == 0:
            return np.full(np.shape(shares), self.mean)
        first, last = (ndtr((end - self.mean) / self.sd) for end in (self.low, self.high))
        drawn = self.mean + self.sd * ndtri(first + np.asarray(shares, float) * (last - first))
        return np.clip(drawn, self.low, self.high)

    def __repr__(self) -> str:
        return f"Spread({self.mean:g} +- {self.sd:g}, {self.low:g} to {self.high:g})"


RATE_PER_MIN = Spread(17.3, 4.6, 9.0, 27.5)
"""Breaths a minute: mean and range of 62 patients (Radiat. Oncol. 8:248); the sd, a quarter of it, is assumed."""
EXCURSION_MM = Spread(11.1 / ORGAN_RATIO, 4.8 / ORGAN_RATIO, 2.5 / ORGAN_RATIO, 20.5 / ORGAN_RATIO)
"""Of the diaphragm: that of 39 kidneys, 11.1 +- 4.8 (2.5 to 20.5) mm (SpringerPlus 3:131), over :data:`ORGAN_RATIO`."""


@dataclass(frozen=True)
class BreathHold:
    """A time in which breathing stands still but for a drift, after which it goes on from where it stood.

    Parameters
    ----------
    start_s : float
        When it begins, at or above zero.
    end_s : float, default: inf
        When it ends.
    drift_mm : float, default: 5.6
        How far the diaphragm creeps towards the head, along a line, in ``drift_s``, where it then stays: up to 5.6 mm
        in 24 s are known (PMC7055431). The direction is assumed: the lungs lose air.
    drift_s : float, default: 24.0
        See there.
    return_s : float, default: 2.0
        Time after the end in which the drift goes back, smoothly. Assumed.

    Raises
    ------
    ValueError
        An end before the start, or a value out of range.
    """

    start_s: float
    end_s: float = float("inf")
    drift_mm: float = 5.6
    drift_s: float = 24.0
    return_s: float = 2.0

    def __post_init__(self) -> None:
        for name in ("start_s", "drift_mm"):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name)))
        for name in ("drift_s", "return_s"):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), positive=True))
        if not self.end_s >= self.start_s:
            raise ValueError(
                f"end_s = {shown(self.end_s)} is before start_s = {figure(self.start_s)}; give a later time"
            )

    def drift(self, t: Array) -> Array:
        """Return how far the diaphragm has crept towards the head at times, mm."""
        held = np.clip(np.minimum(t, self.end_s) - self.start_s, 0, self.drift_s) / self.drift_s
        back = np.clip((t - self.end_s) / self.return_s, 0, 1)
        return self.drift_mm * held * (1 - back * back * (3 - 2 * back))

    def __repr__(self) -> str:
        return f"BreathHold({self.start_s:g} to {self.end_s:g} s)"


@dataclass(frozen=True)
class Breathing:
    """How somebody breathes: a pure function of time.

    Parameters
    ----------
    rate_per_min : Spread, default: 17.3 +- 4.6, 9 to 27.5
        Breaths a minute, drawn for each.
    excursion_mm : Spread, default: 17.1 +- 7.4, 3.8 to 31.5
        How far the diaphragm goes at the height of a breath, drawn for each.
    exponent : int, default: 2
        Lujan's n, 1 to 3: the larger it is, the longer tissue rests between two breaths.
    seed : int, default: 0
        Of the draws.
    holds : sequence of BreathHold, optional
        One after the other.

    Raises
    ------
    ValueError
        A value out of range, or holds that overlap.

    Examples
    --------
    >>> from sonospline.mechanics import Breathing, Spread
    >>> calm = Breathing(Spread(15, 0, 15, 15), Spread(17, 0, 17, 17))  # every 4 s, all alike
    >>> calm.excursion([0.0, 1.0, 2.0, 4.0]).round(2).tolist()
    [0.0, 4.25, 17.0, 0.0]
    >>> held = calm.held(2.0)
    >>> round(held.excursion(26.0), 2), round(held.released(26.0).excursion(30.0), 2)
    (11.4, 17.0)
    """

    rate_per_min: Spread = RATE_PER_MIN
    excursion_mm: Spread = EXCURSION_MM
    exponent: int = 2
    seed: int = 0
    holds: tuple[BreathHold, ...] = ()

    def __post_init__(self) -> None:
        for name in ("rate_per_min", "excursion_mm"):
            if not isinstance(getattr(self, name), Spread):
                given = shown(getattr(self, name))
                raise ValueError(f"{name} = {given} is not a Spread; give one, e.g. Spread(17, 5, 4, 31)")
        object.__setattr__(self, "exponent", _validate.count("exponent", self.exponent, most=3))
        object.__setattr__(self, "seed", _validate.count("seed", self.seed, least=0))
        object.__setattr__(self, "holds", tuple(self.holds))
        if len(self.holds) > _MOST_HOLDS:
            raise ValueError(f"holds has {len(self.holds)} of them; give at most {_MOST_HOLDS}")
        for one, following in zip(self.holds[:-1], self.holds[1:], strict=True):
            if following.start_s < one.end_s:
                raise ValueError(
                    f"holds overlap: one ends at {one.end_s:g} s, the next begins at {following.start_s:g} s; "
                    "give one after the other"
                )

    def excursion(self, t: ArrayLike) -> Array | float:
        """Return how far towards the feet the diaphragm is from its rest, mm, at a time in s or at times (m,).

        Below zero where a held breath has drifted past rest.

        Raises
        ------
        ValueError
            A time below zero, beyond 1e6 s, or not finite.
        """
        times = np.asarray(t, float)
        if times.size and not (np.isfinite(times).all() and times.min() >= 0 and times.max() <= LONGEST_S):
            raise ValueError(f"t = {shown(t)} is out of range; give seconds from 0 to {LONGEST_S:g}")
        found = self._breaths(self._breathed(times)) - sum(hold.drift(times) for hold in self.holds)
        return float(found) if times.ndim == 0 else found

    def held(self, t: float, **drift: float) -> Breathing:
        """Return the same breathing, held from a time on; keywords as :class:`BreathHold`'s."""
        return replace(self, holds=(*self.holds, BreathHold(t, **drift)))

    def released(self, t: float) -> Breathing:
        """Return the same breathing, its last hold ended at a time; itself where none is held then."""
        if not self.holds or self.holds[-1].end_s <= t:
            return self
        return replace(self, holds=(*self.holds[:-1], replace(self.holds[-1], end_s=t)))

    @property
    def is_held(self) -> bool:
        """Whether it is held and nobody has said until when."""
        return bool(self.holds) and self.holds[-1].end_s == float("inf")

    def rests_at(self, t: float) -> float:
        """Return when the breath that is drawn at a time has ended, s: tissue is at rest then, but for a drift.

        Raises
        ------
        ValueError
            It is held and nobody has said until when, or a time that :meth:`excursion` refuses.
        """
        if self.is_held:
            raise ValueError(f"the breath is held from {self.holds[-1].start_s:g} s on; release it first")
        self.excursion(t)
        now = np.asarray(t, float)
        breathed = float(self._breathed(now))
        starts, _ = _drawn(self.rate_per_min, self.excursion_mm, self.seed, self._blocks(now))
        end = float(starts[np.searchsorted(starts, breathed, side="right")])
        coming = sum(hold.end_s - max(hold.start_s, t) for hold in self.holds if hold.end_s > t)
        return t + end - breathed + coming

    @property
    def largest_mm(self) -> float:
        """How far the diaphragm goes at most."""
        return self.excursion_mm.high

    def _breathed(self, t: Array) -> Array:
        """Time that was spent breathing, and not holding breath."""
        held = [np.clip(np.minimum(t, hold.end_s) - hold.start_s, 0, None) for hold in self.holds]
        return t - sum(held, np.zeros(t.shape))

    def _breaths(self, t: Array) -> Array:
        starts, heights = _drawn(self.rate_per_min, self.excursion_mm, self.seed, self._blocks(t))
        breath = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(heights) - 1)
        share = (t - starts[breath]) / (starts[breath + 1] - starts[breath])
        sine = np.sin(np.pi * share)
        found: Array = heights[breath]
        for _ in range(self.exponent):  # NumPy's powers differ in the last bit between one time and an array of them
            found = found * (sine * sine)
        return found

    def _blocks(self, t: Array) -> int:
        """Blocks of breaths that last beyond all times, however short breaths are: few sizes, so that all are kept."""
        shortest = 60 / self.rate_per_min.high
        blocks = int(t.max(initial=0.0) / (_BLOCK * shortest)) + 1
        return 1 << (blocks - 1).bit_length()

    def __repr__(self) -> str:
        held = f", {len(self.holds)} held" if self.holds else ""
        return f"Breathing({self.rate_per_min.mean:g}/min, {self.excursion_mm.mean:.3g} mm{held})"


@lru_cache(maxsize=32)
def _drawn(rate: Spread, excursion: Spread, seed: int, blocks: int) -> tuple[Array, Array]:
    """When breaths begin (n + 1,) and how high they are (n,): each block from its own number, so that all stay so."""
    shares = np.concatenate([np.random.default_rng([seed, block]).random((_BLOCK, 2)) for block in range(blocks)])
    starts = np.concatenate([[0.0], np.cumsum(60 / rate.at(shares[:, 0]))])
    heights = excursion.at(shares[:, 1])
    for values in (starts, heights):
        values.setflags(write=False)
    return starts, heights
