"""Model parameters from a TOML file and from ``--set NAME=VALUE``."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from ..interaction import NeedleTissueModel

NAMES = tuple(field.name for field in fields(NeedleTissueModel))


def apply(model: NeedleTissueModel, file: Path | None, settings: Sequence[str]) -> NeedleTissueModel:
    """Return the model with the file's parameters, then each NAME=VALUE, in its place (mm)."""
    changes: dict[str, Any] = {}
    if file is not None:
        changes.update(_known("--parameters", _load(file)))
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise ValueError(f"--set {setting!r} is not NAME=VALUE; write e.g. shaft_displacement=2.5")
        changes.update(_known("--set", {name.strip(): value}))
    return replace(model, **changes)


def _load(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"--parameters {str(file)!r} cannot be read ({error}); give a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"--parameters {str(file)!r} is not TOML ({error}); write NAME = VALUE lines") from None


def _known(option: str, changes: dict[str, Any]) -> dict[str, Any]:
    for name in changes:
        if name not in NAMES:
            raise ValueError(f"{option} names an unknown parameter {name!r}; use one of {', '.join(NAMES)}")
    return changes
