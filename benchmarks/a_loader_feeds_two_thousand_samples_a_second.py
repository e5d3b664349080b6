"""Samples a second that a loader gives a PyTorch loop from local shards: image and needle mask, 256 x 256, in batches.

Claims: over 2,000 a second; and, without PyTorch, as much through NumPy.

    python benchmarks/a_loader_feeds_two_thousand_samples_a_second.py [data set]

By default one is made here. Ends with 1 where it is missed; says so where PyTorch is not installed.
"""

import sys
import tempfile
import time
from importlib.util import find_spec

from sonospline.dataset import DataSet, Specification, make_dataset, torch_samples

ARRAYS = ("image", "needle")
LEAST, ROUNDS = 2000.0, 8
TEXT = 'samples = 512\n[[sources]]\nkind = "block"\n[anatomy]\nsamples = 256\n[view]\nsamples = 64\n'


def rate(samples):
    """Samples a second of an iterable of batches."""
    began, count = time.perf_counter(), 0
    for batch in samples:
        count += len(batch["index"]) if batch["index"].ndim else 1
    return count / (time.perf_counter() - began)


def by_numpy(data):
    return rate(sample for _ in range(ROUNDS) for sample in data.samples(None, ARRAYS, shuffle=0))


def by_torch(data):
    import torch

    loader = torch.utils.data.DataLoader(torch_samples(data, None, ARRAYS, shuffle=0), batch_size=64)
    return rate(batch for _ in range(ROUNDS) for batch in loader)


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
        for name, a_second in found.items():
            print(f"{name:8s} {a_second:8,.0f} samples a second   at least {LEAST:,.0f}")
        sys.exit(min(found.values()) < LEAST)
