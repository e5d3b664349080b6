"""A field known at the nodes of a grid."""

from __future__ import annotations

from dataclasses import dataclass

from .field import Field
from .sampled_maps import SampledMaps


@dataclass(frozen=True, eq=False, repr=False)
class GridField(SampledMaps, Field):
    """A field of values at nodes, linear or cubic between them.

    A point costs the same whatever made the field. Against a kernel sum it errs by the
    curvature between nodes, and most next to a landmark, where U = r has its kink and cubics
    overshoot; a smooth field, as finite elements make it, gains from cubics:
    :meth:`interpolation_error` measures it.

    Parameters
    ----------
    grid : Grid
        The lattice of :meth:`on_grid`.
    values : (nx, ny, nz, 3) ndarray
        Displacement at the nodes, in world coordinates.
    lattice : Grid, optional
        The nodes of the values, where they are not those of ``grid``. Beyond its box the
        field keeps the value of the nearest point of it.
    order : {1, 3}, default: 1
        Linear between nodes, or the cubic not-a-knot spline.
    error_estimate : float, optional
        Error of the values relative to themselves, where their maker knows it.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle((0, .5, .5), (.5, .5, .5)))
    >>> sampled = ss.GridField.of(field)
    >>> p = np.random.default_rng(0).random((1000, 3))
    >>> bool(abs(sampled.displacement(p) - field.displacement(p)).max() < 1e-3)
    True
    """


def at_nodes(field: Field) -> GridField:
    """Return a field as values at the nodes of its own grid: itself where it is that, else sampled."""
    known = isinstance(field, GridField) and field.lattice is field.grid
    return field if known else GridField.of(field)  # type: ignore[return-value]
