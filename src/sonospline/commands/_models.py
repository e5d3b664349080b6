"""The registry's face on the command line: every model's options are flags, and one model is made of them."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.tissue_map import TissueMap
from ..models import maker, registry
from ..models.contract import TissueModel
from ..models.option import Option
from . import _limits, _parameters
from ._progress import bar

LIMITS: _limits.Limits = {"stiffness": _limits.Real(0, 1e9), "poisson": _limits.Real(-1, 0.5)}
"""Where a material itself is stricter, it says so."""
_PROPERTIES = {"stiffness_kpa": "stiffness", "poissons_ratio": "poisson"}
_DEST = "option_{}"
"""Of a model's option among the arguments: it must not take the place of one of the verb's own."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the models, what the tissue is made of, and the options of each model."""
    how = parser.add_argument_group("model")
    how.add_argument("--model", default="paper", choices=registry.names(), help="tissue model (paper)")
    how.add_argument("--parameters", type=Path, metavar="FILE", help="options of the model, TOML")
    how.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="one option of the model")
    tissue = parser.add_argument_group("what the tissue is made of, for models that ask")
    tissue.add_argument("--labels", type=Path, metavar="FILE", help="label image of the tissues")
    tissue.add_argument("--label-names", type=Path, metavar="CSV", help="their names (beside the image, .csv)")
    tissue.add_argument("--materials", type=Path, metavar="TOML", help="their materials (assumed ones)")
    tissue.add_argument("--stiffness", type=float, metavar="KPA", help="without labels (10)")
    tissue.add_argument("--poisson", type=float, metavar="NU", help="Poisson's ratio, without labels (0.45)")
    for name in registry.names():
        spec = registry.spec(name)
        group = parser.add_argument_group(f"--model {name} ({spec.summary})")
        for option in spec.options:
            with suppress(argparse.ArgumentError):  # a flag of an earlier model, or of the verb: --set gives it
                _add_flag(group, option)


def check(args: argparse.Namespace) -> None:
    """Raise ValueError where something is given that the chosen model cannot do or does not heed."""
    spec = registry.spec(args.model)
    for name in registry.names():
        for option in registry.spec(name).options:
            if getattr(args, _DEST.format(option.name), None) is not None and option.name not in _names(spec):
                _refuse(_flag(option), [owner for owner in registry.names() if option.name in _names(owner)], args)
    for key, option_name in _PROPERTIES.items():
        if getattr(args, option_name) is not None and key not in spec.properties:
            heed = [name for name in registry.names() if key in registry.spec(name).properties]
            _refuse(f"--{option_name}", heed, args)
    if args.labels is not None:
        registry.require(args.model, "labels")
    for companion in ("label_names", "materials"):
        if args.labels is None and getattr(args, companion) is not None:
            raise ValueError(f"--{companion.replace('_', '-')} belongs to --labels; give both or neither")
    _given(args, spec)


def read_tissues(args: argparse.Namespace) -> TissueMap | None:
    """Return the labelled tissue that was asked for, if any."""
    if args.labels is None:
        return None
    return TissueMap.read(args.labels, names=args.label_names, materials=args.materials)


def make(args: argparse.Namespace, tissue: Tissue, tissues: TissueMap | None) -> TissueModel:
    """Return the chosen model: options of the file, then of ``--set``, then of flags."""
    spec = registry.spec(args.model)
    file = {} if args.parameters is None else _parameters.read(args.parameters, spec, tissue.grid.side)
    with bar("setting up the model", quiet=args.quiet or not spec.reports_progress) as progress:
        options = {**file, **_given(args, spec)}
        return maker.make(args.model, tissue, tissues or _homogeneous(args), progress=progress, **options)


def _homogeneous(args: argparse.Namespace) -> Material:
    stiffness = maker.DEFAULT_KPA if args.stiffness is None else args.stiffness
    return Material(stiffness) if args.poisson is None else Material(stiffness, args.poisson)


def _add_flag(group: Any, option: Option) -> None:
    number = {"whole": int, "number": float}.get(option.kind) if not option.choices else None
    default = "" if option.default is None else f" ({option.default})"
    group.add_argument(
        _flag(option),
        dest=_DEST.format(option.name),
        type=number or str,
        choices=option.choices if option.kind == "choice" else None,
        metavar=None if option.kind == "choice" else "|".join([option.unit.upper() or "N", *option.choices]),
        help=option.help.replace("%", "%%") + default,
    )


def _given(args: argparse.Namespace, spec: registry.ModelSpec) -> dict[str, Any]:
    """The options that ``--set`` and flags give, checked."""
    flags = {option.name: (option, getattr(args, _DEST.format(option.name), None)) for option in spec.options}
    return _parameters.settings(args.set, spec) | {
        name: option.read(value, name=_flag(option))
        if isinstance(value, str)
        else option.check(value, name=_flag(option))
        for name, (option, value) in flags.items()
        if value is not None
    }


def _flag(option: Option) -> str:
    return "--" + option.name.replace("_", "-")


def _names(model: str | registry.ModelSpec) -> list[str]:
    spec = registry.spec(model) if isinstance(model, str) else model
    return [option.name for option in spec.options]


def _refuse(flag: str, owners: list[str], args: argparse.Namespace) -> None:
    owned = " or ".join(f"--model {name}" for name in owners)
    raise ValueError(f"{flag} belongs to {owned}, not to --model {args.model}; leave one out")
