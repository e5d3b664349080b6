"""Elastic or relaxing tissue step by step, by direct solution: the reference that live solvers are measured against."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .._shown import shown
from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.moduli import Moduli
from ..mechanics.tissue_map import TissueMap
from .cell_stiffness import cell_corners, cell_stiffness
from .sparse_solvers import Factor

Array = NDArray[np.float64]

_KEPT = 2
"""Lengths of a step whose factors are kept."""


@dataclass(frozen=True, eq=False, repr=False)
class StepwiseTissueState(ByBits):
    """Tissue at an instant, with all of its past that counts."""

    displacement: Array
    """(nx, ny, nz, 3) of the nodes, in the world."""
    stress: Array
    """(branches, cells, 24) what each cell's relaxing branches pull its corners with, along the grid's axes."""

    def __post_init__(self) -> None:
        self.displacement.setflags(write=False)
        self.stress.setflags(write=False)

    def __repr__(self) -> str:
        largest = np.linalg.norm(self.displacement, axis=-1).max()
        return f"StepwiseTissueState({len(self.stress)} branches, largest displacement {largest:.4g})"


class StepwiseTissue:
    """Tissue whose cells each relax in their own way, under forces in time.

    A generalised Maxwell solid in every cell e: beside a spring, branches b of a spring and a dashpot. All
    of them have the stiffness K_e of the cell times a fraction, 1 at once and 1 - sum g_b at last:

        G_e(t) = 1 - sum_b g_b(e) + sum_b g_b(e) exp(-t / tau_b)

    Of a branch the force on the cell's corners is kept (its stress, integrated):

        dh_b/dt + h_b / tau_b = g_b K_e du_e/dt

    which is integrated exactly where the displacement is linear within a step (Simo and Hughes,
    *Computational Inelasticity*, 1998, section 10.3): with x = dt / tau_b, al = exp(-x), be = (1 - al) / x,

        h_b' = al_b h_b + be_b g_b K_e (u_e' - u_e)

    so that equilibrium at the end of a step, (1 - sum g_b) K u' + sum h_b' = F' over all cells, is

        [ sum_e (1 - sum_b (1 - be_b) g_b) K_e ] u' = F' + sum_e sum_b (be_b g_b K_e u_e - al_b h_b)

    with a matrix for each length of a step, which is factored directly. A step of no time is elastic. Small
    strain; trilinear hexahedra with their mean dilatation.

    Parameters
    ----------
    tissue : Tissue
        With the nodes of the solution; pinned faces do not move.
    material : Material, TissueMap or Moduli, default: Material()
        What it is made of at once, at no time to relax.
    times : (branches,) array_like, default: ()
        tau_b in seconds, above zero.
    fractions : (branches,) or (branches, cx, cy, cz) array_like, default: ()
        g_b, of all tissue or of each cell; at or above zero, less than 1 in all.
    held : (nx, ny, nz, 3) array of bool, optional
        Components, along the grid's axes, that do not move, instead of the pinned faces.

    Raises
    ------
    ValueError
        Times or fractions out of range, or material with floating fragments.
    MissingExtraError
        scikit-fem is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.fem import StepwiseTissue
    >>> body = StepwiseTissue(ss.Tissue(ss.Grid.unit_cube(5)), times=[2.0], fractions=[0.5])
    >>> forces = np.zeros((5, 5, 5, 3))
    >>> forces[2, 2, 2, 0] = 0.01
    >>> at_once = body.step(body.rest, forces, 0.0)
    >>> later = body.step(at_once, forces, 1000.0)  # a held load creeps to twice the displacement
    >>> round(float(later.displacement[2, 2, 2, 0] / at_once.displacement[2, 2, 2, 0]), 2)
    2.0
    """

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap | Moduli | None = None,
        *,
        times: ArrayLike = (),
        fractions: ArrayLike = (),
        held: NDArray[np.bool_] | None = None,
    ) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {shown(tissue)} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(25))")
        self.tissue = tissue
        self.moduli = _moduli(tissue, Material() if material is None else material)
        self.times = np.array([_validate.number("times", time, positive=True) for time in np.ravel(times)])
        self.fractions = _fractions(fractions, self.times, self.moduli.shear.shape)
        pinned = np.repeat((tissue.pinned | self.moduli.rigid_nodes)[..., None], 3, axis=-1)
        self._held = (pinned if held is None else np.asarray(held, bool)).reshape(-1)
        corners = cell_corners(tissue.grid)
        self._unknowns = (3 * corners[:, :, None] + np.arange(3)).reshape(-1, 24)
        self._solvers: dict[tuple[float, ...], _Solver] = {}

    @cached_property
    def stiffness(self) -> Array:
        """(cells, 24, 24) of each cell, at no time to relax."""
        return cell_stiffness(self.moduli)

    @cached_property
    def rest(self) -> StepwiseTissueState:
        """Tissue that nothing has moved yet."""
        nothing = np.zeros((*self.tissue.grid.shape, 3))
        return StepwiseTissueState(nothing, np.zeros((len(self.times), len(self._unknowns), 24)))

    def step(self, state: StepwiseTissueState, forces: Array, dt: float) -> StepwiseTissueState:
        """Return the state a time later, the displacement having gone there straight.

        Parameters
        ----------
        state : StepwiseTissueState
            Before.
        forces : (nx, ny, nz, 3) ndarray
            On the nodes at the end of the step, in the world; mN for mm and kPa.
        dt : float
            Seconds, at or above zero.
        """
        dt = _validate.number("dt", dt)
        turn = self.tissue.grid.direction
        before, after = state.displacement @ turn, self.free_response(state, dt) + self.response(forces @ turn, dt)
        keep, gain = self._branch(dt)
        moved = self._cell_forces(after - before)
        stress = keep[:, None, None] * state.stress + gain[:, None, None] * self.fractions[..., None] * moved
        return StepwiseTissueState(after @ turn.T, stress)

    def response(self, forces: Array, dt: float) -> Array:
        """Return how far the nodes (nx, ny, nz, 3) go within a step for forces at its end; along the grid's axes."""
        return self._solver(dt).solve(forces.reshape(-1)).reshape(*self.tissue.grid.shape, 3)

    def free_response(self, state: StepwiseTissueState, dt: float) -> Array:
        """Return where the nodes (nx, ny, nz, 3) go within a step without forces at its end, along the grid's axes."""
        if not len(self.times):
            return np.zeros_like(state.displacement)
        keep, gain = self._branch(dt)
        elastic = self._cell_forces(state.displacement @ self.tissue.grid.direction)
        of_cells = (gain @ self.fractions)[:, None] * elastic - np.tensordot(keep, state.stress, 1)
        past = np.zeros(len(self._held))
        np.add.at(past, self._unknowns, of_cells)
        return self.response(past, dt)

    def _branch(self, dt: float) -> tuple[Array, Array]:
        """What is left of each branch after a time, and what it gains of a change within it."""
        passed = dt / self.times
        return np.exp(-passed), -np.expm1(-passed) / passed if dt > 0 else np.ones_like(passed)

    def _cell_forces(self, displacement: Array) -> Array:
        """Elastic forces (cells, 24) on the corners of each cell."""
        return np.einsum("eij,ej->ei", self.stiffness, displacement.reshape(-1)[self._unknowns])

    def _solver(self, dt: float) -> _Solver:
        gain = self._branch(dt)[1]
        key = tuple(gain.tolist())
        if key not in self._solvers:
            while len(self._solvers) >= _KEPT:
                self._solvers.pop(next(iter(self._solvers)))
            factors = 1 - (1 - gain) @ self.fractions
            self._solvers[key] = _Solver(self, factors[:, None, None] * self.stiffness)
        return self._solvers[key]

    def __repr__(self) -> str:
        return f"StepwiseTissue({self.tissue!r}, {len(self.times)} branches)"


