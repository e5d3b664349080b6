"""Elastic tissue in real time: finite elements, one multigrid iteration a step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _core, _memory, _validate
from ...fem.engine import INTEGRATIONS
from ...fields.grid_field import GridField
from ...geometry.grid import Grid
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.loads import Load, ShaftDisplacement
from ...mechanics.material import Material
from ...mechanics.moduli import Moduli
from ...mechanics.tissue_map import TissueMap
from .._value import ByValue
from .hierarchy import coarse_inverse, levels, pinned_faces
from .load_vector import nodal_load
from .solver_grid import solver_grid

Array = NDArray[np.float64]
Single = NDArray[np.float32]

FIRST_ITERATIONS = 3
"""On the first step, and after a jump."""
JUMP = 0.25
"""A step that finds the last field this wrong, relatively, has jumped."""
SAFETY = 1.4
"""Published error over the estimate: that is 0.41 to 1.28 times the error, over scenes, insertions and steps."""

_ESTIMATE_EVERY = 8
_FINEST = 1e-6
_MOST_ITERATIONS = 200
_RESTART = 12
"""Iterations after which the residual is computed anew: in float32 it drifts."""
_DEGREE, _HIGH_DEGREE = 3, 5
_HIGH_RATIO = 0.47
_BYTES_A_NODE = 300


class NotConvergedError(RuntimeError):
    """A step did not converge; the state it started from is still in force."""


@dataclass(frozen=True, eq=False, repr=False)
class ElasticState(ByValue):
    """Where the tissue is between two steps. Made by :class:`ElasticSolver`, never changed.

    A step returns a new one, so that a step that fails leaves the old one as it was.
    """

    displacement: Single
    """(3, nx, ny, nz) on the solver's grid, along its axes."""
    load: Single
    """(3, nx, ny, nz) nodal forces it answers to."""
    error: float = 0.0
    """Estimated error of the displacement, relative to itself."""
    iterations: int = 0
    """Iterations the last step took."""
    steps: int = 0
    """Steps since the needle was out."""
    contraction: float = 1.0
    """Error after over error before an iteration, where it was last measured."""

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.displacement.shape[1:]))
        return f"ElasticState({shape} nodes, {self.steps} steps, error={self.error:.2g})"


