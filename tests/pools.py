"""A stand-in for pools of processes, each of which imports everything anew."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from sonospline.study.parallel import rows_in_parallel


@contextmanager
def rows_in_threads(function, *, workers, executor=None):
    """``rows_in_parallel`` whose workers are threads of this process."""
    with (
        ThreadPoolExecutor(workers) as threads,
        rows_in_parallel(function, workers=workers, executor=executor or threads) as of_rows,
    ):
        yield of_rows
