"""The one table of tissue models: those of this package, and those that other packages add.

Another package adds a model through an entry point of the group ``sonospline.models`` that
names a :class:`ModelSpec`.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from .. import _validate
from .._shown import shown
from .capability import CAPABILITIES, CapabilityError
from .option import Option

GROUP = "sonospline.models"
"""Entry points by which packages add models."""
BUILT_IN = (
    "sonospline.models.spline.spec:SPEC",
    "sonospline.models.kelvinlet.spec:SPEC",
    "sonospline.models.elastic.spec:SPEC",
)

_LONGEST = 200
"""Characters of what is said about a package's failure."""

logger = logging.getLogger(__name__)

_table: dict[str, ModelSpec] = {}
_lock = threading.RLock()
_complete = False


@dataclass(frozen=True, kw_only=True)
class ModelSpec:
    """A model of tissue, as whoever offers it knows it.

    Parameters
    ----------
    name : str
        What it is called in programs, files and on the command line.
    title : str
        What people read.
    summary : str
        What it is, in a line.
    maker : callable
        ``maker(tissue, materials, **options)`` makes the :class:`TissueModel`; ``materials`` is a Material, or a
        TissueMap where the model knows ``"labels"``.
    options : tuple of Option
        What can be chosen about it.
    capabilities : frozenset of str
        What it can do, of :data:`~sonospline.models.CAPABILITIES`.
    properties : tuple of str
        Those of homogeneous tissue that its answer depends on: ``stiffness_kpa``, ``poissons_ratio``.
    reports_progress : bool, default: False
        Whether the maker takes ``progress(done, of)`` too, because it may take seconds.

    Raises
    ------
    ValueError
        A name that is no word, a maker that cannot be called, an unknown capability, two options of one name.
    """

    name: str
    title: str
    summary: str
    maker: Callable[..., Any]
    options: tuple[Option, ...] = ()
    capabilities: frozenset[str] = frozenset()
    properties: tuple[str, ...] = ()
    reports_progress: bool = False

    def __repr__(self) -> str:
        able = ", ".join(sorted(self.capabilities)) or "poses alone"
        return f"ModelSpec({self.name}, {able}; options {', '.join(option.name for option in self.options) or 'none'})"

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.replace("-", "_").isidentifier()):
            raise ValueError(f"name = {shown(self.name)} is not a word; give letters, digits, - and _")
        if not callable(self.maker):
            raise ValueError(f"maker = {shown(self.maker)} cannot be called; give maker(tissue, materials, **options)")
        for text in ("title", "summary"):
            if not isinstance(getattr(self, text), str):
                raise ValueError(f"{text} = {shown(getattr(self, text))} is no text; give a line of it")
        object.__setattr__(self, "capabilities", frozenset(self.capabilities))
        object.__setattr__(self, "options", tuple(self.options))
        for option in self.options:
            if not isinstance(option, Option):
                raise ValueError(f"options has {shown(option)}, which is not an Option; make one")
        for capability in self.capabilities:
            _validate.choice("capabilities", capability, CAPABILITIES)
        names = [option.name for option in self.options]
        if len(set(names)) < len(names):
            raise ValueError(f"options = {', '.join(names)} name one twice; give each a name of its own")

    def option(self, name: str) -> Option:
        """Return an option by its name.

        Raises
        ------
        ValueError
            The model has none of that name.
        """
        for option in self.options:
            if option.name == name:
                return option
        known = ", ".join(option.name for option in self.options) or "none"
        raise ValueError(f"{name} is no option of model = {self.name!r}; it has {known}")

    def check(self, options: dict[str, Any]) -> dict[str, Any]:
        """Return every option's value, checked: as given, or its default."""
        given = {name: self.option(name).check(value) for name, value in options.items()}
        return {option.name: given.get(option.name, option.default) for option in self.options}


def register(spec: ModelSpec) -> None:
    """Add a model to the table, for this process.

    Raises
    ------
    ValueError
        Not a ModelSpec, or its name is taken.
    """
    with _lock:
        _discover()
        _add(spec)


def names() -> tuple[str, ...]:
    """Return the names of all models.

    Examples
    --------
    >>> from sonospline import models
    >>> models.names()[:2]
    ('paper', 'kelvinlet')
    """
    return tuple(_discover())


def spec(name: str) -> ModelSpec:
    """Return what the table knows of a model.

    Raises
    ------
    ValueError
        No model has the name.
    """
    table = _discover()
    return table[_validate.choice("model", name, table)]


def titles() -> dict[str, str]:
    """Return what people read for the name of each model."""
    return {name: known.title for name, known in _discover().items()}


def able(*capabilities: str) -> tuple[str, ...]:
    """Return the names of the models that can do all of the capabilities."""
    return tuple(name for name, known in _discover().items() if known.capabilities.issuperset(capabilities))


def require(name: str, capability: str) -> None:
    """Raise CapabilityError where a model cannot do something, naming those that can."""
    if capability not in spec(name).capabilities:
        raise CapabilityError(name, capability, able(capability))


def _discover() -> dict[str, ModelSpec]:
    """The table; the first to ask reads the models of this package and of others."""
    global _complete
    with _lock:
        if not _complete:
            for place in BUILT_IN:
                module, attribute = place.split(":")
                _add(getattr(import_module(module), attribute))
            for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
                _add_from(entry)
            _complete = True
    return _table


def _add_from(entry: EntryPoint) -> None:
    """Add a package's model; one that fails is left out, and said, and hurts no other."""
    try:
        _add(entry.load())
    except (Exception, SystemExit) as error:  # whatever another package raises
        problem = f"{type(error).__name__}: {error}".splitlines()[0][:_LONGEST]
        logger.warning("model %r of %s is left out (%s)", entry.name, entry.value, problem)


def _add(spec: ModelSpec) -> None:
    if not isinstance(spec, ModelSpec):
        raise ValueError(f"spec = {shown(spec)} is not a ModelSpec; make one")
    if spec.name in _table:
        raise ValueError(f"name = {spec.name!r} is taken by another model; choose one of your own")
    _table[spec.name] = spec
