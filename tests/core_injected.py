"""Allocations and threads that fail on demand: tests of the sanitized build, which test_core_sanitized.py runs."""

import threading
from contextlib import suppress

import numpy as np
import pytest

from core_calls import MULTIGRID, SOUND, prepared
from sonospline import _core


def large_solver():
    """More nodes than one thread takes alone, so that its phases are shared."""
    cells = (5, 82, 82)
    level = ((1.0, 1.0, 1.0), np.full(cells, 3, np.float32), np.ones(cells, np.float32))
    coarser = ((1.0, 2.0, 2.0), np.full((5, 41, 41), 3, np.float32), np.ones((5, 41, 41), np.float32))
    springs = np.zeros((3, *(n + 1 for n in cells)), np.float32)
    settings = {"levels": [level, coarser], "coarse_inverse": np.zeros((0, 0), np.float32), "springs": springs}
    return _core.native.ElasticMultigrid(**MULTIGRID | settings)


def large_iterate():
    solver, load = large_solver(), np.zeros((3, 6, 83, 83), np.float32)
    load[0, 3, 40, 40] = 1
    return lambda: solver.iterate(load, np.zeros_like(load), 1, True)


def repeated(call):
    """A call that can be made again and again on the same object."""
    function, arguments = prepared(_core.native, call)
    return lambda: function(**arguments)


WORK = {call: lambda call=call: repeated(call) for call in SOUND if call != "CholeskyFactor.append"} | {
    "large solver": lambda: large_solver,
    "large iterate": large_iterate,
}


def numbers(result):
    parts = result if isinstance(result, tuple) else (result,)
    return [np.asarray(part) for part in parts if isinstance(part, np.ndarray | list | float | bool)]


def turns():
    """Which allocation fails: each of the first twenty, then fewer and fewer."""
    after = 0
    while True:
        yield after
        after += 1 + max(0, after - 20) // 3


@pytest.mark.parametrize("work", WORK, ids=str)
@pytest.mark.parametrize("threads", [1, 2])
def test_every_allocation_may_fail(native, work, threads):
    """One after the other; the object goes on as if nothing had happened."""
    native.set_thread_count(threads)
    function = WORK[work]()
    expected = numbers(function())
    for after in turns():
        native.fail_allocation(after)
        with suppress(MemoryError):
            function()
        failed = native.allocation_failed()
        native.fail_allocation(-1)
        assert all(map(np.array_equal, numbers(function()), expected))
        if not failed:
            break


def test_a_factor_that_could_not_grow_is_as_it_was(native):
    rows = 3 * np.eye(40) + 1
    for after in range(100):
        factor = native.CholeskyFactor()
        factor.append(rows[:20, :20].copy(), 1e-9)
        native.fail_allocation(after)
        try:
            factor.append(rows[20:].copy(), 1e-9)
        except MemoryError:
            assert factor.size == 20
        failed = native.allocation_failed()
        native.fail_allocation(-1)
        if factor.size == 20:
            factor.append(rows[20:].copy(), 1e-9)
        x = np.ones((3, 40))
        factor.solve(x)
        np.testing.assert_allclose(x @ rows, 1, rtol=1e-12)
        if not failed:
            return


@pytest.mark.parametrize("started", [0, 1, 2])
def test_threads_that_cannot_be_started_are_done_without(native, started):
    function = repeated("BmodePlan.render")
    expected = function()
    native.set_thread_count(5)  # so that a new team is made
    native.fail_threads(started)
    try:
        results = [function() for _ in range(3)]
    finally:
        native.fail_threads(-1)
        native.set_thread_count(2)
    assert all(np.array_equal(a, b) for result in results for a, b in zip(result, expected, strict=True))


def test_an_exception_in_one_thread_stops_neither_the_others_nor_later_work(native):
    """Threads share the solver while allocations of any of them fail."""
    native.set_thread_count(2)
    function, seen = large_iterate(), []
    expected = function()[0]

    def work():
        for _ in range(10):
            try:
                seen.append(np.array_equal(function()[0], expected))
            except MemoryError:
                seen.append("failed")

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for after in range(40):
        native.fail_allocation(after)
    for thread in threads:
        thread.join()
    native.fail_allocation(-1)
    assert set(seen) <= {True, "failed"}  # and never a wrong result
    assert len(seen) == 30
    assert np.array_equal(function()[0], expected)
