"""Elastic tissue, live: finite elements on labelled or uniform tissue, iterated at every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import _validate
from ...contact.events import Held
from ...contact.freezing import frozen
from ...contact.frozen_contact import FrozenContact
from ...contact.medium import REUSE, Medium
from ...elasticity.checks import check_force, check_material
from ...elasticity.relaxing import RelaxingSolver
from ...elasticity.solver import ElasticSolver
from ...elasticity.state import BUDGET, TOLERANCE, NotConvergedError
from ...fields.grid_field import GridField
from ...fields.strain import largest_strain
from ...geometry.grid import Grid
from ...geometry.needle import Needle
from ...geometry.solver_grid import nodes_resolving
from ...geometry.tissue import Tissue
from ...mechanics.default_load import default_load
from ...mechanics.first_touch import BUILD_UP_MM
from ...mechanics.loads import MILLI, NEEDLE_RADIUS_MM, PROCESS_ZONE_MM, LineLoad, Load
from ...mechanics.material import Material
from ...mechanics.relaxation import PronySeries
from ...mechanics.tissue_map import TissueMap
from ..contract import NeedleForce, Response, State, TissueModel
from .able import ABLE, CONTACTS, RELAXATIONS
from .grid_error import GridError, grid_error
from .in_pose import MOST_ROUNDS, Loaded, NeedlesInPose
from .in_time import NeedlesInTime, force_of
from .needle_loads import LOAD_AT, NeedleLoads
from .tissue_state import ElasticTissueState

Array = NDArray[np.float64]
Single = NDArray[np.float32]

RESOLVED = 0.8
"""Width of a load, in cells, from which its tip moves alike wherever it lies in a cell: to 3 %."""
_MOST_NODES = 50_000
"""Of a solver that nobody asked more of: some 3 ms an iteration."""
_STILL = 5e-5
"""Error of a field and of the forces of tracks together from which on they stay."""


class ElasticModel(TissueModel):
    """Linear elastic tissue under the friction and the tip force of needles, in mm, kPa and N.

    Quasi-static: the answer is that of the pose, whatever the time. A step iterates until the error
    estimate is at most ``tolerance`` or ``budget`` iterations are done, so that a field depends
    little on the steps that led to it; each field says how little.
    Tissue that is left alone comes to rest: further steps at the same pose go on to an error of
    5e-4 and then change nothing.

    Parameters
    ----------
    tissue : Tissue
        The display grid and its free face.
    material : Material or TissueMap
        One stiffness everywhere, or labelled tissue.
    load : Load, optional
        What a needle does, taken as it is; by default :func:`~sonospline.mechanics.default_load` of the next three.
    needle_radius_mm : float, default: 0.635
        Of the needle's shaft; by default that of an 18 gauge trocar.
    process_zone_mm : float, default: 3.0
        How far around it tissue tears and is spread: the default load is smoothed over both together.
    build_up_mm : float, default: 30.0
        Depth below the skin over which the cutting force builds up, from nothing at first touch.
    load_at : {"deformed", "undeformed"}, default: "deformed"
        A load acts on the tissue that the needle is in, which each step asks of the field before it; or on
        what was there before any tissue moved, as a linear reference has it.
    nodes : int or Grid, optional
        Nodes of the solver's grid, about, or that grid; by default as many as resolve the load, 15,625 to 50,000.
        Over cells longer than 1.25 widths of the default load it is widened to 0.8 of them.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        As for :class:`ElasticSolver`.
    walls : {"pinned", "continued"}, default: "pinned"
        Whether the tissue's pinned faces do not move, or as far as tissue beyond them would let them: for crops.
    tolerance : float, default: 0.0125
        Error estimate, relative to the field, at which a step ends.
    budget : int, default: 12
        Iterations of a step, at most.
    contact : {"pose", "track"}, default: "pose"
        Forces of the needle's pose alone; or those that follow from the track it has left, with friction that
        remembers, membranes, and cutting only while it advances (see :mod:`sonospline.contact`).
    grip : bool, default: True
        Whether tissue holds the shaft of a needle sideways, too, where ``contact`` is its track.
    reuse : float, default: 0.6
        Friction in a track that the tip has left, over that of a fresh one; assumed.
    relaxation : {"none", "tissue"}, default: "none"
        Whether tissue relaxes in time, by the ``relaxation_exponent`` of its materials; with ``contact="track"``. With
        the last needle its past leaves, too: a body without a needle is at rest.

    Raises
    ------
    ValueError
        As :class:`ElasticSolver`, or a tolerance or budget out of range.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.elastic import ElasticModel
    >>> from sonospline.mechanics import labelled_cube
    >>> tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    >>> model = ElasticModel(tissue, labelled_cube("layers", side=100, stiffness_kpa=10), nodes=13**3)
    >>> needles = {"biopsy": ss.Needle((0, 40, 50), (60, 40, 50)), "probe": ss.Needle((0, 70, 50), (30, 70, 50))}
    >>> response = model.step(model.rest, needles)
    >>> round(response.forces["biopsy"].axial_n, 1), round(response.forces["probe"].axial_n, 1)
    (2.5, 1.6)
    """

    name = "elastic"
    capabilities = ABLE

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap,
        load: Load | None = None,
        *,
        needle_radius_mm: float = NEEDLE_RADIUS_MM,
        process_zone_mm: float = PROCESS_ZONE_MM,
        build_up_mm: float = BUILD_UP_MM,
        load_at: str = "deformed",
        nodes: int | Grid | None = None,
        integration: str = "mean_dilatation",
        walls: str = "pinned",
        tolerance: float = TOLERANCE,
        budget: int = BUDGET,
        contact: str = "pose",
        grip: bool = True,
        reuse: float = REUSE,
        relaxation: str = "none",
    ) -> None:
        super().__init__(tissue)
        _validate.choice("load_at", load_at, LOAD_AT)
        self.tissues = material if isinstance(material, TissueMap) else None
        check_material(material)
        needle = {"needle_radius_mm": needle_radius_mm, "process_zone_mm": process_zone_mm, "build_up_mm": build_up_mm}
        self.force = default_load(material, **needle) if load is None else check_force(load)
        """What a needle does, as it was asked for; :attr:`load` is what the solver's cells can take of it."""
        if nodes is None:
            nodes = nodes_resolving(tissue.grid, self.force.finest_length / RESOLVED, most=_MOST_NODES)
        self.solver = ElasticSolver(tissue, material, nodes=nodes, integration=integration, walls=walls)
        _ = self.solver.safety  # takes half a hundred iterations where tissues differ: not in the first frame
        used = self._resolved() if load is None else self.force
        self.tolerance = _validate.number("tolerance", tolerance, positive=True)
        self.budget = _validate.count("budget", budget)
        loads = NeedleLoads(self.solver.nodes, self.solver.free, used, load_at)
        self._in_pose = NeedlesInPose(self.solver, loads, self.tolerance, self.budget)
        self._in_time: NeedlesInTime | None = None
        relaxes = _validate.choice("relaxation", relaxation, RELAXATIONS) == "tissue"
        if _validate.choice("contact", contact, CONTACTS) == "track":
            medium = Medium(self.solver, self.load.finest_length, _validate.number("reuse", reuse))
            relaxing = RelaxingSolver(self.solver, None if relaxes else PronySeries())
            self._in_time = NeedlesInTime(medium, relaxing, self.tolerance, self.budget, _validate.flag("grip", grip))
        elif relaxes:
            raise ValueError("relaxation = 'tissue' is for needles that leave a track; give contact = 'track', too")

    @property
    def load(self) -> Load:
        """What a needle does: as it was asked for, or as wide as the solver's cells resolve."""
        return self._in_pose.loads.load

    def _resolved(self) -> Load:
        """A load narrower than 0.8 of a cell would move its tip by more or less as it lies in the cell."""
        least = RESOLVED * max(self.solver.grid.spacing)
        return self.force.widened(least) if isinstance(self.force, LineLoad) else self.force

    @property
    def rest(self) -> State:
        """The state without a needle."""
        return ElasticTissueState(self.identity, solution=self.solver.rest)

    def _before(self, state: State) -> GridField | None:
        assert isinstance(state, ElasticTissueState)
        return self.solver.field(state.solution) if self.tissues is not None and self.tissues.has_fragments else None

    def _options(self) -> tuple[Any, ...]:
        solver = self.solver
        how: tuple[Any, ...] = solver.integration, self.load, self._in_pose.loads.at, self.tolerance, self.budget
        if self._in_time is not None:
            how = *how, "track", self._in_time.grip, self._in_time.medium.reuse, bool(self._in_time.tissue.times_s)
        if solver.walls != "pinned":
            how = *how, solver.walls
        return solver.material, solver.grid, *how

    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        assert isinstance(state, ElasticTissueState)
        if not needles:
            return self._response(ElasticTissueState(self.identity, solution=self.solver.rest), {})
        if not np.isfinite(state.solution.displacement.sum()):
            raise NotConvergedError("the state's displacement is not finite; the last field is kept")
        if self._in_time is not None:
            return self._answer_in_time(self._in_time, state, needles, dt)
        return self._loaded(self._in_pose.step(state, needles))

    def _answer_in_time(
        self, in_time: NeedlesInTime, state: ElasticTissueState, needles: dict[str, Needle], dt: float
    ) -> Response:
        held = needles == dict(state.needles)
        if held and self._rests(state):
            return self._tracked(state, ())
        return self._stepped(in_time, state, needles, dt, looks=int(held))

    def _stepped(
        self, in_time: NeedlesInTime, state: ElasticTissueState, needles: dict[str, Needle], dt: float, looks: int
    ) -> Response:
        before = state.tissue or in_time.tissue.rest
        earlier = before.solution.displacement if state.earlier is None else state.earlier
        found = in_time.step(before, dict(state.needles), dict(state.tracks), needles, dt, earlier)
        after = ElasticTissueState(
            self.identity, tuple(needles.items()), solution=found.tissue.solution, tracks=tuple(found.tracks.items()),
            tissue=found.tissue, beside=found.error, earlier=found.earlier, looks=looks)  # fmt: skip
        return self._tracked(after, found.events)

    def _tracked(self, state: ElasticTissueState, events: tuple[object, ...]) -> Response:
        forces = {name: force_of(track, dict(state.needles)[name]) for name, track in state.tracks}
        return replace(self._response(state, forces), events=events)

    def held(self, state: State, name: str, start: Needle, end: Needle) -> Held | None:
        """Return what keeps a needle of a state from turning from one pose to another; None where nothing does."""
        own = self._own(state)
        track = dict(own.tracks).get(name)
        return None if self._in_time is None else self._in_time.held(name, track, own.solution, start, end)

    def settle(self, response: Response, *, tolerance: float = 5e-3) -> Response:
        """Return a response of the same pose whose error estimate is at most ``tolerance``, its load on the needle.

        Raises
        ------
        ValueError
            A response of another model, or a tolerance below 1e-6.
        NotConvergedError
            It does not get there.
        """
        state = self._own(response.state)
        if self._in_time is not None:
            return self._at_rest(self._in_time, response, tolerance)
        return self._loaded(self._in_pose.settled(state, tolerance))

    def _at_rest(self, in_time: NeedlesInTime, response: Response, tolerance: float) -> Response:
        """A response some steps on at the same poses, with what happened on the way."""
        events = response.events
        for _ in range(MOST_ROUNDS):
            if (response.error_estimate or 0.0) <= tolerance:
                break
            assert isinstance(response.state, ElasticTissueState)
            response = self._stepped(in_time, response.state, dict(response.state.needles), 0.0, looks=1)
            events = *events, *response.events
        if (response.error_estimate or 0.0) > tolerance:
            raise NotConvergedError(
                f"the error estimate is {response.error_estimate:.1e} after {MOST_ROUNDS} steps, above tolerance = "
                f"{tolerance:g}; allow a larger one"
            )
        return replace(response, events=events)

    def _loaded(self, found: Loaded) -> Response:
        loading, loads = found.loading, self._in_pose.loads
        state = ElasticTissueState(
            self.identity, tuple(loading.needles.items()), solution=found.solution, looks=found.looks,
            shafts=tuple(loading.shafts.items()), beside=found.beside)  # fmt: skip
        forces = {
            name: NeedleForce.along(
                loading.needles[name].direction, force / MILLI, whole_n=loading.nodal[name].whole / MILLI
            )
            for name, force in loads.forces(loading).items()
        }
        return self._response(state, forces)

    def snapshot(self, response: Response, needle: str) -> FrozenContact:
        """Return what holds a needle in a response, for a force loop that goes on without the tissue.

        Raises
        ------
        ValueError
            A response of another model, a needle that is not in it, or needles that leave no track.
        """
        state = self._own(response.state)
        if self._in_time is None:
            raise ValueError("contact = 'pose' leaves nothing that holds a needle; make the model with contact='track'")
        name, tracks = _validate.choice("needle", needle, dict(state.tracks)), dict(state.tracks)
        return frozen(self._in_time.medium, tracks[name], dict(state.needles)[name], state.solution.displacement)

    def grid_error(self, response: Response) -> GridError | None:
        """Return the error that the solver's cells leave in a response: measured, as some steps on a coarser grid cost.

        None where cells of twice the sides cannot tell bone from what moves, and in tissue that relaxes, whose past the
        coarser grid does not share.

        Raises
        ------
        NotConvergedError
            The coarser grid's field was not found.
        """
        state = self._own(response.state)
        assert isinstance(response.field, GridField)
        if not state.needles:
            return GridError(0.0, 0.0)
        if self._coarser is None or (self._in_time is not None and self._in_time.tissue.times_s):
            return None
        return grid_error(response.field, self._coarser, *self._load_on(self._coarser, state))

    def _load_on(self, solver: ElasticSolver, state: ElasticTissueState) -> tuple[Single, Array]:
        """The load of a state on the nodes of a solver, and the undeformed places (n, 3) of the needles' tips."""
        needles, shafts, tracks = dict(state.needles), dict(state.shafts), dict(state.tracks)
        if self._in_time is not None:
            on = replace(self._in_time, medium=replace(self._in_time.medium, solver=solver))
            return on.forces(tracks, needles), np.stack([track.end @ track.places for track in tracks.values()])
        load = NeedleLoads(solver.nodes, solver.free, self.load, self._in_pose.loads.at).acting(needles, shafts)
        tips = [shafts[name].places[-1] if name in shafts else needle.tip for name, needle in needles.items()]
        return load.total, np.stack(tips)

    @cached_property
    def _coarser(self) -> ElasticSolver | None:
        return self.solver.coarser(max(125, self.solver.grid.node_count // 8))

    def facts(self, response: Response) -> dict[str, Any]:
        """The solver's grid, the range of stiffness, the errors, and where the strain is largest."""
        assert isinstance(response.field, GridField)
        strain, moduli = largest_strain(response.field), self.solver.moduli
        of_cells, at_tip = self.grid_error(response) or (None, None)
        young = moduli.shear * (3 * moduli.lame + 2 * moduli.shear) / (moduli.lame + moduli.shear)
        return {
            "solver_shape": self.solver.grid.shape,
            "walls": self.solver.walls,
            "young_kpa": [float(young.min()), float(young.max())],
            "error_estimate": response.error_estimate,
            "grid_error": of_cells,
            "grid_error_at_tip": at_tip,
            "load_width_mm": self.load.finest_length,
            "load_width_asked_mm": self.force.finest_length,
            "largest_strain": strain.largest,
            "largest_strain_ras_mm": strain.place.tolist(),
            "small_strain": strain.small,
            "theory_error": strain.theory_error._asdict(),
        }

    def _response(self, state: ElasticTissueState, forces: Mapping[str, NeedleForce]) -> Response:
        solution, error = state.solution, state.solution.error + state.beside
        return Response(
            state=state,
            field=replace(self.solver.field(solution), error_estimate=error),
            forces=forces,
            error_estimate=error,
            settled=self._rests(state),
        )

    def _own(self, state: State) -> ElasticTissueState:
        """A state, checked to be of this model."""
        self._check_state(state)
        assert isinstance(state, ElasticTissueState)
        return state

    def _rests(self, state: ElasticTissueState) -> bool:
        """Whether further steps at the same poses change nothing to speak of."""
        solution = state.solution
        if self._in_time is not None and state.needles:
            # In the first step that a needle is held friction may still be that of its speed.
            relaxes = bool(self._in_time.tissue.times_s)
            return state.looks > 0 and solution.error + state.beside <= _STILL and not relaxes
        return self._in_pose.rests(state)
