"""A data set as PyTorch reads it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from .._extras import require
from .reader import DataSet


def torch_samples(
    data: DataSet, split: str | None = None, arrays: Sequence[str] | None = None, *, shuffle: int | None = None
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

    Raises
    ------
    MissingExtraError
        ``pip install 'sonospline[torch]'``.
    """
    torch = require("torch")

    class Samples(torch.utils.data.IterableDataset):  # type: ignore[misc, name-defined]
        """Samples one by one."""

        def __init__(self) -> None:
            self._passes = 0

        def __iter__(self) -> Iterator[dict[str, Any]]:
            worker = torch.utils.data.get_worker_info()
            part, parts = (0, 1) if worker is None else (worker.id, worker.num_workers)
            seed = None if shuffle is None else shuffle + self._passes
            self._passes += 1
            for sample in data.samples(split, arrays, shuffle=seed, part=part, parts=parts):
                yield {name: torch.from_numpy(array) for name, array in sample.items()}

        def __reduce__(self) -> Any:
            return _again, (data, split, arrays, shuffle, self._passes)

    return Samples()


def _again(data: DataSet, split: str | None, arrays: Sequence[str] | None, shuffle: int | None, passes: int) -> Any:
    """What another process makes of one that was pickled."""
    return torch_samples(data, split, arrays, shuffle=None if shuffle is None else shuffle + passes)
