"""The finite element model of a tissue with a needle in it."""

from __future__ import annotations

import logging
import time

import numpy as np
from numpy.typing import NDArray

from .. import _memory, _validate
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.loads import Load
from ..mechanics.material import Material
from ..mechanics.moduli import INTEGRATIONS, Moduli
from .engine import SOLVERS, Engine, StepTimes, System, check_locking
from .fenicsx import FEniCSx
from .mesh import ELEMENTS, cells
from .scikit import ScikitFem

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

ENGINES: dict[str, type[Engine]] = {"scikit-fem": ScikitFem, "fenicsx": FEniCSx}

_NARROWEST = 4.0
"""Spacings in the finest length of a load, at most: a narrower one would fall between the nodes."""
_BYTES_A_NODE = 10_000


class FiniteElementModel:
    """Linear elasticity on a tissue's own nodes: pinned faces and rigid cells clamped, the entry face free (Sec. IV).

    Small strain, quasi-static. What does not change with the load (matrices, and the
    hierarchy or factor of the solver) is made at the first solve and kept.

    Parameters
    ----------
    tissue : Tissue
        Grid and pinned faces.
    material : Material or Moduli, default: Material()
        Stiffness and compressibility, of all tissue or of each cell of the grid.
    element : {"hexahedron", "tetrahedron"}, default: "hexahedron"
        Trilinear hexahedra (Q1), or each of them split into six linear tetrahedra (P1).
    integration : {"full", "mean_dilatation"}, default: "full"
        Full integration looks too stiff (locks) as Poisson's ratio nears 0.5: it is
        refused above 0.47. The mean dilatation of each element in its place (B-bar) does
        not lock and is allowed up to 0.499. On linear tetrahedra the two are the same.
    engine : {"scikit-fem", "fenicsx"}, default: "scikit-fem"
        Who computes. ``"fenicsx"`` is DOLFINx in whichever Python has it, see
        :class:`sonospline.fem.fenicsx.FEniCSx`.
    solver : {"multigrid", "direct", "from_scratch"}, default: "multigrid"
        Conjugate gradients with algebraic multigrid; a factorisation; or everything anew
        at every solve, by conjugate gradients with a diagonal preconditioner.
    tolerance : float, default: 1e-10
        Residual at which conjugate gradients stop, relative to the right-hand side.

    Raises
    ------
    ValueError
        An unknown element, integration, engine or solver; a Poisson's ratio at which the
        elements lock.
    MissingExtraError
        The engine is not installed.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.fem import FiniteElementModel
    >>> from sonospline.mechanics import LineForce
    >>> model = FiniteElementModel(ss.Tissue(ss.Grid.unit_cube(9)))
    >>> u = model.solve(LineForce(), ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> u.shape, bool(0.01 < u[..., 0].max() < 0.03)
    ((9, 9, 9, 3), True)
    """

    def __init__(
        self,
        tissue: Tissue,
        material: Material | Moduli | None = None,
        *,
        element: str = "hexahedron",
        integration: str = "full",
        engine: str = "scikit-fem",
        solver: str = "multigrid",
        tolerance: float = 1e-10,
    ) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {tissue!r} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(25))")
        self.tissue = tissue
        if not isinstance(material, Material | Moduli | None):
            raise ValueError(f"material = {material!r} is not a Material; make one, e.g. Material(10.0, 0.45)")
        cells_wanted = tuple(n - 1 for n in tissue.grid.shape)
        if isinstance(material, Moduli) and material.lame.shape != cells_wanted:
            raise ValueError(f"material has {material.lame.shape} cells; give the grid's {cells_wanted}")
        if isinstance(material, Moduli) and material.fragments.any():
            raise ValueError("material has floating fragments, which finite elements here do not know; make them stiff")
        self.material = Material() if material is None else material
        self.element = _validate.choice("element", element, ELEMENTS)
        self.integration = _validate.choice("integration", integration, INTEGRATIONS)
        check_locking(self.material, self.element, self.integration)
        self.engine = _validate.choice("engine", engine, ENGINES)
        self._engine_type = ENGINES[self.engine]
        self.solver = _validate.choice("solver", solver, SOLVERS)
        self.tolerance = _validate.number("tolerance", tolerance, positive=True)
        if self.tolerance >= 1:
            raise ValueError(f"tolerance = {tolerance:g} solves nothing; give a small one, e.g. 1e-10")
        rigid = self.material.rigid_nodes if isinstance(self.material, Moduli) else False
        self._pinned = (self.tissue.pinned | rigid).ravel()
        self.times: list[StepTimes] = []
        """Where the time of each solve went, in order."""
        self._axes = np.eye(3)
        self._engine = self._engine_type(self._system())

    def solve(self, load: Load, needle: Needle) -> Array:
        """Return the displacement (nx, ny, nz, 3) of the nodes, in the unit of the grid.

        Parameters
        ----------
        load : LineForce or ShaftDisplacement
            What the needle does.
        needle : Needle
            Entry and tip, both inside the tissue.

        Raises
        ------
        ValueError
            A needle that leaves the tissue, or a load too narrow for the grid.
        RuntimeError
            The solver did not converge.
        """
        self._check(load, needle)
        started = time.perf_counter()
        grid = self.tissue.grid
        force = load.body_force(grid.points, needle, self.tissue.depth_below_entry_face(needle.tip))
        along = np.where(self._pinned, np.nan, load.axial_displacement(grid.points, needle))
        held = None
        if np.isfinite(along).any():
            held = np.zeros(force.shape, bool)
            held[:, 0] = np.isfinite(along)
            self._turn_to(needle)
        elif not force.any():
            logger.warning("%s acts on no node at %s: nothing moves; use a finer grid", load, needle)
        prescribed = np.zeros_like(force)
        prescribed[:, 0] = np.nan_to_num(along)
        spent = time.perf_counter() - started
        displacement, times = self._engine.solve(force @ self._axes, prescribed, held)
        self.times.append(times._replace(load_s=times.load_s + spent))
        return (displacement @ self._axes.T).reshape(*grid.shape, 3)

    def _check(self, load: Load, needle: Needle) -> None:
        if not isinstance(load, Load):
            raise ValueError(f"load = {load!r} is not a load case; give a LineForce or a ShaftDisplacement")
        if not isinstance(needle, Needle):
            raise ValueError(f"needle = {needle!r} is not a Needle; make one from its entry and tip")
        spacing = max(self.tissue.grid.spacing)
        if load.finest_length * _NARROWEST < spacing:
            raise ValueError(
                f"load = {load!r} falls between nodes {spacing:g} apart; give one of the size of the tissue, e.g. "
                f"{type(load).__name__}.for_cube({self.tissue.grid.side:g}), or a finer grid"
            )
        self.tissue.check_inside(entry=needle.entry, tip=needle.tip)

    def _turn_to(self, needle: Needle) -> None:
        """Take the axes of the needle, along which what it holds is the first component of each node."""
        if np.allclose(self._axes[:, 0], needle.direction, rtol=0, atol=1e-12):
            return
        across = np.cross(needle.direction, np.eye(3)[np.abs(needle.direction).argmin()])
        across /= np.linalg.norm(across)
        self._axes = np.column_stack([needle.direction, across, np.cross(needle.direction, across)])
        self._engine = self._engine_type(self._system())

    def _system(self) -> System:
        grid = self.tissue.grid
        _memory.refuse_beyond(_BYTES_A_NODE * grid.node_count, f"grid = {grid.shape}: the finite element matrices")
        return System(
            points=grid.points @ self._axes,
            cells=cells(grid, self.element),
            pinned=self._pinned,
            material=self.material,
            integration=self.integration,
            solver=self.solver,
            tolerance=self.tolerance,
            axes=grid.direction.T @ self._axes,
        )

    def __repr__(self) -> str:
        return f"FiniteElementModel({self.tissue!r})"
