"""Elastic tissue in real time: finite elements, one multigrid iteration a step."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core, _memory, _validate
from .._shown import shown
from ..fields.grid_field import GridField
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.solver_grid import solver_grid
from ..geometry.tissue import Tissue
from ..mechanics.continued_walls import WALLS, ContinuedWalls
from ..mechanics.loads import Load
from ..mechanics.material import Material
from ..mechanics.moduli import INTEGRATIONS, Moduli
from ..mechanics.nodal_load import nodal_load
from ..mechanics.tissue_map import TissueMap
from . import hierarchy
from .calibration import UNIFORM, error_safety
from .checks import check_force, check_material
from .fragments import FloatingFragments, nodes_of_fragments
from .state import BROKEN, BUDGET, FASTEST, TOLERANCE, ElasticState, NotConvergedError

Array = NDArray[np.float64]
Single = NDArray[np.float32]

FIRST_ITERATIONS = 3
"""On the first step, and after a jump."""
JUMP = 0.25
"""A step that finds the last field this wrong, relatively, has jumped."""
SETTLED = 5e-4
"""Error estimate at which tissue has come to rest."""

_ESTIMATE_EVERY = 8
_AT_A_TIME = 3
_CHANGED = 1.3
"""Error before a step's iteration over that before the last step's, or the reverse, from which its own is measured."""
_MOST_CALIBRATED = 34**3
"""Nodes beyond which a coarser grid of the same tissue is asked instead: half a hundred iterations cost a second."""
_CALIBRATED = 25**3
_UNEVEN = 1.35
"""By so much more an iteration may leave where tissues differ than the last one that was measured."""
_FINEST = 1e-6
_MOST_ITERATIONS = 200
_RESTART = 12
"""Iterations after which the residual is computed anew: in float32 it drifts."""
_DEGREE, _HIGH_DEGREE = 3, 5
_HIGH_RATIO = 0.47
_BYTES_A_NODE = 300


class ElasticSolver:
    """Linear elasticity with a stiffness for each cell, solved a little further at every step.

    Trilinear hexahedra on a grid of the solver's own, pinned faces clamped and the others
    free; conjugate gradients with one multigrid cycle as preconditioner, started from
    the last step's field. Set-up is made once for a label map and takes milliseconds.

    Parameters
    ----------
    tissue : Tissue
        The display grid, whose box is solved for, and its free face.
    material : Material or TissueMap, default: Material()
        One stiffness everywhere, or a label map with a table of materials.
    nodes : int or Grid, default: 15625
        Nodes of the solver's grid, about; or that grid, over the same box, as one whose cells end where the
        voxels of a label map do. A layer half as thick as a cell and ten times as stiff as its
        surroundings leaves 0.015 of the mean displacement, thirty times 0.03; a layer as thick as a
        cell of 49^3 nodes half of that.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        The mean dilatation of each cell does not lock as Poisson's ratio nears 0.5; full
        integration is for comparison with other packages.
    walls : {"pinned", "continued"}, default: "pinned"
        Whether the faces that the tissue pins do not move; or are held by springs, as tissue that goes on beyond
        them would: for a crop of a body (see :class:`~sonospline.mechanics.continued_walls.ContinuedWalls`).

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
    >>> from sonospline.elasticity import ElasticSolver
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
        nodes: int | Grid = 25**3,
        integration: str = "mean_dilatation",
        walls: str = "pinned",
    ) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {shown(tissue)} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(53))")
        self.tissue = tissue
        self.material = Material() if material is None else check_material(material)
        self.integration = _validate.choice("integration", integration, INTEGRATIONS)
        self.walls = _validate.choice("walls", walls, WALLS)
        self.grid: Grid = solver_grid(tissue.grid, nodes)
        _memory.refuse_beyond(_BYTES_A_NODE * self.grid.node_count, f"nodes = {nodes}: the elastic solver")
        self.nodes = Tissue(self.grid, tissue.entry_face, tissue.pinned_faces)
        """The tissue with the nodes of :attr:`grid`."""
        self.moduli = self._moduli()
        self.pinned = [False] * 6 if walls == "continued" else hierarchy.pinned_faces(tissue)
        """Which of the faces, in the order of ``FACES``, do not move."""
        self._fixed = hierarchy.fixed_nodes(self.moduli, self.pinned)
        self.free = (self._fixed == 0).astype(np.float32)
        """(nx, ny, nz): 1 at nodes that may move, 0 where a face or bone holds them."""
        self._multigrid = self._make_multigrid()
        zero = np.zeros((3, *self.grid.shape), np.float32)
        zero.setflags(write=False)
        self.rest = ElasticState(zero, zero)
        """The state without a needle."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_multigrid"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._multigrid = self._make_multigrid()

    @cached_property
    def safety(self) -> float:
        """Published error over the estimate of the multigrid cycle."""
        if isinstance(self.material, Material):
            return UNIFORM
        if self.grid.node_count > _MOST_CALIBRATED:
            coarse = self.coarser(_CALIBRATED)
            if coarse is not None:
                return coarse.safety
        return error_safety(self._multigrid, self._fixed != 0)

    def coarser(self, nodes: int) -> ElasticSolver | None:
        """Return the solver of the same tissue on fewer nodes; None where those cannot tell bone from what moves."""
        try:
            return ElasticSolver(
                self.tissue, self.material, nodes=nodes, integration=self.integration, walls=self.walls
            )
        except ValueError:  # all but the moduli of larger cells has passed: nothing moves there, or a fragment is lost
            return None

    def step(self, state: ElasticState, load: Load, needle: Needle, *, iterations: int | None = None) -> ElasticState:
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
            So many; by default as :meth:`advance`.

        Raises
        ------
        ValueError
            A load that is no force, or a needle outside the tissue.
        NotConvergedError
            The iteration broke down; ``state`` is still good.
        """
        forces = self.nodal_load(load, needle)
        if iterations is None:
            return self.advance(state, forces)
        return self._iterate(state, forces, _validate.count("iterations", iterations))

    def nodal_load(self, load: Load, needle: Needle) -> Single:
        """Return the forces (3, nx, ny, nz) of a load on the nodes of :attr:`grid`, along its axes.

        Raises
        ------
        ValueError
            A load that is no force, or a needle outside the tissue.
        """
        check_force(load)
        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)
        return nodal_load(load, needle, self.nodes).forces

    def advance(
        self, state: ElasticState, forces: Single, *, tolerance: float = TOLERANCE, budget: int = BUDGET
    ) -> ElasticState:
        """Return the state after one step under forces on the nodes of :attr:`grid`.

        One iteration, three on the first step and after a jump, and more of them until the error
        estimate is at most ``tolerance`` or ``budget`` iterations are done. The estimate costs as
        much as an iteration: it is measured where it may decide, where the load jumps or comes to a
        stop, on the second and on every eighth step; in between it follows from the error before the
        iteration, which is free, and the contraction last measured. Under the same forces the tissue
        goes on to rest, and stays there.
        """
        if not forces.any():
            return self.rest
        if state.measured and state.error <= SETTLED and np.array_equal(forces, state.load):
            return state
        found = self._first(state, forces, budget)
        # A load that comes to a stop leaves what iterations are slow at: contraction is not that last measured.
        doubted = found.error > tolerance / 2 or _CHANGED * found.before < state.before
        if not found.measured and doubted and found.error <= 3 * tolerance:
            found = self._measured(found, forces)
        while found.iterations < budget and found.error > tolerance:
            found = self._further(found, forces, min(_wanted(found, tolerance), budget - found.iterations))
        return found

    def _first(self, state: ElasticState, forces: Single, budget: int) -> ElasticState:
        """The iterations that every step takes."""
        if state.steps == 0:
            return self._iterate(state, forces, min(FIRST_ITERATIONS, budget))
        same = np.array_equal(forces, state.load)
        due = same or state.steps == 1 or state.steps % _ESTIMATE_EVERY == 0
        found, before = self._once(state, forces, 1, due)
        if before > _CHANGED * state.before:  # the load has jumped: contraction is another than that last measured
            found = self.measured(found)
        if before > JUMP and budget > 1:
            return self._further(found, forces, min(FIRST_ITERATIONS, budget) - 1)
        return found

    def measured(self, state: ElasticState) -> ElasticState:
        """Return a state with its error measured: as an iteration costs, where it is not."""
        return state if state.measured else self._measured(state, state.load)

    def _measured(self, found: ElasticState, forces: Single) -> ElasticState:
        """The same displacement, with its error measured."""
        _, errors, _ = self._multigrid.iterate(forces, found.displacement, 0, True)
        contraction = errors[-1] / found.before if found.iterations == 1 and found.before > 0 else found.contraction
        return replace(found, error=self.safety * errors[-1], measured=True, contraction=contraction)

    def _further(self, found: ElasticState, forces: Single, iterations: int) -> ElasticState:
        """More iterations in the same step."""
        more = self._iterate(found, forces, iterations)
        # The next step begins with one iteration: its contraction is that of a first one.
        contraction = more.contraction if found.steps == 1 else found.contraction
        return replace(
            more,
            iterations=found.iterations + iterations,
            steps=found.steps,
            contraction=contraction,
            before=found.before,
        )

    def solve(self, load: Load, needle: Needle, *, tolerance: float = 1e-4) -> ElasticState:
        """Return the converged state of a load, from rest: the error estimate is at most ``tolerance``.

        Raises
        ------
        ValueError
            A tolerance below 1e-6: fields are float32.
        NotConvergedError
            It is still above after 200 iterations.
        """
        return self.settle(self.step(self.rest, load, needle, iterations=FIRST_ITERATIONS), tolerance=tolerance)

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
        return self.settle(self._iterate(self.rest, single, FIRST_ITERATIONS), tolerance=tolerance)

    def settle(self, state: ElasticState, *, tolerance: float = 1e-4) -> ElasticState:
        """Return a state iterated under its own load until the error estimate is at most ``tolerance``.

        Raises
        ------
        ValueError, NotConvergedError
            As :meth:`solve`; what the state took before does not count.
        """
        tolerance = _validate.number("tolerance", tolerance, positive=True)
        if tolerance < _FINEST:
            raise ValueError(f"tolerance = {tolerance:g} is below what float32 resolves; give at least {_FINEST:g}")
        forces, taken = state.load, state.iterations
        most = taken + _MOST_ITERATIONS
        while state.error > tolerance or not state.measured:
            if taken >= most:
                raise NotConvergedError(
                    f"the error estimate is {state.error:.1e} after {taken} iterations, above tolerance = "
                    f"{tolerance:g}; allow a larger one, or use a lower contrast or Poisson's ratio"
                )
            # One direction more at a time near the goal, more of them while it is far.
            state = self._iterate(state, forces, min(_RESTART, max(2, taken // 2)))
            taken += state.iterations
        return replace(state, iterations=taken)

    def response(self, forces: Single, start: Single, iterations: int) -> Single:
        """Return the displacement some iterations from a start (3, nx, ny, nz) under forces, without its error."""
        displacement, _, sound = self._multigrid.iterate(forces, start, iterations, False)
        if not sound:
            raise NotConvergedError(BROKEN)
        displacement.setflags(write=False)
        return displacement

    def field(self, state: ElasticState) -> GridField:
        """Return the state as a field: cubic between the solver's nodes, on the display grid."""
        values = state.displacement.transpose(1, 2, 3, 0)
        if not self.grid.upright:
            values = values @ self.grid.direction.T.astype(np.float32)
        return GridField(self.tissue.grid, values, lattice=self.grid, order=3, error_estimate=state.error)

    def reaction(self, state: ElasticState) -> Array:
        """Return the force (3,) that walls and rigid tissue exert on the rest, in world axes.

        It balances the needle's load to the error of the state.
        """
        missing = (self.forces(state.displacement) - state.load)[:, self._fixed != 0].sum(axis=1, dtype=np.float64)
        held = state.displacement * hierarchy.springs_of(self.moduli, self._fixed)
        return self.grid.direction @ (missing - held.sum(axis=(1, 2, 3), dtype=np.float64))

    def forces(self, displacement: Single) -> Single:
        """Return the forces on the nodes (3, nx, ny, nz) that hold a displacement, those of walls among them."""
        return np.asarray(self._multigrid.product(displacement))

    def _iterate(self, state: ElasticState, forces: Single, iterations: int) -> ElasticState:
        return self._once(state, forces, iterations, estimate=True)[0] if forces.any() else self.rest

    def _once(self, state: ElasticState, forces: Single, iterations: int, estimate: bool) -> tuple[ElasticState, float]:
        """The state some iterations on under forces that are not all zero, and the error before them."""
        displacement, errors, sound = self._multigrid.iterate(forces, state.displacement, iterations, estimate)
        if not sound:
            raise NotConvergedError(BROKEN)
        displacement.setflags(write=False)
        contraction = errors[-1] / errors[-2] if estimate and errors[-2] > 0 else state.contraction
        expected = max(contraction, FASTEST) * (1.0 if isinstance(self.material, Material) else _UNEVEN)
        error = self.safety * (errors[-1] if estimate else errors[-1] * expected)
        said = error, estimate, iterations, state.steps + 1, contraction
        return ElasticState(displacement, forces, *said, before=errors[0]), errors[0]

    def _moduli(self) -> Moduli:
        if isinstance(self.material, Material):
            moduli = Moduli.uniform(self.grid, self.material)
        else:
            moduli = self.material.moduli(self.grid)
        return replace(moduli, walls=ContinuedWalls.of(self.nodes)) if self.walls == "continued" else moduli

    def _make_multigrid(self) -> Any:
        full = self.integration == "full"
        degree = _HIGH_DEGREE if self.moduli.poissons_ratio > _HIGH_RATIO else _DEGREE
        pinned, layers = self.pinned, self.moduli.layers
        fragments = nodes_of_fragments(self.moduli.fragments, self.nodes)
        layered = {"layered": layers.cells, "excess": layers.excess.astype(np.float32)}
        if hierarchy.is_hard(self.moduli):
            finest, stencils = [hierarchy.finest(self.moduli)], hierarchy.galerkin(self.moduli, self._fixed, full)
            inverse = hierarchy.inverse_of_stencil(stencils[-1]) if stencils else np.zeros((0, 0), np.float32)
            springs = hierarchy.springs_of(self.moduli, self._fixed)
            multigrid = _core.active.ElasticMultigrid(
                finest, pinned, full, degree, inverse, self._fixed, stencils, **layered, springs=springs
            )
            return FloatingFragments(multigrid, self.grid, fragments) if len(fragments) else multigrid
        grids = hierarchy.levels(self.moduli, pinned)
        inverse = hierarchy.inverse_of_level(grids[-1], pinned, full)
        return _core.active.ElasticMultigrid(grids, pinned, full, degree, inverse, **layered)

    def __repr__(self) -> str:
        return f"ElasticSolver({self.grid!r}, free {' '.join(self.tissue.free_faces)})"


def _wanted(state: ElasticState, tolerance: float) -> int:
    """Iterations that should bring an error to a tolerance; few, as the rate may be better than the one last seen."""
    rate = min(max(state.contraction, 0.05), 0.9)
    return min(max(1, int(np.ceil(np.log(state.error / tolerance) / np.log(1 / rate)))), _AT_A_TIME)
