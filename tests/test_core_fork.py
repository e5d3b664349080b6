"""fork() while threads compute: the child can use the same objects, and new ones, and its results are right."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from builds import needs_core
from sonospline import _core

pytestmark = [needs_core, pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")]

DEADLINE_S = 60
SPACING = (1.0, 1.0, 1.0)
AFFINE = np.zeros((4, 3))


class Busy:
    """A plan, a factor and a lattice, each in use by a thread of its own until the end of the block."""

    def __init__(self):
        rng = np.random.default_rng(5)
        self.plan = _core.native.MultilevelPlan((33, 33, 33), SPACING)
        self.landmarks = rng.integers(0, 33, (200, 3)), rng.random((200, 3)), AFFINE
        self.factor = _core.native.CholeskyFactor()
        matrix = rng.random((200, 200))
        assert self.factor.append(matrix @ matrix.T + 200 * np.eye(200), 1e-9)
        self.right = rng.random((3, 200))
        self.lattice = rng.random((30, 30, 30, 3)).astype(np.float32), SPACING, rng.random((5000, 3)) * 29
        self.expected = self.results()
        self.over = threading.Event()
        self.threads = [threading.Thread(target=self.repeat, args=(work,)) for work in self.works]

    @property
    def works(self):
        return self.evaluate, self.solve, self.sample

    def evaluate(self):
        return self.plan.evaluate(*self.landmarks)

    def solve(self):
        x = self.right.copy()
        self.factor.solve(x)
        return x

    def sample(self):
        return _core.native.sample_lattice(*self.lattice)

    def results(self):
        return [work() for work in self.works]

    def repeat(self, work):
        while not self.over.is_set():
            work()

    def right_again(self):
        return all(map(np.array_equal, self.results(), self.expected))

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *problem):
        self.over.set()
        for thread in self.threads:
            thread.join()


def code_of_child(work):
    """Fork, do the work in the child until the deadline, and return its exit code; -SIGALRM where it hung."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            signal.alarm(DEADLINE_S)
            code = 0 if work() else 2
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def forks_once_more(busy):
    return busy.right_again() and code_of_child(busy.right_again) == 0


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("tries", [5, pytest.param(50, marks=pytest.mark.slow)])
def test_the_child_of_a_busy_process_computes_with_its_objects(native, tries):
    native.set_thread_count(2)
    with Busy() as busy:
        assert {code_of_child(lambda: forks_once_more(busy)) for _ in range(tries)} == {0}
    assert busy.right_again()


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("tries", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_processes_of_multiprocessing_that_are_forked_compute_too(native, tries):
    native.set_thread_count(2)
    context = multiprocessing.get_context("fork")
    with Busy() as busy:
        for _ in range(tries):
            process = context.Process(target=lambda: sys.exit(0 if busy.right_again() else 2))
            process.start()
            process.join(DEADLINE_S)
            if process.is_alive():
                process.kill()
                process.join()
            assert process.exitcode == 0


QUIET = """
import os, sys
import numpy as np
from sonospline._core import native

def threads():
    return len(os.listdir("/proc/self/task"))

native.set_thread_count(3)
native.sample_lattice(np.zeros((9, 9, 9, 3), np.float32), (1.0, 1.0, 1.0), np.zeros((9000, 3)))
assert threads() == 3
child = os.fork()
if child:
    assert threads() == 1
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
def test_a_fork_finds_no_threads_of_the_core():
    """Python from 3.12 on warns of a fork in a process with several threads, and rightly so."""
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.run(
        [sys.executable, "-W", "error", "-c", QUIET],
        env=alone,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert (process.returncode, process.stderr) == (0, "")
