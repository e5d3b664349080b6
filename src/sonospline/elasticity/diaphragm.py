"""How the diaphragm carries tissue along: the field of one millimetre of its excursion.

The diaphragm presses on the face towards the head, evenly; the skin and bone are held, all other faces are free to
move, for tissue goes on beyond them and slides on what is there. A face that is displaced as a whole, as a rigid wall,
folds tissue where it meets the skin, and faces that are clamped on all sides let nothing move as a whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown
from ..geometry.grid import FACES, face_slice
from ..geometry.tissue import Tissue
from ..mechanics.breathing import ORGAN_RATIO
from .solver import ElasticSolver

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_TOLERANCE = 1e-3
_STILL = 1e-3
"""Of the largest displacement: an organ that moves less is held."""


def carried_by_diaphragm(
    solver: ElasticSolver, cranial_face: str, organ: ArrayLike, *, ratio: float = ORGAN_RATIO
) -> Single:
    """Return the displacement of tissue for each mm of the diaphragm's excursion.

    It is scaled so that an organ moves, in the mean and away from the head, by a given part of the excursion.

    Parameters
    ----------
    solver : ElasticSolver
        Its tissue, material and nodes; the boundaries are those above.
    cranial_face : str
        The face towards the head, one of ``sonospline.FACES``; the skin, which the needle enters, is another.
    organ : (m, 3) array_like
        World points of the organ.
    ratio : float, default: 0.65
        Excursion of the organ over that of the diaphragm, above zero.

    Returns
    -------
    (3, nx, ny, nz) ndarray of float32
        On the nodes of ``solver.grid``, along its axes.

    Raises
    ------
    ValueError
        A face that is the entry face or unknown, an organ outside the tissue, or one that does not move with the face.
    NotConvergedError
        As :meth:`ElasticSolver.equilibrium`.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, carried_by_diaphragm
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(13), "y+"), nodes=13**3)
    >>> field = carried_by_diaphragm(solver, "z+", [(.5, .5, .5)])
    >>> round(float(field[2, 6, 6, 6]), 2), float(abs(field[:, :, -1]).max())  # towards z-; the skin y+ is held
    (-0.65, 0.0)
    """
    tissue = solver.tissue
    if _validate.choice("cranial_face", cranial_face, FACES) == tissue.entry_face:
        raise ValueError(f"cranial_face = {cranial_face!r} is the entry face, the skin; give the face towards the head")
    ratio = _validate.number("ratio", ratio, positive=True)
    points = _validate.points("organ", organ)
    if not len(points) or not tissue.grid.contains(points).all():
        raise ValueError(f"organ has {len(points)} points, not all in the tissue; give some, and inside its box")
    held = Tissue(tissue.grid, tissue.entry_face, (tissue.entry_face,))
    pressed = ElasticSolver(held, solver.material, nodes=solver.grid.node_count, integration=solver.integration)
    moved = pressed.equilibrium(_even_pressure(pressed, cranial_face), tolerance=_TOLERANCE)
    axis, away = _away_from(cranial_face)
    excursion = float((pressed.field(moved).displacement(points) @ solver.grid.direction[:, axis]).mean()) * away
    if excursion <= _STILL * np.abs(moved.displacement).max():
        raise ValueError(
            f"organ = {shown(points.tolist())} does not move with the face {cranial_face}; give points that do"
        )
    return np.asarray(moved.displacement * np.float32(ratio / excursion))


def _even_pressure(solver: ElasticSolver, face: str) -> Single:
    """Forces (3, nx, ny, nz) of unit pressure on a face, into the tissue: shares of area, halved along its edges."""
    axis, away = _away_from(face)
    forces = np.zeros((3, *solver.grid.shape), np.float32)
    forces[axis][face_slice(face)] = away
    for other in {0, 1, 2} - {axis}:
        lines = np.moveaxis(forces[axis], other, 0)
        lines[[0, -1]] /= 2
    return forces * solver.free


def _away_from(face: str) -> tuple[int, float]:
    """Axis of the grid square to a face, and the sign of the direction from it into the tissue."""
    axis, end = divmod(FACES.index(face), 2)
    return axis, -1.0 if end else 1.0
