"""A data set as PyTorch reads it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from .._extras import require
from .reader import DataSet


def torch_samples(
    data: DataSet,
    split: str | None = None,
    arrays: Sequence[str] | None = None,
    *,
    shuffle: int | None = None,
    batch: int | None = None,
) -> Any:
    """Return the samples of a split as a ``torch.utils.data.IterableDataset``: tensors by name.

    Workers of a ``DataLoader`` have shards of their own. With ``shuffle`` every pass over it has another order, a
    function of that seed and the number of the pass.

    Parameters
    ----------
    data : DataSet
        With arrays.
    split : {"train", "validation", "test"}, optional
        Which; by default all.
    arrays : sequence of str, optional
        Names; by default all.
    shuffle : int, optional
        Seed of the order.
    batch : int, optional
        Samples that are given together, of one shard each: ``DataLoader(..., batch_size=None)`` passes them on as
        they are, a tenth faster than to stack them. By default one by one.

    Raises
    ------
    MissingExtraError
        ``pip install 'sonospline[torch]'``.
    """
    torch = require("torch")

    class Samples(torch.utils.data.IterableDataset):  # type: ignore[misc, name-defined]
        """Samples one by one, or batches of them."""

        def __init__(self) -> None:
            self._passes = 0

        def __iter__(self) -> Iterator[dict[str, Any]]:
            worker = torch.utils.data.get_worker_info()
            part, parts = (0, 1) if worker is None else (worker.id, worker.num_workers)
            seed = None if shuffle is None else shuffle + self._passes
            self._passes += 1
            asked: dict[str, Any] = {"shuffle": seed, "part": part, "parts": parts}
            found = data.samples if batch is None else partial(data.batches, batch)
            for sample in found(split, arrays, **asked):
                yield {name: torch.from_numpy(array) for name, array in sample.items()}

        def __reduce__(self) -> Any:
            return _again, (data, split, arrays, shuffle, batch, self._passes)

    return Samples()


def _again(
    data: DataSet,
    split: str | None,
    arrays: Sequence[str] | None,
    shuffle: int | None,
    batch: int | None,
    passes: int,
) -> Any:
    """What another process makes of one that was pickled."""
    seed = None if shuffle is None else shuffle + passes
    return torch_samples(data, split, arrays, shuffle=seed, batch=batch)
