"""What the solver's cells cost: one load on its grid and on one of twice the spacing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...elasticity.solver import ElasticSolver
from ...fields.grid_field import GridField

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_UNIFORM, _MIXED = 1 / 3, 1 / 2
"""Of the change from the coarser grid that the finer one still lacks: a third where errors fall by four with the cells'
sides halved, as in uniform tissue; more where cells hold several tissues."""
_TOLERANCE = 1e-2


class GridError(NamedTuple):
    """Error of a field because of the solver's cells, estimated."""

    mean: float
    """Mean length over that of the field."""
    at_tip: float
    """Largest at any needle's tip, over the field's largest length."""

    def __repr__(self) -> str:
        return f"GridError({self.mean:.2g}, {self.at_tip:.2g} at the tip)"


def grid_error(field: GridField, solver: ElasticSolver, forces: Single, tips: Array) -> GridError:
    """Return what a coarser grid, given the load of a field, says of the field's own error.

    Parameters
    ----------
    field : GridField
        The field.
    solver : ElasticSolver
        Of the coarser grid.
    forces : (3, nx, ny, nz) ndarray
        The load on its nodes.
    tips : (n, 3) ndarray
        Where the tissue at the tips of needles was while undeformed.

    Raises
    ------
    NotConvergedError
        The coarser grid's field was not found.
    """
    coarse = solver.field(solver.equilibrium(forces, tolerance=_TOLERANCE))
    lattice = field.grid if field.lattice is None else field.lattice
    fine = np.linalg.norm(field.values, axis=-1)
    changed = np.linalg.norm(coarse.displacement(lattice.points) - field.values.reshape(-1, 3), axis=1)
    at_tips = np.linalg.norm(coarse.displacement(tips) - field.displacement(tips), axis=1).max()
    shear = solver.moduli.shear
    share = _UNIFORM if shear.min() == shear.max() else _MIXED
    return GridError(share * float(changed.mean() / fine.mean()), share * float(at_tips / fine.max()))
