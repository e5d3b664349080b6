"""Model parameters to and from a TOML file, and from ``--set NAME=VALUE``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from .. import _validate
from ..io.files import read_text
from ..io.toml_text import TomlError, loads
from ..models.spline.interaction import NeedleTissueModel

_LONGEST_MM = 1e6

NAMES = tuple(field.name for field in fields(NeedleTissueModel))


def apply(model: NeedleTissueModel, file: Path | None, settings: Sequence[str], side: float) -> NeedleTissueModel:
    """Return the model with the file's parameters, then each NAME=VALUE, in its place (mm).

    A file that says ``unit = "side"`` gives its lengths in sides of the tissue, here of
    ``side`` mm; without it, or with ``unit = "mm"``, they are in mm.
    """
    changes: dict[str, Any] = {}
    if file is not None:
        changes.update(_in_mm(_load(file), side))
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise ValueError(f"--set {setting!r} is not NAME=VALUE; write e.g. shaft_displacement=2.5")
        changes.update(_known("--set", {name.strip(): value}))
    for name, value in changes.items():
        if _validate.number(name, value) > _LONGEST_MM:
            raise ValueError(f"{name} = {value} is out of range; give at most {_LONGEST_MM:g} mm")
    return replace(model, **changes)


def text(model: NeedleTissueModel, remarks: Sequence[str]) -> str:
    """Return the parameter file of a model of the unit cube, for a tissue of any side, under some remarks."""
    lines = [f"# {remark}" for remark in remarks]
    values = [f"{name} = {getattr(model, name)!r}" for name in NAMES]
    return "\n".join([*lines, 'unit = "side"', *values, ""])


def _in_mm(content: dict[str, Any], side: float) -> dict[str, Any]:
    unit = _validate.choice("--parameters: unit", content.pop("unit", "mm"), ("mm", "side"))
    changes = _known("--parameters", content)
    if unit == "mm":
        return changes
    return {name: _validate.number(name, value) * side for name, value in changes.items()}


def _load(file: Path) -> dict[str, Any]:
    try:
        return loads(read_text(file, "--parameters", "a TOML file"))
    except TomlError as error:
        raise ValueError(f"--parameters {str(file)!r} is not TOML ({error}); write NAME = VALUE lines") from None


def _known(option: str, changes: dict[str, Any]) -> dict[str, Any]:
    for name in changes:
        if name not in NAMES:
            raise ValueError(f"{option} names an unknown parameter {name!r}; use one of {', '.join(NAMES)}")
    return changes
