"""Samples of a data set a second: 256 x 256 B-mode, labels, displacement in the plane, elastic tissue of about 25^3.

Claims: 25 a second for each core; two workers make 1.8 times as many as one process; 180 kB a sample at most.

    python benchmarks/a_core_makes_twenty_five_samples_a_second.py [samples of each run]

Ends with 1 where one is missed. Rates are of what comes after the first shard of each worker, which pays for its start;
every process computes with one thread, that of arrays' files included.

Beside it what this machine lets two processes gain that share nothing: of the solver alone, and of whole samples that
nobody stores. Cores that share a cache, a memory bus or, as threads, one core's units, gain less than twice as much.
"""

import multiprocessing
import os
import sys
import tempfile
import time

os.environ["SONOSPLINE_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["OMP_NUM_THREADS"] = os.environ["ZARR_THREADING__MAX_WORKERS"] = "1"

from sonospline.dataset import Plan, Specification, World, make_dataset

TEXT = """
samples = {samples}
seed = 1
[[sources]]
kind = "block"
[anatomy]
samples = 128
"""
LEAST_A_SECOND, LEAST_GAIN, MOST_BYTES = 25.0, 1.8, 180_000
WINDOW_S = 15.0


def rate(samples, workers):
    """Samples a second after the first shards, and bytes a sample."""
    seen = []
    with tempfile.TemporaryDirectory() as folder:
        made = make_dataset(
            Specification.parse(TEXT.format(samples=samples)), folder, workers=workers,
            progress=lambda done, of, failed: seen.append((time.perf_counter(), done)),
        )  # fmt: skip
    start = seen[min(workers, len(seen) - 2)]
    return (seen[-1][1] - start[1]) / (seen[-1][0] - start[0]), made.bytes_a_sample


def together(barrier):
    global begun
    begun = barrier


def solve(world, recipe):
    world.model.step(world.model.rest, {"needle": recipe.needle}, 0.0)


def image(world, recipe):
    world.sample(recipe)


def repeat(what, anatomy):
    """How many a second a process does, all processes in one window of time."""
    plan = Plan(Specification.parse(TEXT.format(samples=1280)))
    world, samples = World(plan.anatomy(anatomy), plan.labels()), plan.asked.anatomy.samples
    recipes = [plan.recipe(anatomy * samples + number) for number in range(plan.asked.view.samples)]
    what(world, recipes[0])
    begun.wait()
    count, start = 0, time.perf_counter()
    while (now := time.perf_counter() - start) < WINDOW_S:
        what(world, recipes[count % len(recipes)])
        count += 1
    return count / now


def gain(what):
    """How many times as much two processes do in all as one alone."""
    found = []
    for count in (1, 2):
        barrier = multiprocessing.Barrier(count)
        with multiprocessing.Pool(count, together, (barrier,)) as pool:
            found.append(sum(pool.starmap(repeat, [(what, number) for number in range(count)], chunksize=1)))
    return found[1] / found[0]


if __name__ == "__main__":
    samples = int(sys.argv[1]) if sys.argv[1:] else 2560
    multiprocessing.set_start_method("spawn")
    alone, size = rate(samples, 1)
    both, _ = rate(samples, 2)
    print(f"one process   {alone:6.1f} samples a second   at least {LEAST_A_SECOND:g}")
    print(f"two workers   {both / alone:6.2f} times as many   at least {LEAST_GAIN:g}")
    print(f"  two processes alone, solver only  {gain(solve):6.2f} times as many   what this machine lets them")
    print(f"  two processes alone, not stored   {gain(image):6.2f} times as many")
    print(f"size        {size:8,.0f} bytes a sample   at most {MOST_BYTES:,}")
    print(f"a million samples: {1e6 / alone / 3600:.1f} core hours, {size / 1000:.0f} GB, or 0.1 GB of recipes")
    sys.exit(alone < LEAST_A_SECOND or both / alone < LEAST_GAIN or size > MOST_BYTES)
