"""Relaxing tissue in real time: the elastic solver, and what tissue remembers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import shown
from ..mechanics.material import Material
from ..mechanics.relaxation import PronySeries
from .solver import ElasticSolver
from .state import BUDGET, TOLERANCE, RelaxingState
from .tissue_relaxation import TissueRelaxation
from .uniform_relaxation import UniformRelaxation

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Series = PronySeries | Mapping[int, PronySeries]

_SOME = 1e-12
"""Share of a cell."""


class RelaxingSolver:
    """Viscoelastic tissue: moduli that relax by a Prony series, everywhere alike or tissue by tissue.

    Stiffness is that of a sudden push: a step over dt = 0, and tissue that does not relax, is the elastic solver's
    bit by bit. Tissue of one series costs no solve more, and is exact for forces that change linearly within a step; of
    several series displacement is linear in time within each part of a step, and parts grow in a long one.

    Parameters
    ----------
    solver : ElasticSolver
        Of the tissue.
    series : PronySeries or mapping of int to PronySeries, optional
        Everywhere, or for each label; those that are not elastic share their time constants. By default the power
        laws of the materials' ``relaxation_exponent``.

    Raises
    ------
    ValueError
        Labels without a series, or time constants that differ.

    Notes
    -----
    sigma = C : (e - sum g_b B a_b), da_b/dt = (u - a_b) / tau_b, Poisson's ratio constant: generalised Maxwell tissue
    (Simo and Hughes, *Computational Inelasticity*, 1998, chapter 10) with the history in nodal displacements.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.elasticity import ElasticSolver, RelaxingSolver
    >>> from sonospline.mechanics import LineForce, PronySeries
    >>> solver = ElasticSolver(ss.Tissue(ss.Grid.unit_cube(53)), nodes=9**3)
    >>> tissue = RelaxingSolver(solver, PronySeries(fractions=(0.3,), times_s=(2.0,)))
    >>> forces = solver.nodal_load(LineForce(), ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> pushed = tissue.advance(tissue.rest, forces, dt=0.0)
    >>> held = tissue.advance(pushed, forces, dt=60.0)
    >>> round(float(held.solution.displacement.max() / pushed.solution.displacement.max()), 2)  # 1 / 0.7
    1.43
    """

    def __init__(self, solver: ElasticSolver, series: Series | None = None) -> None:
        if not isinstance(solver, ElasticSolver):
            raise ValueError(f"solver = {shown(solver)} is not an ElasticSolver; make one of the tissue")
        self.solver = solver
        self._relaxation = _relaxation(solver, series)
        history = np.zeros((len(self.times_s), *solver.rest.displacement.shape), np.float32)
        self.rest = RelaxingState(solver.rest, solver.rest.load, history)
        """The state without a past."""

    @property
    def times_s(self) -> tuple[float, ...]:
        """Time constants; none where no tissue relaxes."""
        return self._relaxation.times_s

    @property
    def uniform(self) -> bool:
        """Whether all tissue relaxes alike."""
        return isinstance(self._relaxation, UniformRelaxation)

    def advance(
        self, state: RelaxingState, forces: Single, dt: float, *, tolerance: float = TOLERANCE, budget: int = BUDGET
    ) -> RelaxingState:
        """Return the state after a step under forces on the nodes of the solver's grid.

        Parameters
        ----------
        state : RelaxingState
            The last step's, or :attr:`rest`.
        forces : (3, nx, ny, nz) ndarray of float32
            At the end of the step, along the axes of the grid; within it they change linearly.
        dt : float
            Length of the step in s, at or above zero; a minute if need be.
        tolerance : float, default: 0.0125
            As of :meth:`ElasticSolver.advance`.
        budget : int, default: 12
            Iterations of a step, or of each part of a long one, at most.

        Raises
        ------
        ValueError
            A dt that is negative or not finite, or forces of another shape.
        NotConvergedError
            The iteration broke down; ``state`` is still good.
        """
        dt = _validate.number("dt", dt)
        if np.shape(forces) != state.forces.shape:
            raise ValueError(f"forces has shape {np.shape(forces)}; give {state.forces.shape}, one at each node")
        single = np.array(forces, np.float32, order="C")
        single.setflags(write=False)  # the state keeps it
        return self._relaxation.advance(state, single, dt, tolerance, budget)

    def predicted(self, state: RelaxingState, dt: float) -> RelaxingState:
        """Return about where tissue creeps to in dt if its forces stay: for one iteration, as contact needs it.

        Raises
        ------
        ValueError, NotConvergedError
            As :meth:`advance`.
        """
        return self.advance(state, state.forces, dt, budget=1)

    def growth(self, state: RelaxingState, dt: float) -> float:
        """Return about which part of itself displacement creeps by in dt if its forces stay.

        Where tissue relaxes alike and the past forces were like the present ones; infinite where only a step can tell.
        """
        return self._relaxation.growth(state, _validate.number("dt", dt))

    def jump(self, dt: float) -> float:
        """Return how much of the elastic answer to a change of the forces over dt tissue gives at the end of dt.

        Exact where tissue relaxes alike, and the mean over the cells where it does not; :meth:`effective` has
        the whole answer.

        Raises
        ------
        ValueError
            A dt that is negative or not finite.
        """
        return self._relaxation.jump(_validate.number("dt", dt))

    def effective(self, dt: float) -> ElasticSolver:
        """Return the solver of the answer to a change of the forces over dt: elastic, and softer than the tissue.

        It is made anew, which takes as long as to make an :class:`ElasticSolver`.

        Raises
        ------
        ValueError
            A dt that is negative or not finite.
        """
        return self._relaxation.effective(_validate.number("dt", dt))

    def __repr__(self) -> str:
        return f"RelaxingSolver({self._relaxation!r} of {self.solver!r})"


def _relaxation(solver: ElasticSolver, series: Series | None) -> UniformRelaxation | TissueRelaxation:
    """How tissue goes on, by whether all that moves is of one series."""
    if isinstance(series, PronySeries):
        return UniformRelaxation(solver, series)
    if isinstance(solver.material, Material):
        if series is not None:
            raise ValueError(f"series = {shown(series)} is for labels, and the tissue is one; give a PronySeries")
        return UniformRelaxation(solver, PronySeries.power_law(solver.material.relaxation_exponent))
    materials = solver.material.materials
    if series is None:
        series = {label: PronySeries.power_law(each.relaxation_exponent) for label, each in materials.items()}
    of_labels = _checked(series, materials)
    kinds = sorted(set(of_labels.values()), key=lambda each: (each.times_s, each.fractions))
    members = {label: [float(each == kind) for kind in kinds] for label, each in of_labels.items()}
    shares = solver.material.mean_of_cells(solver.grid, members)
    occurring = [bool((share[~solver.moduli.rigid] > _SOME).any()) for share in shares]
    if sum(occurring) == 1:
        return UniformRelaxation(solver, kinds[occurring.index(True)])
    relaxing = [there and kind.times_s != () for there, kind in zip(occurring, kinds, strict=True)]
    found = [kind for kind, does in zip(kinds, relaxing, strict=True) if does]
    return TissueRelaxation(solver, found, shares[relaxing])


def _checked(series: object, materials: Mapping[int, Material]) -> dict[int, PronySeries]:
    """A series for each label, all of the same time constants but for elastic ones."""
    if not isinstance(series, Mapping):
        raise ValueError(f"series = {shown(series)} is none; give a PronySeries, or one for each label")
    missing = sorted(set(materials) - set(series))
    if missing:
        raise ValueError(f"series has none for labels {shown(missing)}; give PronySeries() for what is elastic")
    for label in materials:
        if not isinstance(series[label], PronySeries):
            raise ValueError(f"series[{label}] = {shown(series[label])} is none; give a PronySeries")
    of_labels = {label: _terms(series[label]) for label in materials}
    times = sorted({each.times_s for each in of_labels.values() if each.times_s})
    if len(times) > 1:
        raise ValueError(
            f"times_s = {shown(times[0])} and {shown(times[1])} differ between labels; give shared time constants, "
            "with a fraction of 0 where a tissue lacks one"
        )
    return of_labels


def _terms(series: PronySeries) -> PronySeries:
    """A series, without any terms where none of them counts."""
    return series if any(series.fractions) else PronySeries()
