"""Prony series: passive, exact in time, and the inverse of their own creep."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sonospline.mechanics import ExponentialStep, Material, MaterialTable, PronySeries

TIMES = st.lists(st.floats(0.01, 1000), min_size=1, max_size=6, unique_by=lambda t: round(np.log(t), 1))


@st.composite
def some_series(draw):
    times = draw(TIMES)
    parts = np.array(draw(st.lists(st.floats(0, 1), min_size=len(times), max_size=len(times))))
    whole = draw(st.floats(0, 0.95))
    return PronySeries(tuple(whole * parts / max(parts.sum(), 1e-3)), tuple(times))


def in_laplace(series, s):
    return series.long_term + sum(g * s / (s + 1 / t) for g, t in zip(series.fractions, series.times_s, strict=True))


@given(some_series(), st.floats(1e-4, 1e4))
def test_creep_is_the_inverse_of_relaxation(series, s):
    creep = series.creep
    compliance = 1 + sum(j / (1 + s * t) for j, t in zip(creep.amounts, creep.times_s, strict=True))
    assert compliance * in_laplace(series, s) == pytest.approx(1, rel=1e-9)
    assert min(creep.amounts) >= 0 and min(creep.times_s) > 0
    assert 1 + sum(creep.amounts) == pytest.approx(1 / series.long_term, rel=1e-9)


def test_the_compliance_of_two_terms_is_the_published_one():
    creep = PronySeries((0.3, 0.3), (0.5, 10)).creep
    np.testing.assert_allclose(creep.amounts, (0.40, 1.10), atol=0.005)
    np.testing.assert_allclose(creep.times_s, (0.71, 17.7), rtol=0.005)
    np.testing.assert_allclose(creep.compliance([0, 1e6]), (1, 2.5))


@given(TIMES, st.floats(1e-6, 100), st.floats(-2, 2), st.floats(-2, 2))
def test_a_step_is_exact_for_what_changes_linearly_however_it_is_cut(times, dt, before, after):
    start = np.linspace(-1, 1, len(times))
    whole = ExponentialStep.of(times, dt).branches(start, before, after)
    v, f = start, before
    for part in (0.1, 0.25, 0.65):
        reached = f + part * (after - before)
        v, f = ExponentialStep.of(times, part * dt).branches(v, f, reached), reached
    np.testing.assert_allclose(v, whole, atol=1e-12)


def test_a_step_is_that_of_its_differential_equation():
    times, start, before, after, dt = np.array([0.3, 4.0]), np.array([1.0, -0.5]), 0.2, 1.7, 2.5
    exact = solve_ivp(
        lambda t, v: (before + (after - before) * t / dt - v) / times, (0, dt), start, rtol=1e-10, atol=1e-12
    )
    found = ExponentialStep.of(times, dt).branches(start, before, after)
    np.testing.assert_allclose(found, exact.y[:, -1], atol=1e-8)


def test_no_time_changes_nothing_and_a_minute_nearly_ends_it():
    none, minute = ExponentialStep.of((0.1, 10), 0.0), ExponentialStep.of((0.1, 10), 60.0)
    assert none.kept.tolist() == none.ramp.tolist() == [1, 1]
    assert minute.kept.max() < 3e-3 and np.isfinite(minute.ramp).all()
    start = np.array([0.3, 0.7])
    assert none.branches(start, 1.0, 5.0).tolist() == start.tolist()


@pytest.mark.parametrize(("exponent", "error"), [(0.05, 0.004), (0.1, 0.007), (0.25, 0.02), (0.4, 0.035)])
def test_four_terms_follow_a_power_law(exponent, error):
    series, t = PronySeries.power_law(exponent), np.geomspace(0.1, 100, 500)
    assert series.times_s == (0.1, 1, 10, 100) and series.long_term > 0.02
    law = series.modulus(t) * t**exponent
    assert law.max() / law.min() < (1 + error) / (1 - error)


def test_a_larger_exponent_leaves_less_and_none_is_elastic():
    left = [PronySeries.power_law(exponent).modulus([0.1, 1, 10, 100]) for exponent in np.linspace(0, 0.4, 9)]
    assert (np.diff(left, axis=0) < 0).all()
    assert PronySeries.power_law(0) == PronySeries() and left[0].tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"fractions": (0.5, 0.5), "times_s": (1, 10)}, r"fractions = \(0.5, 0.5\) are 1 or more together"),
        ({"fractions": (1.2,), "times_s": (1,)}, "are 1 or more together, which leaves held tissue no stress; give"),
        ({"fractions": (-0.1,), "times_s": (1,)}, r"fractions\[0\] = -0.1 is out of range; give a finite number at"),
        ({"fractions": (0.1,), "times_s": (0,)}, r"times_s\[0\] = 0 is out of range; give a finite number above zero"),
        ({"fractions": (0.1, 0.2), "times_s": (1,)}, "differ in number; give one time constant for each fraction"),
        ({"fractions": 0.1, "times_s": (1,)}, "fractions = 0.1 is no sequence; give one number for each term"),
        ({"fractions": (float("nan"),), "times_s": (1,)}, r"fractions\[0\] = nan is out of range"),
    ],
)
def test_a_series_that_is_not_passive_is_refused(arguments, problem):
    with pytest.raises(ValueError, match=problem):
        PronySeries(**arguments)


@pytest.mark.parametrize("value", [-0.1, 0.41, 2, float("inf"), "steep"])
def test_an_exponent_that_makes_no_passive_material_is_refused(value, tmp_path):
    with pytest.raises(ValueError, match=rf"^relaxation_exponent = '?{value}'? is .*; give [^\n]*$"):
        Material(relaxation_exponent=value)
    with pytest.raises(ValueError, match=rf"^exponent = '?{value}"):
        PronySeries.power_law(value)


def test_a_table_names_the_tissue_whose_exponent_is_wrong(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[liver]\nstiffness_kpa = 6\nrelaxation_exponent = 0.9\n")
    with pytest.raises(ValueError, match=r"\[liver\] relaxation_exponent = 0.9 is out of range; give 0, elastic, to"):
        MaterialTable.read(file)
    file.write_text("[liver]\nstiffness_kpa = 6\nrelaxation_exponent = 0.15\n")
    assert MaterialTable.read(file)["liver"].relaxation_exponent == 0.15


def test_the_materials_that_come_with_the_package_are_elastic():
    assert {material.relaxation_exponent for material in MaterialTable.assumed().materials.values()} == {0}


def test_a_series_is_a_value():
    one, other = PronySeries([0.3, 0.2], [1, 20]), PronySeries((0.3, 0.2), (1.0, 20.0))
    assert one == other == pickle.loads(pickle.dumps(one)) and len({one, other}) == 1
    assert one.creep == other.creep and one != PronySeries((0.3,), (1,))
    assert repr(one) == "PronySeries(0.3 in 1 s, 0.2 in 20 s)" and repr(PronySeries()) == "PronySeries(elastic)"
