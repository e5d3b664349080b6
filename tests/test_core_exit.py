"""A process that ends while threads are in the core, or between steps of a session, ends with its own code."""

import subprocess
import sys

import pytest

from builds import needs_core

IN_THE_CORE = """
import itertools, sys, threading
import numpy as np
from sonospline._core import native
values, points = np.zeros((40, 40, 40, 3), np.float32), np.random.rand(int(sys.argv[1]), 3) * 39
plan = native.MultilevelPlan((17, 17, 17), (1.0, 1.0, 1.0))
index, weights, affine = np.zeros((40, 3), np.int64), np.ones((40, 3)), np.zeros((4, 3))
begun = threading.Barrier(4)

def sample():
    begun.wait()
    while True:
        native.sample_lattice(values, (1.0, 1.0, 1.0), points)

def evaluate():
    begun.wait()
    while True:
        plan.evaluate(index, weights, affine)

for work in (sample, sample, evaluate):
    threading.Thread(target=work, daemon=True).start()
begun.wait()
sys.exit(7)
"""

IN_A_SESSION = """
import sys, threading, time, types
from sonospline.simulator import Runner

class Slow:
    last, command = None, types.SimpleNamespace(frozen=False)
    def step(self, command, dt):
        inside.set()
        print("begun", flush=True)
        time.sleep(0.3)
        print("done", flush=True)
        raise ValueError("no picture")

inside = threading.Event()
runner = Runner(Slow())
runner.subscribe(lambda frame, stamp: None)
inside.wait(60)
sys.exit(7)
"""


def ends(code, *arguments):
    process = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False
    )
    return process.returncode, process.stdout, process.stderr


@needs_core
@pytest.mark.parametrize("points", [50, 20000])
def test_a_process_may_end_while_daemon_threads_are_in_the_core(points):
    assert ends(IN_THE_CORE, points) == (7, "", "")


@needs_core
@pytest.mark.slow
@pytest.mark.parametrize("points", [50, 3000, 20000])
def test_thirty_processes_end_with_their_own_code(points):
    assert {ends(IN_THE_CORE, points) for _ in range(10)} == {(7, "", "")}


def test_the_end_of_a_process_waits_for_the_step_of_a_session():
    """The thread is a daemon: without being waited for it would be cut off within its step."""
    code, out, _ = ends(IN_A_SESSION)
    assert code == 7
    assert out.endswith("begun\ndone\n")
