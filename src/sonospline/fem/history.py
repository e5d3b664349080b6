"""A whole insertion solved by finite elements, step by step, and kept on disk."""

from __future__ import annotations

from functools import partial
from typing import IO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _cache, _validate
from .._digest import digest
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.line_force import LineForce
from ..mechanics.loads import Load
from ..mechanics.material import Material
from ..mechanics.moduli import Moduli
from ..models.spline.faces import Progress
from .model import FiniteElementModel

Array = NDArray[np.float64]

_VERSION = 1
"""Of the kept files: to be raised when the same arguments give another history."""
_WHAT = "the finite element reference"


def reference_history(
    tissue: Tissue,
    entry: ArrayLike,
    target: ArrayLike,
    steps: int = 20,
    load: Load | None = None,
    material: Material | Moduli | None = None,
    *,
    element: str = "hexahedron",
    integration: str = "full",
    engine: str = "scikit-fem",
    progress: Progress | None = None,
) -> Array:
    """Return the displacement after each step of an insertion, by finite elements (Sec. IV).

    The needle goes from entry to target in equal steps, quasi-statically: each step is the
    equilibrium under the load of its own depth, whatever came before. The result is kept
    on disk, under the folder that ``SONOSPLINE_CACHE`` names, by everything it depends on.

    Parameters
    ----------
    tissue : Tissue
        Grid and pinned faces.
    entry, target : (3,) array_like
        Where the needle enters and where its tip arrives, in world coordinates.
    steps : int, default: 20
        Steps of equal length; step k reaches k / steps of the way.
    load : LineForce or ShaftDisplacement, default: LineForce()
        What the needle does.
    material : Material or Moduli, default: Material()
        What the tissue is made of.
    element, integration, engine : str
        As for :class:`FiniteElementModel`.
    progress : callable, optional
        Called as ``progress(done, of)``; a history read from disk is done at once.

    Returns
    -------
    (steps, nx, ny, nz, 3) array
        Displacement of the nodes, in the unit of the grid.

    Raises
    ------
    ValueError
        As for :class:`FiniteElementModel`.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.fem import reference_history
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(9))
    >>> u = reference_history(tissue, entry=(0, .5, .5), target=(.6, .5, .5), steps=2)
    >>> u.shape, bool(abs(u[1]).mean() > abs(u[0]).mean())
    ((2, 9, 9, 9, 3), True)
    """
    model = FiniteElementModel(tissue, material, element=element, integration=integration, engine=engine)
    return history_of(model, entry, target, steps, load, progress=progress)


def history_of(
    model: FiniteElementModel,
    entry: ArrayLike,
    target: ArrayLike,
    steps: int = 20,
    load: Load | None = None,
    *,
    progress: Progress | None = None,
) -> Array:
    """Return what :func:`reference_history` does, by a model that many insertions can share.

    What the model makes once (matrices, hierarchy, factor) is made only where a history is
    not on disk yet. The solver is no part of what a kept history depends on.
    """
    steps = _validate.count("steps", steps)
    load = LineForce() if load is None else load
    needle = Needle(entry, target)
    model.tissue.check_inside(entry=needle.entry, target=needle.tip)
    file = _cache.place(f"fem-{_signature(model, needle, steps, load)}.npz")
    shape = (steps, *model.tissue.grid.shape, 3)
    history = _cache.recall(file, partial(_read, shape=shape), _WHAT)
    if history is None:
        history = np.empty(shape)
        for step in range(steps):
            if progress:
                progress(step, steps)
            history[step] = model.solve(load, Needle(needle.entry, needle.at((step + 1) / steps)))
        _cache.keep(file, partial(_write, history=history), _WHAT)
    if progress:
        progress(steps, steps)
    return history


def _signature(model: FiniteElementModel, needle: Needle, steps: int, load: Load) -> str:
    grid, faces = model.tissue.grid, (model.tissue.entry_face, model.tissue.pinned_faces)
    lattice = (grid.shape, grid.spacing, grid.origin.tolist(), grid.direction.tolist(), *faces)
    physics = (needle.entry.tolist(), needle.tip.tolist(), steps, digest(load, model.material))
    return _cache.digest(*lattice, *physics, model.element, model.integration, model.engine)


def _read(stream: IO[bytes], shape: tuple[int, ...]) -> Array:
    with np.load(stream) as kept:
        if int(kept["version"]) != _VERSION:
            raise ValueError(f"it is of version {int(kept['version'])}, not {_VERSION}")
        history = kept["history"]
    if history.shape != shape or history.dtype != np.float64:
        raise ValueError(f"it holds {history.dtype} {history.shape}, not float64 {shape}")
    return history


def _write(stream: IO[bytes], history: Array) -> None:
    np.savez(stream, version=_VERSION, history=history)
