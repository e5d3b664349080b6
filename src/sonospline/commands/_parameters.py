"""Options of a model to and from a TOML file, and from ``--set NAME=VALUE``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from .. import _validate
from ..io.files import read_text
from ..io.toml_text import TomlError, loads
from ..mechanics.interaction import NeedleTissueModel
from ..models.registry import ModelSpec

NAMES = tuple(field.name for field in fields(NeedleTissueModel))


def read(file: Path, spec: ModelSpec, side: float) -> dict[str, Any]:
    """Return the options of a model that a file gives, checked.

    A file that says ``unit = "side"`` gives its lengths in sides of the tissue, here of
    ``side`` mm; without it, or with ``unit = "mm"``, they are in mm.
    """
    content = _load(file)
    unit = _validate.choice("--parameters: unit", content.pop("unit", "mm"), ("mm", "side"))
    found = {}
    for name, value in content.items():
        option = spec.option(name)
        scaled = unit == "side" and option.unit == "mm"
        found[name] = option.check(_validate.number(name, value) * side if scaled else value)
    return found


def settings(texts: Sequence[str], spec: ModelSpec) -> dict[str, Any]:
    """Return the options of a model that NAME=VALUE texts give, checked."""
    found = {}
    for setting in texts:
        name, equals, value = setting.partition("=")
        if not equals:
            raise ValueError(f"--set {setting!r} is not NAME=VALUE; write e.g. shaft_displacement=2.5")
        found[name.strip()] = spec.option(name.strip()).read(value)
    return found


def text(model: NeedleTissueModel, remarks: Sequence[str]) -> str:
    """Return the parameter file of a model of the unit cube, for a tissue of any side, under some remarks."""
    lines = [f"# {remark}" for remark in remarks]
    values = [f"{name} = {getattr(model, name)!r}" for name in NAMES]
    return "\n".join([*lines, 'unit = "side"', *values, ""])


def _load(file: Path) -> dict[str, Any]:
    try:
        return loads(read_text(file, "--parameters", "a TOML file"))
    except TomlError as error:
        raise ValueError(f"--parameters {str(file)!r} is not TOML ({error}); write NAME = VALUE lines") from None
