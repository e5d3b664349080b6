"""Threads that share one object of the core, as its docstrings allow."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from builds import needs_core
from core_calls import FACTOR, SOUND, prepared
from force_hands import shaft
from sonospline import _core
from sonospline.link import Coupling
from sonospline.link.coupling import SWEEPS

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


@pytest.mark.parametrize("tries", [20, pytest.param(500, marks=pytest.mark.slow)])
def test_a_law_may_be_ticked_by_several_threads(tries):
    """Hands that are held still: so many ticks come to the same, whoever made them, and no state is a half-made one."""
    contact, at, heard = shaft(12), np.tile([0.0, 0.0, 3.0], (64, 1)), np.zeros(64)
    laws = [_core.native.ForceLaw(64, Coupling().for_core(), SWEEPS) for _ in range(2)]
    for law in laws:
        law.renew(**contact.for_core())
        law.tick(at * 0, heard, 0.0)

    def tick(number):
        if number % 4 == 0:
            forces, _, _ = laws[1].state()
            return bool((forces == forces[0]).all())
        return bool((np.ptp(laws[1].tick(at, heard, 0.0), axis=0) == 0).all())

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(tick, range(4 * tries)))
    for _ in range(3 * tries):
        laws[0].tick(at, heard, 0.0)
    assert all(map(np.array_equal, laws[0].state(), laws[1].state()))


def test_a_loop_may_be_begun_ended_and_asked_by_several_threads():
    loop = _core.native.ForceLoop(Coupling().for_core(), SWEEPS)
    calls = (loop.start, loop.running, loop.stop, loop.running, loop.reading, lambda: loop.place(np.zeros(3)))
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda number: calls[number % len(calls)](), range(240)))
    loop.stop()
    assert not loop.running()
    loop.start()
    assert loop.running()
    loop.stop()
