"""Threads that share one object of the core, as its docstrings allow."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from builds import needs_core
from core_calls import FACTOR, SOUND, prepared
from sonospline import _core

pytestmark = needs_core


@pytest.mark.parametrize("tries", [30, pytest.param(1000, marks=pytest.mark.slow)])
def test_a_plan_may_be_aimed_while_others_render(tries):
    render, arguments = prepared(_core.native, "BmodePlan.render")
    plan, expected = render.__self__, render(**arguments)
    aims = [SOUND["BmodePlan.aim"], {name: _copy(value) for name, value in SOUND["BmodePlan.aim"].items()}]
    with ThreadPoolExecutor(4) as pool:
        for k in range(tries):
            frames = [pool.submit(render, **arguments) for _ in range(3)]
            pool.submit(plan.aim, **aims[k % 2]).result()
            for frame in frames:
                assert all(map(np.array_equal, frame.result(), expected))


@pytest.mark.parametrize("tries", [50, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_factor_may_grow_and_be_cut_while_others_solve(tries):
    """Each solve sees the factor whole: 4 rows or 6, or too few for what it asks."""
    factor = _core.native.CholeskyFactor()
    factor.append(FACTOR[:4, :4].copy(), 1e-9)
    solved = {n: np.linalg.solve(FACTOR[:n, :n], np.ones(n)) for n in (4, 6)}

    def solve(n):
        x = np.ones((3, n))
        try:
            factor.solve(x)
        except ValueError:
            return n == 6
        return np.allclose(x, solved[n])

    with ThreadPoolExecutor(4) as pool:
        for _ in range(tries):
            results = [pool.submit(solve, n) for n in (4, 6, 4, 6)]
            factor.append(FACTOR[4:].copy(), 1e-9)
            factor.truncate(4)
            assert all(result.result() for result in results)


@pytest.mark.parametrize("call", ["ElasticMultigrid.iterate", "EchoScene.choose", "MultilevelPlan.evaluate"])
def test_what_threads_ask_of_one_object_is_what_one_asks(call):
    function, arguments = prepared(_core.native, call)
    arguments.pop("out", None)
    expected = function(**arguments)
    with ThreadPoolExecutor(4) as pool:
        for result in pool.map(lambda _: function(**arguments), range(40)):
            pairs = zip(result, expected, strict=True) if isinstance(expected, tuple) else [(result, expected)]
            assert all(np.array_equal(a, b) for a, b in pairs)


def _copy(value):
    return value.copy() if isinstance(value, np.ndarray) else value
