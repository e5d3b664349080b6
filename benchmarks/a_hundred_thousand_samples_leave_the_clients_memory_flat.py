"""Memory of the process that has 100,000 samples made by two workers: what it keeps is a receipt of each shard.

Claim: from a tenth of the run to its end it grows by less than a tenth. Recipes are made, which are quick, in shards of
64: four times as many tasks and receipts as a data set of that size has by default. The scheduler is in that process.

    python benchmarks/a_hundred_thousand_samples_leave_the_clients_memory_flat.py [samples]

Ends with 1 where it grows by more.
"""

import os
import sys
import tempfile
from pathlib import Path

from sonospline.dataset import Specification, make_dataset

TEXT = 'samples = {}\n[[sources]]\nkind = "block"\n[storage]\nform = "recipe"\nshard = 64\n'
MOST = 1.1
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20


def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB


def main(samples):
    seen = {}

    def look(done, of, failed):
        seen[done] = resident_mb()

    with tempfile.TemporaryDirectory() as folder:
        made = make_dataset(Specification.parse(TEXT.format(samples)), folder, workers=2, progress=look)
    tenth = next(mb for done, mb in seen.items() if done >= samples / 10)
    last = seen[samples]
    print(f"{made.samples:,} samples, {len(seen) - 1:,} shards: {tenth:.0f} MB after a tenth, {last:.0f} MB at the end")
    each = (last - tenth) * 1e3 / (0.9 * (len(seen) - 1))
    print(f"found {last / tenth:.3f} times as much, less than {MOST:g}; {each:.1f} kB a shard")
    return last / tenth >= MOST


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else 100_000))