class ElasticSolver:
    """Linear elasticity with a stiffness for each cell, solved a little further at every step.

    Trilinear hexahedra on a grid of the solver's own, pinned faces clamped and the entry
    face free; conjugate gradients with one multigrid cycle as preconditioner, started from
    the last step's field. Set-up is made once for a label map and takes milliseconds.

    Parameters
    ----------
    tissue : Tissue
        The display grid, whose box is solved for, and its free face.
    material : Material or TissueMap, default: Material()
        One stiffness everywhere, or a label map with a table of materials.
    nodes : int, default: 15625
        Nodes of the solver's grid, about. 25^3 suffices for training, 49^3 resolves thin layers.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        The mean dilatation of each cell does not lock as Poisson's ratio nears 0.5; full
        integration is for comparison with other packages.

    Raises
    ------
    ValueError
        A box flatter than 10 : 1, a Poisson's ratio outside [0, 0.49], a stiffness at or below
        zero, or a contrast above a million.

    Notes
    -----
    Equation: -div (2 mu eps + lambda tr(eps) I) = b, small strain, quasi-static, linear: twice
    the load moves tissue twice as far. Multigrid for deforming hexahedra at frame rate:
    Dick, Georgii, Westermann, *Simul. Model. Pract. Theory* 19 (2011) 801.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.elastic import ElasticSolver
    >>> from sonospline.mechanics import LineForce
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(53)), nodes=13**3)
    >>> needle = ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5))
    >>> state = solver.step(solver.rest, LineForce(), needle)
    >>> field = solver.field(state)
    >>> field.on_grid().shape, bool(0.02 < abs(field.on_grid()).max() < 0.04), field.error_estimate < 0.02
    ((53, 53, 53, 3), True, True)
    """

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap | None = None,
        *,
        nodes: int = 25**3,
        integration: str = "mean_dilatation",
    ) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {tissue!r} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(53))")
        self.tissue = tissue
        self.material = Material() if material is None else material
        self.integration = _validate.choice("integration", integration, INTEGRATIONS)
        self.grid: Grid = solver_grid(tissue.grid, nodes)
        _memory.refuse_beyond(_BYTES_A_NODE * self.grid.node_count, f"nodes = {nodes}: the elastic solver")
        self.moduli = self._moduli()
        self._multigrid = self._make_multigrid()
        self._pinned = self.grid.on_faces(tissue.pinned_faces)
        zero = np.zeros((3, *self.grid.shape), np.float32)
        zero.setflags(write=False)
        self.rest = ElasticState(zero, zero)
        """The state without a needle."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_multigrid"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._multigrid = self._make_multigrid()

    def step(
        self, state: ElasticState, load: Load, needle: Needle, *, iterations: int | None = None, estimate: bool = False
    ) -> ElasticState:
        """Return the state after one step of a load.

        Parameters
        ----------
        state : ElasticState
            The last step's, or ``rest``.
        load : Load
            What the needle does, such as a :class:`~sonospline.mechanics.LineForce`.
        needle : Needle
            Entry and tip, both inside the tissue.
        iterations : int, optional
            By default one; three on the first step and where the last field proves to be
            off by a quarter, as after a sudden withdrawal.
        estimate : bool, default: False
            Measure the error of the new field, which costs as much as the iteration. It is
            measured on the second and every eighth step and after jumps anyway; in between it follows from
            the error before the iteration, which is free, and the contraction last measured.

        Raises
        ------
        ValueError
            A load that is no force, or a needle outside the tissue.
        NotConvergedError
            The iteration broke down; ``state`` is still good.
        """
        if not isinstance(load, Load) or isinstance(load, ShaftDisplacement):
            raise ValueError(f"load = {load!r} is not a force; give a LineForce (or a FiniteElementModel this load)")
        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)
        forces = nodal_load(load, needle, self.grid)
        if iterations is None:
            return self._stepped(state, forces, estimate)
        return self._iterate(state, forces, _validate.count("iterations", iterations), estimate=True)

    def advance(self, state: ElasticState, forces: Single) -> ElasticState:
        """Return the state after one step under given forces on the nodes."""
        return self._stepped(state, forces, estimate=False)

    def solve(self, load: Load, needle: Needle, *, tolerance: float = 1e-4) -> ElasticState:
        """Return the converged state of a load, from rest: the error estimate is at most ``tolerance``.

        Raises
        ------
        ValueError
            A tolerance below 1e-6: fields are float32.
        NotConvergedError
            It is still above after 200 iterations.
        """
        return self._converged(self.step(self.rest, load, needle, iterations=FIRST_ITERATIONS), tolerance)

    def equilibrium(self, forces: Array | Single, *, tolerance: float = 1e-4) -> ElasticState:
        """Return the converged state under given forces on the nodes of :attr:`grid`, as :meth:`solve` does of a load.

        Parameters
        ----------
        forces : (3, nx, ny, nz) ndarray
            Along the axes of the grid.
        tolerance : float, default: 1e-4
            Error estimate of the state, at most.

        Raises
        ------
        ValueError
            Forces of another shape, NaN or infinite, or a tolerance below 1e-6.
        NotConvergedError
            As :meth:`solve`.
        """
        wanted = (3, *self.grid.shape)
        if np.shape(forces) != wanted or not np.isfinite(forces).all():
            raise ValueError(f"forces has shape {np.shape(forces)}; give finite ones of shape {wanted}")
        single = np.ascontiguousarray(forces, np.float32)
        return self._converged(self._iterate(self.rest, single, FIRST_ITERATIONS, estimate=True), tolerance)

    def _converged(self, state: ElasticState, tolerance: float) -> ElasticState:
        tolerance = _validate.number("tolerance", tolerance, positive=True)
        if tolerance < _FINEST:
            raise ValueError(f"tolerance = {tolerance:g} is below what float32 resolves; give at least {_FINEST:g}")
        forces, taken = state.load, state.iterations
        while state.error > tolerance:
            if taken >= _MOST_ITERATIONS:
                raise NotConvergedError(
                    f"the error estimate is {state.error:.1e} after {taken} iterations, above tolerance = "
                    f"{tolerance:g}; allow a larger one, or use a lower contrast or Poisson's ratio"
                )
            # One direction more at a time near the goal, more of them while it is far.
            state = self._iterate(state, forces, min(_RESTART, max(2, taken // 2)), estimate=True)
            taken += state.iterations
        return replace(state, iterations=taken)

    def field(self, state: ElasticState) -> GridField:
        """Return the state as a field: cubic between the solver's nodes, on the display grid."""
        values = state.displacement.transpose(1, 2, 3, 0)
        if not self.grid.upright:
            values = values @ self.grid.direction.T.astype(np.float32)
        return GridField(self.tissue.grid, values, lattice=self.grid, order=3, error_estimate=state.error)

    def reaction(self, state: ElasticState) -> Array:
        """Return the force (3,) that the pinned faces exert on the tissue, in world axes.

        It balances the needle's load to the error of the state.
        """
        missing = self._multigrid.product(state.displacement) - state.load
        return self.grid.direction @ missing[:, self._pinned].sum(axis=1, dtype=np.float64)

    def _stepped(self, state: ElasticState, forces: Single, estimate: bool) -> ElasticState:
        if state.steps == 0:
            return self._iterate(state, forces, FIRST_ITERATIONS, estimate=True)
        due = estimate or state.steps == 1 or state.steps % _ESTIMATE_EVERY == 0
        found, before = self._once(state, forces, 1, due)
        if before > JUMP:
            return self._iterate(found, forces, FIRST_ITERATIONS - 1, estimate=True, already=1)
        return found

    def _iterate(
        self, state: ElasticState, forces: Single, iterations: int, *, estimate: bool, already: int = 0
    ) -> ElasticState:
        found, _ = self._once(state, forces, iterations, estimate)
        return replace(found, iterations=iterations + already, steps=state.steps + (not already))

    def _once(self, state: ElasticState, forces: Single, iterations: int, estimate: bool) -> tuple[ElasticState, float]:
        if not forces.any():
            return self.rest, 0.0
        displacement, errors, sound = self._multigrid.iterate(forces, state.displacement, iterations, estimate)
        if not sound:
            raise NotConvergedError(
                "the step did not converge (its energy is not positive); the last field is kept. "
                "Check the load and the stiffnesses for values far out of proportion"
            )
        displacement.setflags(write=False)
        contraction = errors[-1] / errors[-2] if estimate and errors[-2] > 0 else state.contraction
        error = SAFETY * (errors[-1] if estimate else errors[-1] * contraction)
        return ElasticState(displacement, forces, error, iterations, state.steps + 1, contraction), errors[0]

    def _moduli(self) -> Moduli:
        if isinstance(self.material, Material):
            return Moduli.uniform(self.grid, self.material)
        if isinstance(self.material, TissueMap):
            return self.material.moduli(self.grid)
        raise ValueError(f"material = {self.material!r} is none; give a Material, or a TissueMap for labelled tissue")

    def _make_multigrid(self) -> Any:
        full = self.integration == "full"
        grids = levels(self.moduli, self.tissue)
        return _core.active.ElasticMultigrid(
            grids,
            pinned_faces(self.tissue),
            full,
            _HIGH_DEGREE if self.moduli.largest_ratio > _HIGH_RATIO else _DEGREE,
            coarse_inverse(grids[-1], self.tissue, full),
        )
