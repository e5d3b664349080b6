"""Breathing: a pure, continuous function of time within the bounds that its draws were given."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import truncnorm

from sonospline.mechanics import EXCURSION_MM, RATE_PER_MIN, BreathHold, Breathing, Spread

seeds = st.integers(0, 2**40)
times = st.floats(0, 5000)


def alike(rate, height):
    return Spread(rate, 0, rate, rate), Spread(height, 0, height, height)


@given(seed=seeds, start=times, exponent=st.integers(1, 3))
def test_no_step_is_larger_than_the_steepest_breath_allows(seed, start, exponent):
    t = start + np.linspace(0, 20, 4001)
    s = Breathing(seed=seed, exponent=exponent).excursion(t)
    x = np.linspace(0, np.pi, 10001)
    slope = (
        np.abs(np.diff(np.sin(x) ** (2 * exponent)) / np.diff(x)).max() * np.pi
    )  # of a breath of height and period 1
    steepest = slope * EXCURSION_MM.high * RATE_PER_MIN.high / 60
    assert np.abs(np.diff(s)).max() <= 1.001 * steepest * (t[1] - t[0])
    assert s.min() >= 0 and s.max() <= EXCURSION_MM.high


@given(
    rate=st.floats(5, 40),
    height=st.floats(1, 40),
    n=st.integers(1, 3),
    t=st.floats(0, 200),
    breaths=st.integers(0, 20),
)
def test_breaths_that_are_all_alike_repeat_and_are_lujan_s_curve(rate, height, n, t, breaths):
    breathing, period = Breathing(*alike(rate, height), exponent=n), 60 / rate
    assert breathing.excursion(t + breaths * period) == pytest.approx(breathing.excursion(t), abs=1e-6 * height)
    lujan = height * np.cos(np.pi * (t / period - 0.5)) ** (2 * n)
    assert breathing.excursion(t) == pytest.approx(lujan, abs=1e-6 * height)


@given(seed=seeds, t=st.lists(times, min_size=1, max_size=30), other=times)
def test_the_same_seed_and_time_give_the_same_bits_in_any_order(seed, t, other):
    breathing = Breathing(seed=seed)
    first = breathing.excursion(t)
    breathing.excursion(other), breathing.held(other).excursion(9 * other)
    again = [pickle.loads(pickle.dumps(Breathing(seed=seed))).excursion(x) for x in reversed(t)]
    assert first.tolist() == again[::-1]


def test_later_breaths_change_no_earlier_ones():
    t = np.linspace(0, 300, 1000)
    alone = Breathing(seed=3).excursion(t)
    assert np.array_equal(Breathing(seed=3).excursion(np.append(t, 9e5))[:-1], alone)
    assert not np.array_equal(Breathing(seed=4).excursion(t), alone)


@given(sd=st.floats(0.1, 10), shares=st.lists(st.floats(0, 1), min_size=1, max_size=5))
def test_draws_are_those_of_a_truncated_normal_distribution(sd, shares):
    spread = Spread(10, sd, 4, 30)
    exact = truncnorm((4 - 10) / sd, (30 - 10) / sd, loc=10, scale=sd).ppf(shares)
    assert spread.at(shares) == pytest.approx(exact, rel=1e-6)


@settings(max_examples=50)
@given(
    seed=seeds, start=st.floats(0, 500), length=st.floats(0, 60), drift=st.floats(0, 8), t=st.floats(0, 1000)
)  # fmt: skip
def test_a_held_breath_stands_still_but_for_its_drift_and_goes_on_from_there(seed, start, length, drift, t):
    free, end = Breathing(seed=seed), start + length
    held = free.held(start, drift_mm=drift).released(end)
    (hold,) = held.holds
    if t <= start:
        assert held.excursion(t) == free.excursion(t)
    elif t <= end:
        crept = drift * min(t - start, hold.drift_s) / hold.drift_s
        assert held.excursion(t) == pytest.approx(free.excursion(start) - crept, abs=1e-6)
    elif t >= end + hold.return_s:
        assert held.excursion(t) == pytest.approx(free.excursion(t - length), abs=1e-5)
    near = np.array([max(start - 1e-4, 0), start + 1e-4, max(end - 1e-4, 0), end + 1e-4])
    steps = np.abs(np.diff(held.excursion(near)))[::2]
    assert steps.max() < 0.05


def test_several_holds_follow_one_another():
    breathing = Breathing(*alike(15, 17)).held(1, drift_mm=0).released(11).held(20, drift_mm=0).released(25)
    t = np.array([0.5, 5, 12, 22, 30])
    assert breathing.excursion(t) == pytest.approx(Breathing(*alike(15, 17)).excursion([0.5, 1, 2, 10, 15]))
    assert breathing.released(30) is breathing


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Spread(5, 1, 6, 7), "mean = 5 is not between low = 6 and high = 7; give low <= mean <= high"),
        (lambda: Spread(5, -1, 4, 7), "sd = -1 is out of range; give a finite number at or above zero"),
        (lambda: Spread(0, 1, 0, 7), "mean = 0 is out of range; give a finite number above zero"),
        (lambda: Breathing(17.3), "rate_per_min = 17.3 is not a Spread"),
        (lambda: Breathing(exponent=4), "exponent = 4 is too large; give at most 3"),
        (lambda: Breathing(seed=-1), "seed = -1 is too small; give at least 0"),
        (lambda: BreathHold(5, 4), "end_s = 4 is before start_s = 5; give a later time"),
        (lambda: BreathHold(5, float("nan")), "end_s = nan is before start_s = 5"),
        (lambda: BreathHold(5, drift_s=0), "drift_s = 0 is out of range; give a finite number above zero"),
        (lambda: Breathing().held(5).held(9), "holds overlap: one ends at inf s, the next begins at 9 s"),
        (lambda: Breathing().excursion(-1), "t = -1 is out of range; give seconds from 0 to 1e+06"),
        (lambda: Breathing().excursion([1, np.nan]), "t = [1, nan] is out of range"),
    ],
)
def test_what_makes_no_breathing_is_refused_in_a_line(make, said):
    with pytest.raises(ValueError) as error:
        make()
    assert said in str(error.value) and "\n" not in str(error.value)
