"""Parameters by site, direction and depth: made from elastic fields, and set beside one constant set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from ..elasticity.solver import ElasticSolver
from ..geometry.grid import FACES, Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.amortised import TUNED, AmortisedParameters, features, multiplied, second_order
from ..mechanics.interaction import NeedleTissueModel
from ..mechanics.line_force import LineForce
from ..mechanics.material import Material
from ..models.spline.insertion import Insertion
from .insertions import PlannedInsertion
from .metrics import Errors, displacement_errors, mean_errors
from .model_fields import REFERENCE_ERROR

Array = NDArray[np.float64]
Row = dict[str, Any]
Parameters = Callable[[Tissue, Needle], NeedleTissueModel]

HELD_OUT_SEED = 1_000_000
"""Of the insertions that errors are measured on; those that are learnt from have others."""
STEEPEST_DEG = 45.0
"""Between a needle and the entry face's normal, at most."""
_NUDGE = 0.1
"""Of a parameter's logarithm, for derivatives: less would move no node into the tip's cylinder."""
_SMALL = 0.05
"""Of a node's error over the mean displacement: below it errors count by their squares."""
_STEPS = (1.0, 0.5, 0.25)
_SPREAD = 0.35
"""Of the logarithms of a search's first designs."""
_BESIDE = ((0.0,) * 7, (0.0, -0.5, 0.2, 0.8, 0.2, 0.5, 1.2), (0.3, -1.0, -0.2, 0.5, -0.3, -0.3, 0.8))
"""Where searches begin: logarithms of what the seven are multiplied by."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """An insertion into a unit cube from one of its faces, and where finite elements say the tissue goes."""

    plan: PlannedInsertion
    tissue: Tissue

    @property
    def needle(self) -> Needle:
        """At its target."""
        return self.plan.on(self.tissue)

    @cached_property
    def expected(self) -> NDArray[np.float32]:
        """(nx, ny, nz, 3) displacement, converged, on the cube's own nodes."""
        side = self.tissue.grid.shape[0]
        state = _solver(side, self.tissue.entry_face).solve(LineForce(), self.needle, tolerance=REFERENCE_ERROR)
        return np.ascontiguousarray(np.moveaxis(state.displacement, 0, -1))

    def field(self, model: NeedleTissueModel) -> Array:
        """(nx, ny, nz, 3) displacement by the paper's spline."""
        return np.asarray(Insertion(self.tissue, model).advance(self.needle).on_grid("accurate"), float)

    def errors(self, model: NeedleTissueModel) -> Errors:
        """Return those of the spline with a model."""
        return displacement_errors(self.field(model), self.expected, grid=self.tissue.grid, tip=self.needle.tip)


def drawn_insertions(count: int, *, seed: int, side: int = 25) -> tuple[Drawn, ...]:
    """Return insertions into unit cubes: all faces in turn; site, direction and depth drawn evenly.

    Insertion k of a seed is the same whatever the count.
    """
    tissues = {face: Tissue(Grid.unit_cube(side), entry_face=face) for face in FACES}
    found: list[Drawn] = []
    rng = np.random.default_rng(seed)
    while len(found) < count:
        beside, tip = rng.uniform(0.2, 0.8, 2), np.array([rng.uniform(0.2, 0.75), *rng.uniform(0.25, 0.75, 2)])
        plan = PlannedInsertion(f"{seed}/{len(found)}", (0.0, *beside.tolist()), tuple(tip.tolist()))
        if plan.angle <= STEEPEST_DEG:
            found.append(Drawn(plan, tissues[FACES[len(found) % len(FACES)]]))
    return tuple(found)


