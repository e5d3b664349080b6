"""The core short of memory or threads: an error that Python sees, or a slower result; never the end of the process."""

import subprocess
import sys

import pytest

from builds import needs_core

pytestmark = [needs_core, pytest.mark.skipif(sys.platform != "linux", reason="memory is limited by its addresses")]

LIMITED = """
import resource, sys
import numpy as np
from sonospline._core import native

def more(megabytes):
    used = 4096 * int(open("/proc/self/statm").read().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (used + (megabytes << 20),) * 2)

"""

SHORT_OF_MEMORY = """
values, points = np.ones((9, 9, 9, 3), np.float32), np.zeros((400_000, 3))
plan = native.MultilevelPlan((200, 200, 200), (1.0, 1.0, 1.0))
index, weights, affine = np.zeros((4, 3), np.int64), np.ones((4, 3)), np.zeros((4, 3))
factor = native.CholeskyFactor()
planes, x, y, z = (np.ones(s, np.float32) for s in ((3, 30, 30, 30), (200, 32), (200, 32), (30, 200)))
work = [
    lambda: native.sample_lattice(values, (1.0, 1.0, 1.0), points),
    lambda: plan.evaluate(index, weights, affine),
    lambda: native.resample_lattice(planes, x, y, z),
    lambda: factor.reserve(4000),
    lambda: native.sum_on_lattice_f64(0, (200, 200, 200), (1.0, 1.0, 1.0), weights, weights, affine),
]
native.set_thread_count(2)
native.sample_lattice(values, (1.0, 1.0, 1.0), points[:9000])
more(int(sys.argv[1]))
failed = 0
for each in work * 3:
    try:
        each()
    except MemoryError:
        failed += 1
print(failed)
"""

SHORT_OF_THREADS = """
points, centres, affine = np.random.default_rng(1).random((4000, 3)), np.ones((300, 3)), np.zeros((4, 3))
native.set_thread_count(1)
alone = native.sum_at_points_f64(0, points, centres, centres, affine)
native.set_thread_count(1000)
more(200)  # each thread takes 8 MB of addresses
assert np.array_equal(native.sum_at_points_f64(0, points, centres, centres, affine), alone)
"""


def limited(code, *arguments):
    command = [sys.executable, "-c", LIMITED + code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("megabytes", [10, pytest.param(50, marks=pytest.mark.slow), 100])
def test_a_process_short_of_memory_is_told_so_and_goes_on(megabytes):
    process = limited(SHORT_OF_MEMORY, megabytes)
    assert (process.returncode, process.stderr) == (0, "")
    assert int(process.stdout) >= 3


def test_a_process_short_of_threads_computes_with_those_it_has():
    process = limited(SHORT_OF_THREADS)
    assert (process.returncode, process.stderr) == (0, "")
