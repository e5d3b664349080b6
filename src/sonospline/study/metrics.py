"""How far one displacement is from another: equations (22) and (23), and what they mean nothing without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from ..geometry.grid import Grid

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of a displacement against a reference, in the unit of the grid.

    Over the N_a nodes whose reference displacement exceeds a threshold. A linear model's
    mean absolute error scales with the load, so alone it says nothing: read it beside
    ``relative``, the error of doing nothing, and the error at the tip.
    """

    mae: float
    """Mean of the nodal errors, eq. (23)."""
    rmse: float
    """Root of the mean of their squares, eq. (23)."""
    relative: float
    """``mae`` over the mean reference displacement: 1 is as good as doing nothing."""
    largest: float
    """Largest nodal error."""
    at_tip: float | None
    """Error at the node nearest to the needle's tip, where that was given."""
    zero_mae: float
    """``mae`` of no displacement at all: the mean reference displacement."""
    zero_rmse: float
    """``rmse`` of no displacement at all."""
    nodes: int
    """N_a, the nodes compared."""
    threshold: float
    """Reference displacement above which a node counts."""


def displacement_errors(
    displacement: ArrayLike,
    reference: ArrayLike,
    *,
    threshold: float = 0.0,
    grid: Grid | None = None,
    tip: ArrayLike | None = None,
) -> Errors:
    r"""Return the errors of a displacement against a reference, equations (22) and (23).

    .. math:: \epsilon_i = \|u_i - u_i^{FEM}\|, \quad
              MAE = \frac{1}{N_a} \sum_i \epsilon_i, \quad
              RMSE = \sqrt{\frac{1}{N_a} \sum_i \epsilon_i^2}

    Parameters
    ----------
    displacement, reference : (..., 3) array_like
        The displacement of each node, ours and the reference's, in the unit of the grid.
    threshold : float, default: 0.0
        Nodes whose reference displacement exceeds it are the N_a that count.
    grid : Grid, optional
        The lattice of the nodes, needed for ``tip``.
    tip : (3,) array_like, optional
        Where the needle's tip is in the undeformed tissue.

    Raises
    ------
    ValueError
        Arrays of different shapes or not of vectors, NaN or infinity, a reference that
        moves nothing, or a tip without its grid.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.study.metrics import displacement_errors
    >>> reference = np.array([[0., 0, 0], [3, 0, 0], [0, 5, 0]])   # the first node does not move
    >>> errors = displacement_errors(np.zeros((3, 3)), reference)
    >>> errors.nodes, errors.mae, errors.relative
    (2, 4.0, 1.0)
    """
    ours, theirs = _vectors("displacement", displacement), _vectors("reference", reference)
    if ours.shape != theirs.shape:
        raise ValueError(f"displacement has shape {ours.shape} and reference {theirs.shape}; give one row a node each")
    threshold = _validate.number("threshold", threshold)
    size = np.linalg.norm(theirs, axis=-1)
    moves = size > threshold
    if not moves.any():
        raise ValueError(
            f"reference moves no node by more than threshold = {threshold:g}; lower it or check the reference"
        )
    error = np.linalg.norm(ours - theirs, axis=-1)
    counted, moved = error[moves], size[moves]
    return Errors(
        mae=float(counted.mean()),
        rmse=_root_mean_square(counted),
        relative=float(counted.mean() / moved.mean()),
        largest=float(counted.max()),
        at_tip=None if tip is None else float(error[_nearest(grid, tip, error.shape)]),
        zero_mae=float(moved.mean()),
        zero_rmse=_root_mean_square(moved),
        nodes=int(moves.sum()),
        threshold=threshold,
    )


def mean_errors(errors: Sequence[Errors]) -> Errors:
    """Return the mean of each error over several insertions; of ``nodes`` the sum.

    ``relative`` is the mean of the ratios, in which each insertion counts the same;
    ``largest`` and ``threshold`` are the largest.
    """
    if not errors:
        raise ValueError("errors is empty; give those of at least one insertion")
    columns: dict[str, Any] = {known.name: [getattr(one, known.name) for one in errors] for known in fields(Errors)}
    summed: dict[str, Callable[[Any], Any]] = {"nodes": sum, "largest": max, "threshold": max}
    means: dict[str, Any] = {
        name: None if None in values else summed.get(name, _mean)(values)  # a tip is not always given
        for name, values in columns.items()
    }
    return Errors(**means)


def _vectors(name: str, value: ArrayLike) -> Array:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise ValueError(f"{name} has shape {array.shape}; give an (..., 3) array of displacements")
    _validate.points(name, array.reshape(-1, 3))
    return array


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _nearest(grid: Grid | None, tip: ArrayLike, shape: tuple[int, ...]) -> tuple[int, ...]:
    if grid is None or grid.shape != shape:
        raise ValueError(f"tip is given for displacements of shape {shape}; give their grid= as well")
    place = grid.local(_validate.vector("tip", tip)[None])[0] / grid.spacing
    return tuple(np.clip(np.rint(place), 0, np.array(shape) - 1).astype(int).tolist())
