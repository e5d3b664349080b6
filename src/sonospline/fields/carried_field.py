"""What a needle does to tissue that moves anyway: two displacements, one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown
from ..geometry.grid import Grid
from .field import Field
from .maps import InverseReport, Method

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class CarriedField(Field):
    """The displacement of a needle, carried along by a background that moves: x -> (x + u_b) o (x + u_n).

    Tissue at x goes to y = x + u_n(x), which is where the needle brings it while nothing breathes or presses, and from
    there to y + u_b(y). The needle's displacement is that of the undeformed body, to which its pose has been taken
    back by :meth:`at_rest`. The sum of both would leave tissue beside its place by u_n times the gradient of u_b.

    Parameters
    ----------
    inner : Field
        The needle's displacement u_n of undeformed tissue.
    background : Field
        The displacement u_b that carries all of it along.

    Raises
    ------
    ValueError
        One of them is no Field.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> grid = ss.Grid.unit_cube(13)
    >>> needle = ss.Insertion(ss.Tissue(grid)).advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
    >>> breath = ss.GridField(grid, np.full((13, 13, 13, 3), (0, 0, .1)))
    >>> field = ss.CarriedField(needle, breath)
    >>> p = np.array((.4, .45, .5))
    >>> bool(np.allclose(field.displacement(p), needle.displacement(p) + (0, 0, .1)))
    True
    >>> bool(np.allclose(field.inverse(field.forward(p)), p, atol=1e-6))
    True
    """

    inner: Field
    background: Field

    def __post_init__(self) -> None:
        for name in ("inner", "background"):
            if not isinstance(getattr(self, name), Field):
                raise ValueError(f"{name} = {shown(getattr(self, name))} is not a Field; give one, e.g. a GridField")

    @property
    def grid(self) -> Grid | None:  # type: ignore[override]
        """The lattice of :meth:`on_grid`: that of the needle's field."""
        return self.inner.grid

    def displacement(self, points: ArrayLike) -> Array:
        """Return u (m, 3) at world points (m, 3) of undeformed tissue; (3,) at one point."""
        x, shape = _validate.rows("points", points)
        moved = self.inner.displacement(x)
        return (moved + self.background.displacement(x + moved)).reshape(*shape, 3)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the Jacobian (m, 3, 3) of the forward map, the product of both; (3, 3) at one point."""
        x, shape = _validate.rows("points", points)
        total: Array = self.background.jacobian(self.inner.forward(x)) @ self.inner.jacobian(x)
        return total.reshape(*shape, 3, 3)

    def on_grid(self, method: Method = "auto") -> NDArray[np.floating]:
        """Return u at every node of the grid, as (nx, ny, nz, 3)."""
        grid, moved = self.require_grid(), self.inner.on_grid(method)
        carried = self.background.displacement(grid.points + moved.reshape(-1, 3))
        return moved + carried.reshape(moved.shape).astype(moved.dtype)

    def at_rest(self, points: ArrayLike) -> Array:
        """Return where world points (m, 3), as of a needle's axis, are while nothing breathes or presses."""
        return self.background.inverse(points)

    @property
    def inverse_tolerance(self) -> float:  # type: ignore[override]
        """That of the coarser of the two, in units of :attr:`length`."""
        parts = self.inner, self.background
        return max(field.inverse_tolerance * field.length for field in parts) / self.length

    @cached_property
    def error_estimate(self) -> float | None:  # type: ignore[override]
        """Error of both, relative to the whole, in the mean over the grid; None where neither knows its own."""
        if self.inner.error_estimate is None and self.background.error_estimate is None:
            return None
        whole = _size(self)
        errors = [_size(field, self.grid) * (field.error_estimate or 0.0) for field in (self.inner, self.background)]
        return sum(errors) / whole if whole > 0 else 0.0

    @property
    def length(self) -> float:
        """That of the needle's field."""
        return self.inner.length

    def _find_inverse(self, target: Array, tolerance: float, max_iterations: int) -> tuple[Array, InverseReport]:
        """Back through the background, then through the needle's field: each contracts where the whole may not."""
        between, first = self.background._find_inverse(target, tolerance / 4, max_iterations)
        known = first.converged
        x = np.full_like(target, np.nan)
        x[known], second = self.inner._find_inverse(between[known], tolerance / 4, max_iterations)
        missing = np.linalg.norm(self.forward(x[known]) - target[known], axis=1) if known.any() else np.zeros(0)
        good = known.copy()
        good[known] = second.converged & (missing <= tolerance)
        x[~good] = np.nan
        residual = float(missing[good[known]].max(initial=0.0))
        return x, InverseReport(good, first.iterations + second.iterations, residual)

    def _facts(self) -> list[str]:
        return [*super()._facts(), f"{type(self.inner).__name__} on {type(self.background).__name__}"]


def _size(field: Field, grid: Grid | None = None) -> float:
    """Mean length of a displacement over a grid's nodes, its own where it has the same."""
    own = grid is None or field.grid == grid
    values = field.on_grid() if own or grid is None else field.displacement(grid.points)
    return float(np.linalg.norm(values, axis=-1).mean())
