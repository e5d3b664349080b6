"""Random numbers by name: any of them is found without drawing those before it."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.random import Generator, Philox, SeedSequence
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Stream(IntEnum):
    """What numbers are drawn for."""

    ANATOMY = 0
    VIEW = 1
    SAMPLE = 2
    SPLIT = 9


def stream(seed: int, of: Stream, *number: int) -> Generator:
    """Return the random numbers of one anatomy, view or sample: a function of the seed and the rest alone.

    Counter-based (Philox, Salmon et al. 2011), keyed by a hash of seed and number (O'Neill's ``SeedSequence``).

    Examples
    --------
    >>> from sonospline.dataset.draws import Stream, stream
    >>> stream(1, Stream.SAMPLE, 10**6).random() == stream(1, Stream.SAMPLE, 10**6).random()
    True
    """
    return Generator(Philox(SeedSequence(seed, spawn_key=(int(of), *number))))


def between(random: Generator, ends: tuple[float, float]) -> float:
    """Return a number of a range, all alike."""
    low, high = ends
    return low + (high - low) * float(random.random())


def factor_between(random: Generator, ends: tuple[float, float]) -> float:
    """Return a factor of a range: its logarithm is even."""
    low, high = np.log(ends)
    return float(np.exp(low + (high - low) * random.random()))


def towards_anywhere(random: Generator) -> Array:
    """Return a unit vector (3,), every direction alike."""
    drawn: Array = random.standard_normal(3)
    return drawn / np.linalg.norm(drawn)


def even(seed: int, number: int) -> float:
    """Return a number from 0 to 1 such that those of 0 .. n - 1 are even for every n.

    The radical inverse to base 2 (van der Corput), turned by a number of the seed.
    """
    inverse, half = 0.0, 0.5
    while number:
        inverse += half * (number & 1)
        number, half = number >> 1, half / 2
    return (inverse + float(stream(seed, Stream.SPLIT).random())) % 1.0
