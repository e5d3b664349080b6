"""Tuning the model to finite elements: NSGA-II on equation (24)."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._extras import require
from ..mechanics.interaction import NeedleTissueModel
from ..models.spline.faces import Progress
from .objective import TUNABLES, Objective, model_of
from .parallel import rows_in_parallel

Array = NDArray[np.float64]

POPULATION, GENERATIONS = 32, 50
"""Of a search, where nothing else is said: other seeds then come within a few per cent."""


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """The designs that no other one betters in every objective.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.study.tuning import ParetoFront
    >>> front = ParetoFront.of(np.zeros((3, 7)), [[1, 4, 1], [2, 2, 1], [2, 4, 1]])
    >>> front.objectives.tolist(), front.chosen
    ([[1.0, 4.0, 1.0], [2.0, 2.0, 1.0]], 1)
    """

    designs: Array
    """(m, 7) in cube sides, in the order of ``TUNABLES``."""
    objectives: Array
    """(m, k) their errors, one column an insertion."""

    @classmethod
    def of(cls, designs: ArrayLike, objectives: ArrayLike) -> ParetoFront:
        """Return the front of a set of designs (n, 7), of which equal ones count once, best mean error last."""
        designs, objectives = np.asarray(designs, float), np.asarray(objectives, float)
        _, first = np.unique(np.column_stack([objectives, designs]), axis=0, return_index=True)
        designs, objectives = designs[np.sort(first)], objectives[np.sort(first)]
        better = (objectives[:, None] <= objectives).all(axis=2) & (objectives[:, None] < objectives).any(axis=2)
        on_front = ~better.any(axis=0)
        return cls(designs[on_front], objectives[on_front])

    @property
    def chosen(self) -> int:
        """Number of the design with the smallest mean error: the paper's "solution with minimal error"."""
        return int(self.objectives.mean(axis=1).argmin())

    def model(self, side: float = 1.0) -> NeedleTissueModel:
        """Return the model of the chosen design for a cube of the given side."""
        return model_of(self.designs[self.chosen], side)


def search(
    objective: Callable[[Array], Array] | Objective,
    *,
    population: int = POPULATION,
    generations: int = GENERATIONS,
    seed: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ParetoFront:
    """Return the Pareto front that NSGA-II finds (Sec. IV; Deb et al. 2002), over all its evaluations.

    Parameters
    ----------
    objective : Objective
        What to minimise; any callable of a design (7,) that can be pickled.
    population, generations : int, default: 32, 50
        Designs a generation, and generations, the first one included. With far fewer the
        result depends on the seed.
    seed : int, default: 0
        The same seed gives the same front, for any number of workers.
    workers : int, default: 1
        As for :func:`rows_in_parallel`.
    executor : Executor, optional
        As for :func:`rows_in_parallel`.
    progress : callable, optional
        Called as ``progress(done, of)`` after each generation.

    Raises
    ------
    ValueError
        A size or a seed out of range.
    MissingExtraError
        pymoo is not installed.
    """
    population = _validate.count("population", population, least=2)
    generations = _validate.count("generations", generations)
    seed = _validate.count("seed", seed, least=0)
    workers = _validate.count("workers", workers)
    algorithm = _nsga2(population, generations, seed)
    designs, objectives = [], []
    with rows_in_parallel(objective, workers=workers, executor=executor) as evaluate:
        for done in range(1, generations + 1):
            candidates = algorithm.ask()
            rows = candidates.get("X")
            errors = evaluate(rows)
            candidates.set("F", errors)
            for candidate in candidates:
                candidate.evaluated.add("F")
            algorithm.tell(infills=candidates)
            designs.append(rows)
            objectives.append(errors)
            if progress:
                progress(done, generations)
    return ParetoFront.of(np.concatenate(designs), np.concatenate(objectives))


def _nsga2(population: int, generations: int, seed: int) -> Any:
    """An algorithm of pymoo, ready to be asked."""
    nsga2 = require("pymoo.algorithms.moo.nsga2")
    problem = require("pymoo.core.problem").Problem(
        n_var=len(TUNABLES),
        n_obj=3,
        xl=np.array([tunable.low for tunable in TUNABLES]),
        xu=np.array([tunable.high for tunable in TUNABLES]),
    )
    algorithm = nsga2.NSGA2(pop_size=population)
    algorithm.setup(problem, termination=("n_gen", generations), seed=seed, verbose=False)
    return algorithm
