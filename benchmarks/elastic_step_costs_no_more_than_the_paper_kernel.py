"""Elastic finite elements against the paper's kernel, in one run.

Claims: a step on 25^3 nodes with up-sampling to 53^3 costs at most 1.5 times a step of the
paper's kernel at 53^3 with 300 landmarks, a step on 53^3 nodes at most 10 times; a 25^3 step
at most 1 ms on one core; set-up of a label map at 53^3 under 0.2 s; one back-substitution of
a factored 49^3 matrix (with --factor; minutes) at least 100 times as much as a 25^3 step.
"""

import statistics
import sys
import time

import numpy as np

import sonospline as ss
from sonospline import _core
from sonospline.elasticity import ElasticSolver
from sonospline.mechanics import LineForce, labelled_cube

ROUNDS, IN_A_ROW = 8, 10
LOAD = LineForce()
tissue = ss.Tissue(ss.Grid.unit_cube(53))
whole = ss.Needle((0, 0.413, 0.578), (0.617, 0.531, 0.469))
needles = [
    ss.Needle(whole.entry, whole.at(0.5 + 0.5 * k / (ROUNDS * IN_A_ROW))) for k in range(1, ROUNDS * IN_A_ROW + 1)
]


def milliseconds(function):
    start = time.perf_counter()
    result = function()
    return 1e3 * (time.perf_counter() - start), result


class Paper:
    name = "paper kernel at 53^3, 300 landmarks, on the grid"

    def __init__(self):
        self._insertion = ss.Insertion(tissue)
        self.step(whole)

    def step(self, needle):
        self._insertion.advance(needle).on_grid()


class Elastic:
    def __init__(self, side, *, resampled, threads=None):
        self.name = f"elastic, {side}^3 nodes" + (", up-sampled to 53^3" if resampled else ", the field on its nodes")
        self.name += f", {threads} thread" if threads else ""
        self._resampled, self._threads = resampled, threads
        with_threads(threads)
        self.setup_ms, self._solver = milliseconds(lambda: ElasticSolver(tissue, labelled_cube("body"), nodes=side**3))
        self._state = self._solver.rest
        self.step(needles[0])

    def step(self, needle):
        with_threads(self._threads)
        self._state = self._solver.step(self._state, LOAD, needle)
        if self._resampled:
            self._solver.field(self._state).on_grid()


def with_threads(count):
    if _core.native is not None:
        _core.native.set_thread_count(count or THREADS)


def back_substitution_ms():
    from sonospline.fem import FiniteElementModel

    model = FiniteElementModel(ss.Tissue(ss.Grid.unit_cube(49)), solver="direct")
    model.solve(LOAD, needles[0])
    model.solve(LOAD, needles[1])
    return 1e3 * model.times[-1].solve_s


THREADS = 1 if _core.native is None else _core.native.thread_count()
peers = [
    Paper(),
    Elastic(25, resampled=True),
    Elastic(25, resampled=False, threads=1),
    Elastic(25, resampled=False),
    Elastic(33, resampled=False),
    Elastic(49, resampled=False),
    Elastic(53, resampled=False, threads=1),
    Elastic(53, resampled=False),
]
times = {peer.name: [] for peer in peers}
for turn in range(ROUNDS):  # peers take turns, some steps each: a live loop has its caches warm
    for peer in peers:
        peer.step(needles[turn * IN_A_ROW])
        for needle in needles[turn * IN_A_ROW + 1 : (turn + 1) * IN_A_ROW]:
            times[peer.name].append(milliseconds(lambda peer=peer, needle=needle: peer.step(needle))[0])

print(
    f"{_core.instruction_set()}, {THREADS} threads, {ROUNDS} turns; every eighth elastic step also measures its error"
)
paper = times[peers[0].name]
for name, rounds in times.items():
    ratio = statistics.median(t / p for t, p in zip(rounds, paper, strict=True))
    print(f"{name:50s} {statistics.median(rounds):7.2f} ms  (min {min(rounds):.2f})  {ratio:5.2f} x the paper's kernel")
tissues = labelled_cube("body")
setup = [milliseconds(lambda: ElasticSolver(tissue, tissues, nodes=53**3))[0] for _ in range(5)]
print(f"set-up of a label map at 53^3: {statistics.median(setup):.0f} ms (min {min(setup):.0f})")
if "--factor" in sys.argv:
    found = back_substitution_ms()
    print(f"one back-substitution at 49^3: {found:.0f} ms, {found / np.median(times[peers[3].name]):.0f} x a 25^3 step")
