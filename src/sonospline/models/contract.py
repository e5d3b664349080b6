"""The contract of every model of tissue: needles and time go in, a response comes out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .._digest import digest
from .._shown import shown
from ..contact.events import Held
from ..fields.field import Field
from ..geometry.needle import Needle
from ..geometry.needles import NO_NEEDLES, Named, Needles, named
from ..geometry.tissue import Tissue
from ..mechanics.bone_stop import Blocked, stopped
from ..mechanics.tissue_map import TissueMap
from . import registry
from .capability import CapabilityError

Array = NDArray[np.float64]

_PRINTED = 1e-4
"""Of a force: less of it that is lost is not worth a word."""


@dataclass(frozen=True)
class Identity:
    """Which model a state belongs to: another one that answers alike, made elsewhere, has the same."""

    model: str
    shape: tuple[int, int, int]
    options: str
    """Digest of the tissue's box and of what the answer depends on."""

    def __str__(self) -> str:
        return f"model {self.model!r} on {' x '.join(map(str, self.shape))} nodes"


@dataclass(frozen=True, eq=False, repr=False)
class State(ByBits):
    """Where the tissue is between two steps: immutable, picklable, equal where every bit is.

    Models of which the answer depends on the pose alone use it as it is; others extend it by
    what they remember, in arrays that are read-only.

    Parameters
    ----------
    model : Identity
        Whose it is.
    needles : tuple of (str, Needle)
        Those in the tissue, by name.
    """

    model: Identity
    needles: Named = ()

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}: {needle.depth:.4g} deep" for name, needle in self.needles) or "no needle"
        return f"{type(self).__name__}({self.model}, {inside})"


@dataclass(frozen=True, eq=False)
class NeedleForce(ByBits):
    """The force of a needle on the tissue: what the nodes of the model take up.

    Parameters
    ----------
    axial_n : float
        Along the needle, from entry to tip, N.
    force_n : (3,) array_like
        The whole of it along the world's axes, N.
    lost_n : float, default: 0.0
        Along the needle, N, what of the load moves no tissue: it lies beyond a pinned wall, or acts on what
        a wall or bone holds. It is not in ``axial_n``; both together are the load's whole.
    moment_nmm : (3,) array_like, default: 0
        About the tip, along the world's axes, N mm: of forces across the needle, where a model knows them.

    Examples
    --------
    >>> from sonospline.models import NeedleForce
    >>> NeedleForce.along((0, 0, 1), [0.0, 0.0, 2.5])
    NeedleForce(axial_n=2.5, force_n=(0, 0, 2.5))
    """

    axial_n: float
    force_n: Array
    lost_n: float = 0.0
    moment_nmm: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "axial_n", _validate.real("axial_n", self.axial_n))
        object.__setattr__(self, "force_n", _validate.vector("force_n", self.force_n))
        object.__setattr__(self, "lost_n", _validate.real("lost_n", self.lost_n))
        object.__setattr__(self, "moment_nmm", _validate.vector("moment_nmm", self.moment_nmm))

    @classmethod
    def along(
        cls,
        direction: ArrayLike,
        force_n: ArrayLike,
        *,
        whole_n: float | None = None,
        moment_nmm: ArrayLike = (0.0, 0.0, 0.0),
    ) -> NeedleForce:
        """Return the force of a needle that points in a direction, a unit vector; and what of its load is lost."""
        axial = float(np.dot(direction, force_n))
        lost = 0.0 if whole_n is None else whole_n - axial
        return cls(axial, np.asarray(force_n, float), lost, np.asarray(moment_nmm, float))

    @property
    def lateral_n(self) -> float:
        """Across the needle, N."""
        return float(np.sqrt(max(float(self.force_n @ self.force_n) - self.axial_n**2, 0.0)))

    def at(self, lever_mm: ArrayLike) -> Array:
        """Return the moment (3,) about another point, so far (3,) from the tip, N mm: such as the needle's hub."""
        result: Array = self.moment_nmm - np.cross(np.asarray(lever_mm, float), self.force_n)
        return result

    def __repr__(self) -> str:
        parts = ", ".join(f"{part:.4g}" for part in self.force_n)
        lost = f", lost_n={self.lost_n:.2g}" if abs(self.lost_n) > _PRINTED * abs(self.axial_n) else ""
        return f"NeedleForce(axial_n={self.axial_n:.4g}, force_n=({parts}){lost})"


class UnknownForces(Mapping[str, NeedleForce]):
    """The forces of a model that knows none: empty, and whoever asks for one learns which models do."""

    def __init__(self, model: str) -> None:
        self._model = model

    def __getitem__(self, name: str) -> NeedleForce:
        raise CapabilityError(self._model, "forces", registry.able("forces"))

    def __contains__(self, name: object) -> bool:
        return False

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0

    def __repr__(self) -> str:
        return f"UnknownForces({self._model!r})"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Response:
    """What tissue answers to a step.

    Parameters
    ----------
    state : State
        Where it is now; the next step starts from it.
    field : Field
        Its displacement.
    forces : mapping of str to NeedleForce
        Of each needle on it. Empty, and an error for whoever asks, where the model knows none.
    events : tuple
        What happened in the step: a :class:`~sonospline.mechanics.Blocked` for each needle that rests on bone, and
        whatever a model adds.
    error_estimate : float, optional
        Error of the field relative to the field, where the model knows it.
    settled : bool, default: True
        Whether another step at the same pose would change nothing to speak of.
    """

    state: State
    field: Field
    forces: Mapping[str, NeedleForce]
    events: tuple[object, ...] = ()
    error_estimate: float | None = None
    settled: bool = True

    @property
    def blocked(self) -> Mapping[str, Blocked]:
        """Which needles rest on bone, and on which."""
        return {event.needle: event for event in self.events if isinstance(event, Blocked)}

    def __repr__(self) -> str:
        error = "" if self.error_estimate is None else f", error_estimate={self.error_estimate:.2g}"
        events = f", events={self.events}" if self.events else ""
        forces = "".join(f", {name}: {force.axial_n:.4g} N" for name, force in self.forces.items())
        return f"Response({self.state!r}{forces}{events}{error}, settled={self.settled})"


