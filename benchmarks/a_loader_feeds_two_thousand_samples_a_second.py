"""Samples a second that a loader gives a PyTorch loop from local shards: image and needle mask, 256 x 256, in batches.

Claims: over 2,000 a second in a loop that makes numbers of them as a network takes them; and, without PyTorch, as much
through NumPy. A second of the clock, and of one processor's time where others use the machine, too.

    python benchmarks/a_loader_feeds_two_thousand_samples_a_second.py [data set]

By default one is made here. Ends with 1 where it is missed by the processor's time; says so where PyTorch is not
installed.
"""

import os
import sys
import tempfile
import time
from importlib.util import find_spec

os.environ.setdefault("OMP_NUM_THREADS", "1")

from sonospline.dataset import DataSet, Specification, make_dataset, torch_samples

ARRAYS = ("image", "needle")
LEAST, ROUNDS, BATCH = 2000.0, 8, 64
TEXT = 'samples = 512\n[[sources]]\nkind = "block"\n[anatomy]\nsamples = 256\n[view]\nsamples = 64\n'


def rate(batches, use=lambda batch: None):
    """Samples a second of the clock and of a processor's time."""
    clock, processor, count = time.perf_counter(), time.process_time(), 0
    for batch in batches:
        use(batch)
        count += len(batch["index"])
    return count / (time.perf_counter() - clock), count / (time.process_time() - processor)


def by_numpy(data):
    return rate(batch for _ in range(ROUNDS) for batch in data.batches(BATCH, None, ARRAYS, shuffle=0))


def by_torch(data):
    import torch

    loader = torch.utils.data.DataLoader(torch_samples(data, None, ARRAYS, shuffle=0, batch=BATCH), batch_size=None)

    def use(batch):
        return batch["image"][:, None].float() / 255, batch["needle"][:, None].float()

    return rate((batch for _ in range(ROUNDS) for batch in loader), use)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        if not sys.argv[1:]:
            make_dataset(Specification.parse(TEXT), folder)
        data = DataSet(sys.argv[1] if sys.argv[1:] else folder)
        found = {"NumPy": by_numpy(data)}
        if find_spec("torch"):
            found["PyTorch"] = by_torch(data)
        else:
            print("PyTorch is not installed: its loop is not measured")
        for name, (clock, processor) in found.items():
            print(f"{name:8s} {clock:8,.0f} samples a second by the clock,")
            print(f"         {processor:8,.0f} of a processor's time   at least {LEAST:,.0f}")
        sys.exit(min(processor for _, processor in found.values()) < LEAST)
