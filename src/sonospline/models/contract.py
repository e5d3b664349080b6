"""The contract of every model of tissue: needles and time go in, a response comes out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .._digest import digest
from .._shown import shown
from ..fields.field import Field
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from . import registry
from .capability import CapabilityError

Array = NDArray[np.float64]
Needles = Mapping[str, Needle] | Iterable[tuple[str, Needle]]
Named = tuple[tuple[str, Needle], ...]

NO_NEEDLES: Mapping[str, Needle] = MappingProxyType({})


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

    Examples
    --------
    >>> from sonospline.models import NeedleForce
    >>> NeedleForce.along((0, 0, 1), [0.0, 0.0, 2.5])
    NeedleForce(axial_n=2.5, force_n=(0, 0, 2.5))
    """

    axial_n: float
    force_n: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "axial_n", _validate.real("axial_n", self.axial_n))
        object.__setattr__(self, "force_n", _validate.vector("force_n", self.force_n))

    @classmethod
    def along(cls, direction: ArrayLike, force_n: ArrayLike) -> NeedleForce:
        """Return the force of a needle that points in a direction, a unit vector."""
        return cls(float(np.dot(direction, force_n)), np.asarray(force_n, float))

    def __repr__(self) -> str:
        parts = ", ".join(f"{part:.4g}" for part in self.force_n)
        return f"NeedleForce(axial_n={self.axial_n:.4g}, force_n=({parts}))"


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
    events : tuple of str
        What happened in the step.
    error_estimate : float, optional
        Error of the field relative to the field, where the model knows it.
    settled : bool, default: True
        Whether another step at the same pose would change nothing to speak of.
    """

    state: State
    field: Field
    forces: Mapping[str, NeedleForce]
    events: tuple[str, ...] = ()
    error_estimate: float | None = None
    settled: bool = True

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
        grid = self.tissue.grid
        box = (grid.shape, grid.spacing, grid.origin, grid.direction, self.tissue.entry_face)
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
            Every needle in the tissue, in world coordinates; none is a needle taken out.
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
            tissue, a dt below zero or not finite.
        CapabilityError
            Several needles, and the model knows one.
        """
        self._check_state(state)
        named = self._check_needles(needles)
        return self._answer(state, dict(named), _validate.number("dt", dt))

    def facts(self, response: Response) -> dict[str, Any]:
        """Return what a summary says of a response: numbers, texts and lists of them, by name."""
        return {}

    @abstractmethod
    def _answer(self, state: State, needles: dict[str, Needle], dt: float) -> Response:
        """Answer to arguments that are checked; needles come in the order of their names."""

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
        named = _named(needles)
        if len(named) > 1 and "several needles" not in self.capabilities:
            able = registry.able("several needles")
            raise CapabilityError(self.name, "several needles", able, f"{len(named)} are given")
        for name, needle in named:
            where = "" if len(named) == 1 else f" of needle {name!r}"
            self.tissue.check_inside(**{f"entry{where}": needle.entry, f"tip{where}": needle.tip})
        return named

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.tissue!r})"


def _named(needles: Needles) -> Named:
    """The needles by name, in the order of their names: sums over them have the same bits in any order."""
    if isinstance(needles, Needle):
        raise ValueError('needles = a Needle has no name; give {"needle": needle}')
    try:
        pairs = [(name, needle) for name, needle in (needles.items() if isinstance(needles, Mapping) else needles)]
    except (TypeError, ValueError):
        raise ValueError(f'needles = {shown(needles)} has no names; give {{"needle": Needle(entry, tip)}}') from None
    seen: dict[str, Needle] = {}
    for name, needle in pairs:
        if not isinstance(name, str) or not isinstance(needle, Needle):
            raise ValueError(f'needles has {shown(name)}: {shown(needle)}; give {{"needle": Needle(entry, tip)}}')
        if name in seen:
            raise ValueError(f"needles has two named {name!r}; give each a name of its own")
        seen[name] = needle
    return tuple(sorted(seen.items(), key=lambda pair: pair[0]))
