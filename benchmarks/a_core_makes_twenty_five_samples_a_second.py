"""Samples of a data set a second: 256 x 256 B-mode, labels, displacement in the plane, elastic tissue of about 25^3.

Claims: 25 a second for each core; two workers make 1.8 times as many as one; 180 kB a sample at most.

    python benchmarks/a_core_makes_twenty_five_samples_a_second.py [samples of each run]

Ends with 1 where one is missed. Rates are of what comes after the first shard of each worker, which pays for its start;
every process computes with one thread.
"""

import os
import sys
import tempfile
import time

os.environ["SONOSPLINE_THREADS"] = "1"

from sonospline.dataset import Specification, make_dataset

TEXT = """
samples = {samples}
seed = 1
[[sources]]
kind = "block"
[anatomy]
samples = 256
[storage]
shard = 128
"""
LEAST_A_SECOND, LEAST_GAIN, MOST_BYTES = 25.0, 1.8, 180_000


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


if __name__ == "__main__":
    samples = int(sys.argv[1]) if sys.argv[1:] else 2560
    alone, size = rate(samples, 1)
    both, _ = rate(samples, 2)
    print(f"one process   {alone:6.1f} samples a second   at least {LEAST_A_SECOND:g}")
    print(f"two workers   {both / alone:6.2f} times as many   at least {LEAST_GAIN:g}")
    print(f"size        {size:8,.0f} bytes a sample   at most {MOST_BYTES:,}")
    print(f"a million samples: {1e6 / alone / 3600:.1f} core hours, {size / 1000:.0f} GB, or 0.1 GB of recipes")
    sys.exit(alone < LEAST_A_SECOND or both / alone < LEAST_GAIN or size > MOST_BYTES)
