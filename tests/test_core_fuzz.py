"""Calls of the core with arguments spoilt at random: each returns, or raises what Python raises of wrong arguments."""

import numpy as np
import pytest

from builds import needs_core
from core_calls import SOUND, prepared
from sonospline import _core

REFUSALS = (ValueError, TypeError, MemoryError, OverflowError)
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 1e-30, 1e6, 2.0**31, -(2.0**63), 1e300, np.inf, -np.inf, np.nan)
WHOLES = (0, 1, -1, 2, 3, 7, 16, 255, 2**15, 2**31 - 1, 2**31, 2**32, 2**40, 2**63, -(2**31), 10**30)


def of_another_shape(rng, array):
    """Cut, repeated or emptied along one axis; sometimes another number of axes."""
    axis = rng.integers(array.ndim)
    length = int(rng.choice([0, 1, array.shape[axis] - 1, array.shape[axis] + 1, 2 * array.shape[axis]]))
    other = np.take(array, np.arange(length) % array.shape[axis], axis=axis, mode="wrap")
    return other if rng.random() < 0.9 else other[None] if rng.random() < 0.5 else other[..., :1].ravel()


def of_other_numbers(rng, array):
    """Some numbers out of all bounds, wherever they may be held."""
    other = array.copy()
    few = rng.integers(max(1, other.size), size=1 + rng.integers(4))
    if other.size:
        wanted = rng.choice(FLOATS, len(few))
        limits = np.iinfo(other.dtype) if other.dtype.kind in "iu" else None
        with np.errstate(over="ignore"):
            other.reshape(-1)[few] = (
                wanted.astype(other.dtype) if limits is None else rng.choice([limits.min, limits.max, -1 % 2**7, 0, 1])
            )
    return other


def spoilt(rng, value):
    if isinstance(value, np.ndarray):
        return of_another_shape(rng, value) if rng.random() < 0.5 else of_other_numbers(rng, value)
    if isinstance(value, tuple | list) and value:
        at = rng.integers(len(value))
        return type(value)(spoilt(rng, item) if i == at else item for i, item in enumerate(value))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return int(WHOLES[rng.integers(len(WHOLES))])
    return float(rng.choice(FLOATS))


@needs_core
@pytest.mark.parametrize("tries", [300, pytest.param(20_000, marks=pytest.mark.slow)])
def test_whatever_the_arguments_the_process_goes_on(tries):
    calls, outcomes = list(SOUND), set()
    for seed in range(tries):
        rng = np.random.default_rng(seed)
        call = calls[seed % len(calls)]
        function, arguments = prepared(_core.native, call)
        for name in rng.permutation(list(arguments))[: 1 + rng.integers(3)]:
            arguments[name] = spoilt(rng, arguments[name])
        try:
            function(**arguments)
            outcomes.add("done")
        except REFUSALS as refusal:
            outcomes.add(type(refusal))
    assert {"done", ValueError, TypeError} <= outcomes
