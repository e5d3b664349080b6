"""What tissue is made of: a linear, isotropic solid, elastic or relaxing, and what a needle in it meets.

A property is described once, here: its check, its key in tables, the errors about it and its line in the docs follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from functools import partial
from typing import Any

from .. import _validate
from .relaxation import relaxation_exponent

FLUID_SHEAR = 0.1
"""A fluid keeps its first modulus and this share of the second: it shears freely, at constant volume.

A hundredth moves tissue around it by a hundredth of the mean more or less, and takes far more iterations."""


def _about(help: str, check: Callable[[str, Any], Any]) -> dict[str, Any]:
    """What is to be known of a property: what it is, and the check that returns its value or raises ValueError."""
    return {"help": help, "check": check}


def _ratio(name: str, value: float) -> float:
    ratio = _validate.number(name, value)
    if ratio >= 0.5:
        raise ValueError(
            f"{name} = {ratio:g} is out of range; tissue that cannot change its volume has no displacement "
            "formulation, give less than 0.5, e.g. 0.49, or fluid = true"
        )
    return ratio


def _static_friction(name: str, value: float) -> float:
    ratio = _validate.number(name, value)
    if ratio < 1.0:
        raise ValueError(
            f"{name} = {ratio:g} is below 1: a shaft that sticks holds no less than one that slides; give 1 or more"
        )
    return ratio


def _given_or_none(name: str, value: float | None) -> float | None:
    return None if value is None else _validate.number(name, value)


@dataclass(frozen=True)
class Material:
    """One tissue: its stiffness in small strain, and what a needle in it meets.

    Parameters
    ----------
    {parameters}

    Raises
    ------
    ValueError
        A value out of range, or of another kind.

    Examples
    --------
    >>> from sonospline.mechanics import Material
    >>> Material(stiffness_kpa=10).shear_modulus
    3.4482758620689657
    >>> [round(modulus, 3) for modulus in Material(6).lame_moduli]
    [18.621, 2.069]
    """

    stiffness_kpa: float = field(
        default=1.0,
        metadata=_about(
            "Young's modulus E, above zero. With lengths in mm forces are in mN; the unit cube of studies has 1.",
            partial(_validate.number, positive=True),
        ),
    )
    poissons_ratio: float = field(
        default=0.45, metadata=_about("nu, at or above zero and below 0.5; live solvers take at most 0.49.", _ratio)
    )
    friction_n_per_mm: float = field(
        default=0.03, metadata=_about("Force per length along a shaft, at or above zero.", _validate.number)
    )
    track_friction_n_per_mm: float | None = field(
        default=None,
        metadata=_about(
            "Friction of a shaft that slides, for needles in time, where it was fitted to them; else the one above.",
            _given_or_none,
        ),
    )
    static_friction: float = field(
        default=1.0,
        metadata=_about(
            "Friction of a shaft that sticks over that of one that slides, at or above one; for needles in time.",
            _static_friction,
        ),
    )
    viscous_friction: float = field(
        default=0.0,
        metadata=_about(
            "Friction per length and speed of a shaft that slides, N s/mm2, at or above zero; for needles in time.",
            _validate.number,
        ),
    )
    cutting_force_n: float = field(
        default=0.7, metadata=_about("Force at an advancing tip, at or above zero.", _validate.number)
    )
    lateral_strength_n_per_mm: float = field(
        default=0.1,
        metadata=_about(
            "Force per length across a shaft up to which it can be turned: more would tear. Above zero, assumed; for "
            "needles in time.",
            partial(_validate.number, positive=True),
        ),
    )
    rigid: bool = field(
        default=False,
        metadata=_about(
            "Bone: it does not move, as it hangs on the skeleton. Cells that it fills in part are held in part.",
            _validate.flag,
        ),
    )
    floating: bool = field(
        default=False,
        metadata=_about(
            "A loose fragment of rigid tissue: what hangs together moves as a whole, in six degrees of freedom.",
            _validate.flag,
        ),
    )
    fluid: bool = field(
        default=False,
        metadata=_about(
            "A tenth of the shear modulus with the compressibility kept; a needle meets no force in it.",
            _validate.flag,
        ),
    )
    relaxation_exponent: float = field(
        default=0.0,
        metadata=_about(
            "Of the stress that held strain leaves after a time t, t^-exponent from 0.1 to 100 s; 0, the default, is "
            "elastic. Assumed of soft tissue: 0.05 to 0.25. Stiffness is that of the first tenth of a second.",
            relaxation_exponent,
        ),
    )
    source: str = field(default="assumed", metadata=_about("Where the values come from.", _validate.text))

    def __post_init__(self) -> None:
        for known in fields(self):
            object.__setattr__(self, known.name, known.metadata["check"](known.name, getattr(self, known.name)))
        if self.floating and not self.rigid:
            raise ValueError("floating = True is for what is rigid; give rigid = True too, or leave it out")

    def __repr__(self) -> str:
        shown = [known for known in fields(self) if getattr(self, known.name) != known.default]
        first = [] if any(known.name == "stiffness_kpa" for known in shown) else [fields(self)[0]]
        return f"Material({', '.join(f'{known.name}={getattr(self, known.name)!r}' for known in first + shown)})"

    @property
    def sliding_friction_n_per_mm(self) -> float:
        """Friction of a shaft that slides, for needles in time."""
        own = self.track_friction_n_per_mm
        return self.friction_n_per_mm if own is None else own

    @property
    def shear_modulus(self) -> float:
        """Second Lamé parameter in kPa, mu = E / (2 (1 + nu)); a tenth of it in a fluid."""
        solid = self.stiffness_kpa / (2 * (1 + self.poissons_ratio))
        return solid * (FLUID_SHEAR if self.fluid else 1.0)

    @property
    def first_lame(self) -> float:
        """First Lamé parameter in kPa, lambda = E nu / ((1 + nu) (1 - 2 nu))."""
        ratio = self.poissons_ratio
        return self.stiffness_kpa * ratio / ((1 + ratio) * (1 - 2 * ratio))

    @property
    def lame_moduli(self) -> tuple[float, float]:
        """First and second Lamé parameter in kPa."""
        return self.first_lame, self.shear_modulus


def parameters(material: type[Material]) -> str:
    """Return the properties as numpydoc lists parameters."""
    described = []
    for known in fields(material):
        kind = getattr(known.type, "__name__", known.type)
        default = "" if known.default is MISSING else f", default: {known.default!r}"
        described.append(f"{known.name} : {kind}{default}\n        {known.metadata['help']}")
    return "\n    ".join(described)


if Material.__doc__:  # python -OO leaves it out
    Material.__doc__ = Material.__doc__.replace("{parameters}", parameters(Material))