class TissueModel(ABC):
    """A model of tissue: what needles in it, and time, do to it.

    Functional: a step never changes the state it is given, and nothing hidden in a model
    changes the bits of an answer. Undo, replay, branching, and a step that fails and leaves
    everything as it was follow from that. A model may be shared by threads.

    A model of your own gives :attr:`name` and :meth:`_answer`, and :meth:`_options` where it has
    any; docs/own_model.md shows one.

    Parameters
    ----------
    tissue : Tissue
        The box, its display grid and its free face.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline import models
    >>> model = models.make("kelvinlet", ss.Tissue(ss.Grid.unit_cube(25)))
    >>> first = model.step(model.rest, {"needle": ss.Needle((0, .5, .5), (.3, .5, .5))})
    >>> then = model.step(first.state, {"needle": ss.Needle((0, .5, .5), (.6, .5, .5))}, dt=0.1)
    >>> then.settled, then.state == first.state, model.step(then.state, {}).state == model.rest
    (True, False, True)
    """

    name: str
    """As the registry knows it."""
    capabilities: ClassVar[frozenset[str]] = frozenset()
    """What it can do, of :data:`~sonospline.models.CAPABILITIES`."""
    tissues: TissueMap | None = None
    """What it is made of, where that has labels: no needle is loaded beyond the surface of a bone."""

    def __init__(self, tissue: Tissue) -> None:
        if not isinstance(tissue, Tissue):
            raise ValueError(f"tissue = {shown(tissue)} is not a Tissue; make one, e.g. Tissue(Grid.unit_cube(53))")
        self.tissue = tissue

    @property
    def title(self) -> str:
        """The name as people read it."""
        return registry.spec(self.name).title if self.name in registry.names() else self.name

    @cached_property
    def identity(self) -> Identity:
        """What its states are known by."""
        grid, tissue = self.tissue.grid, self.tissue
        box = (grid.shape, grid.spacing, grid.origin, grid.direction, tissue.entry_face, tissue.pinned_faces)
        return Identity(self.name, grid.shape, digest(type(self).__qualname__, box, self._options()))

    @property
    def rest(self) -> State:
        """The state without a needle."""
        return State(self.identity)

    def step(self, state: State, needles: Needles = NO_NEEDLES, dt: float = 0.0) -> Response:
        """Return what the tissue answers to needles at their poses, some time after a state.

        Parameters
        ----------
        state : State
            Where the tissue is: :attr:`rest`, or the state of an earlier response. It is not changed.
        needles : mapping of str to Needle, or pairs of them
            Every needle in the tissue, in world coordinates; none is a needle taken out. One that meets bone ends
            there: the response's state has it, and ``response.blocked`` says so.
        dt : float, default: 0.0
            Seconds since the state. Zero asks for the quasi-static answer of the pose alone, which
            is the only one that models without ``"time"`` know.

        Returns
        -------
        Response
            It depends on the arguments alone.

        Raises
        ------
        ValueError
            A state of another model or another grid, two needles of one name, a needle outside the
            tissue or with its entry in bone, a dt below zero or not finite.
        CapabilityError
            Several needles, and the model knows one.
        """
        self._check_state(state)
        dt = _validate.number("dt", dt)
        inside, events = stopped(dict(self._check_needles(needles)), self.tissues, self._before(state))
        response = self._answer(state, dict(inside), dt)
        return replace(response, events=(*events, *response.events)) if events else response

    def held(self, state: State, name: str, start: Needle, end: Needle) -> Held | None:
        """Return what keeps a needle of a state from turning from one pose to another; None where nothing does.

        Only models whose needles leave tracks know of it; a step takes the poses that it is given.
        """
        return None

    def facts(self, response: Response) -> dict[str, Any]:
        """Return what a summary says of a response: numbers, texts and lists of them, by name."""
        return {}

    @abstractmethod
    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        """Answer to arguments that are checked; needles come in the order of their names."""

    def _before(self, state: State) -> Field | None:
        """The field of a state, where bone has moved with it; None where it has not."""
        return None

    def _options(self) -> tuple[Any, ...]:
        """What answers depend on besides the tissue: numbers, texts, arrays, dataclasses of them."""
        return ()

    def _check_state(self, state: State) -> None:
        if not isinstance(state, State):
            raise ValueError(f"state = {shown(state)} is not a State; give the model's rest, or a response's state")
        if state.model == self.identity:
            return
        which = self.identity
        alike = str(state.model) == str(which)
        of = f"{state.model} with another box or other options" if alike else str(state.model)
        raise ValueError(f"state is of {of}, not of this {which}; start from this model's rest")

    def _check_needles(self, needles: Needles) -> Named:
        found = named(needles)
        if len(found) > 1 and "several needles" not in self.capabilities:
            able = registry.able("several needles")
            raise CapabilityError(self.name, "several needles", able, f"{len(found)} are given")
        for name, needle in found:
            where = "" if len(found) == 1 else f" of needle {name!r}"
            self.tissue.check_inside(**{f"entry{where}": needle.entry, f"tip{where}": needle.tip})
        return found

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.tissue!r})"