def learn(
    samples: Sequence[Drawn],
    *,
    constant: NeedleTissueModel | None = None,
    ridge: float = 1e-3,
    rounds: int = 6,
    workers: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> AmortisedParameters:
    """Return parameters by site, direction and depth that bring the spline nearest to the samples' fields.

    Gauss-Newton on the weights themselves: the parameters that fit a sample best are not well determined, so that none
    are fitted one by one. Each sample's field is linearised in the logarithms of its own parameters by differences; the
    errors of its nodes, over its mean displacement, count by their sizes (by iterated weights), as in the MAE.

    Parameters
    ----------
    samples : sequence of Drawn
        To learn from.
    constant : NeedleTissueModel, optional
        Where to begin; by default the tuned one.
    ridge : float, default: 1e-3
        Of the squares of all weights but the constants', beside a sample's mean.
    rounds : int, default: 6
        At most.
    workers : int, default: 1
        Threads.
    say : callable, optional
        Is given a line a round.
    """
    constant = NeedleTissueModel.tuned() if constant is None else constant
    places = np.stack([features(sample.tissue, sample.needle) for sample in samples])
    mean, scale = places.mean(axis=0), places.std(axis=0)
    terms = np.stack([second_order(place) for place in (places - mean) / scale])
    weights = np.zeros((len(TUNED), terms.shape[1]))
    penalty = ridge * np.kron(np.eye(len(TUNED)), np.diag([0.0] + [1.0] * (terms.shape[1] - 1)))
    with ThreadPoolExecutor(workers) as pool:

        def error(weights: Array) -> float:
            models = [multiplied(constant, row) for row in terms @ weights.T]
            return float(np.mean(list(pool.map(lambda sample, model: sample.errors(model).relative, samples, models))))

        best = error(weights)
        for number in range(rounds):
            pairs = list(pool.map(partial(_normal_equations, constant), samples, terms @ weights.T))
            matrix, right = penalty.copy(), -penalty @ weights.ravel()
            for (square, gradient), row in zip(pairs, terms, strict=True):
                matrix += np.kron(square, np.outer(row, row)) / len(samples)
                right -= np.kron(gradient, row) / len(samples)
            change = np.linalg.solve(matrix + 1e-9 * np.eye(len(matrix)), right).reshape(weights.shape)
            tried = [(error(weights + step * change), step) for step in _STEPS]
            found, step = min(tried)
            say(f"round {number + 1}: {best:.4f} -> {found:.4f} (step {step:g})")
            if found > best * (1 - 1e-3):
                break
            best, weights = found, weights + step * change
    return AmortisedParameters(constant, mean, scale, weights)


def compare(samples: Sequence[Drawn], sets: dict[str, Parameters], *, workers: int = 1) -> dict[str, Errors]:
    """Return the mean errors of the spline with each set of parameters."""

    def errors(sample: Drawn) -> list[Errors]:
        return [sample.errors(parameters(sample.tissue, sample.needle)) for parameters in sets.values()]

    with ThreadPoolExecutor(workers) as pool:
        rows = list(pool.map(errors, samples))
    return {name: mean_errors([row[k] for row in rows]) for k, name in enumerate(sets)}


def fitted_alone(sample: Drawn, start: NeedleTissueModel, *, evaluations: int) -> NeedleTissueModel:
    """Return parameters fitted to one insertion itself, by Nelder and Mead's simplex: nobody has them beforehand.

    Of several searches, from the start and from parameters beside it, the best; never worse than the start.
    """

    def error(logarithms: Array) -> float:
        return sample.errors(multiplied(start, logarithms)).relative

    found = [(error(np.zeros(len(TUNED))), 0, np.zeros(len(TUNED)))]
    for number, first in enumerate(_BESIDE, 1):
        simplex = np.array(first) + np.vstack([np.zeros(len(TUNED)), _SPREAD * np.eye(len(TUNED))])
        options = {"maxfev": evaluations // len(_BESIDE), "initial_simplex": simplex}
        result = minimize(error, simplex[0], method="Nelder-Mead", options=options)
        found.append((float(result.fun), number, result.x))
    return multiplied(start, min(found)[2])


def compare_sets(tuned: NeedleTissueModel, *, side: int, count: int, alone: int, evaluations: int, workers: int) -> Row:
    """Return the errors of each set of parameters on insertions that none has seen, and what the best ones would do.

    Parameters
    ----------
    tuned : NeedleTissueModel
        The constant set, in cube sides.
    side : int
        Nodes a side.
    count : int
        Insertions, over all faces.
    alone : int
        How many of them parameters are fitted to, each by itself.
    evaluations : int
        Of each such fit, at most.
    workers : int
        Threads.
    """
    samples = drawn_insertions(count, seed=HELD_OUT_SEED, side=side)
    sets: dict[str, Parameters] = {
        "Table I": lambda tissue, needle: NeedleTissueModel.paper(),
        "tuned": lambda tissue, needle: tuned,
        "amortised": AmortisedParameters.shipped().model,
    }
    few = samples[:alone]
    with ThreadPoolExecutor(workers) as pool:
        models = list(pool.map(lambda sample: fitted_alone(sample, tuned, evaluations=evaluations), few))
    best = mean_errors([sample.errors(model) for sample, model in zip(few, models, strict=True)])
    return {
        "count": count, "alone": alone, "side": side, "evaluations": evaluations,
        "all": {name: asdict(errors) for name, errors in compare(samples, sets, workers=workers).items()},
        "few": {name: asdict(errors) for name, errors in compare(few, sets, workers=workers).items()}
        | {"fitted alone": asdict(best)},
    }  # fmt: skip


def _normal_equations(constant: NeedleTissueModel, sample: Drawn, logarithms: Array) -> tuple[Array, Array]:
    """J'QJ (7, 7) and J'Qr (7,) of a sample's nodes that move, r its errors over its mean displacement."""
    expected = np.asarray(sample.expected, float)
    size = np.linalg.norm(expected, axis=-1)
    moves = size > 0
    mean = size[moves].mean()

    def field(logarithms: Array) -> Array:
        found: Array = sample.field(multiplied(constant, logarithms))[moves] / mean
        return found

    off = field(logarithms) - expected[moves] / mean
    weight = 1 / np.maximum(np.linalg.norm(off, axis=1), _SMALL) / moves.sum()
    nudges = _NUDGE * np.eye(len(TUNED))
    slopes = np.stack([(field(logarithms + nudge) - field(logarithms - nudge)) / (2 * _NUDGE) for nudge in nudges])
    weighted = slopes * weight[:, None]
    return np.einsum("ank,bnk->ab", weighted, slopes), np.einsum("ank,nk->a", weighted, off)


@lru_cache(maxsize=len(FACES))
def _solver(side: int, face: str) -> ElasticSolver:
    return ElasticSolver(Tissue(Grid.unit_cube(side), entry_face=face), Material(), nodes=side**3)