class _Solver:
    """The matrix of cells with some components held, factored."""

    def __init__(self, body: StepwiseTissue, of_cells: Array) -> None:
        from scipy.sparse import coo_matrix, diags

        unknowns, free = body._unknowns, ~body._held
        places = np.repeat(unknowns, 24, axis=1).ravel(), np.tile(unknowns, (1, 24)).ravel()
        whole = coo_matrix((of_cells.ravel(), places), shape=(len(free),) * 2).tocsr()
        whole = diags(free.astype(float)) @ whole @ diags(free.astype(float)) + diags(whole.diagonal() * ~free)
        nodes = np.flatnonzero(free.reshape(-1, 3).any(axis=1))
        self._some = (3 * nodes[:, None] + np.arange(3)).ravel()  # the nodes that move in any direction
        self._free = free
        self._matrix = whole[self._some][:, self._some].tobsr((3, 3))
        self._factor: Any = Factor(self._matrix, body.tissue.grid.points[nodes])

    def solve(self, forces: Array) -> Array:
        """Return the displacement (3 N,) under forces (3 N,), those on held components left out."""
        found = np.zeros_like(forces)
        found[self._some], _ = self._factor.solve(self._matrix, np.where(self._free, forces, 0.0)[self._some], 0.0)
        return found


def _moduli(tissue: Tissue, material: Material | TissueMap | Moduli) -> Moduli:
    if isinstance(material, Material):
        return Moduli.uniform(tissue.grid, material)
    moduli = material.moduli(tissue.grid) if isinstance(material, TissueMap) else material
    if not isinstance(moduli, Moduli) or moduli.shear.shape != tuple(n - 1 for n in tissue.grid.shape):
        raise ValueError(f"material = {shown(material)} is not of this grid; give a Material, TissueMap or its Moduli")
    if moduli.fragments.any():
        raise ValueError("material has floating fragments, which finite elements here do not know; make them stiff")
    return moduli


def _fractions(given: ArrayLike, times: Array, cells: tuple[int, ...]) -> Array:
    """(branches, cells) of each cell."""
    fractions = np.asarray(given, float)
    if fractions.shape not in {(len(times),), (len(times), *cells)}:
        raise ValueError(f"fractions has shape {fractions.shape}; give ({len(times)},) or ({len(times)}, *{cells})")
    if not (fractions >= 0).all() or not (fractions.sum(axis=0) < 1).all():
        raise ValueError("fractions are out of range; give each at or above zero, and less than 1 in all")
    count = int(np.prod(cells))
    return np.multiply.outer(fractions, np.ones(count)) if fractions.ndim == 1 else fractions.reshape(-1, count)
