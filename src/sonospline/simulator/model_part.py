"""The ``[model]`` table of a scene file: its keys are those of the models that the registry knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import defstruct

from ..io.records import Record, about
from ..models import registry
from ..models.option import Option


def _key(name: str, options: list[Option]) -> tuple[str, Any, Any]:
    """The key of an option that one model has, or several; None leaves it to the model."""
    option, *others = options
    low, high = option.live or (None, None)
    number = {"whole": int, "number": float}.get(option.kind)
    kind: Any = Literal[option.choices] if number is None else number
    described = Annotated[kind, about(option.help, low, high) if number else about(option.help)]
    if others or option.default is None:
        return name, described | None, None
    return name, described, option.default


def _safe(option: Option) -> bool:
    """Whether a scene file, which strangers may send, may give an option: a number in a range, or one of its words."""
    return option.live is not None or option.kind == "choice"


def _model_part() -> Any:
    options: dict[str, list[Option]] = {}
    for option in (option for name in registry.names() for option in registry.spec(name).options if _safe(option)):
        options.setdefault(option.name, []).append(option)
    keys: list[Any] = [
        ("use", Annotated[Literal[registry.names()], about("the model at the start")], "elastic"),
        ("poissons_ratio", Annotated[float, about("of homogeneous tissue", low=0.0, high=0.49)], 0.45),
        *(_key(name, shared) for name, shared in options.items()),
    ]
    names = {"__doc__": "How the tissue answers.", "__module__": __name__}
    return defstruct("ModelPart", keys, bases=(Record,), namespace=names, frozen=True, kw_only=True)


if TYPE_CHECKING:
    from .tissue_settings import Contact, Relaxation

    class ModelPart(Record, frozen=True, kw_only=True):
        """How the tissue answers: the model, and every option of the registry's models that scenes may give."""

        use: str = "elastic"
        poissons_ratio: float = 0.45
        contact: Contact = "pose"
        relaxation: Relaxation = "none"
else:
    ModelPart = _model_part()
