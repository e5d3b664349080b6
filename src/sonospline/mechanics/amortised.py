"""Parameters of the paper's spline by where a needle goes: site, direction and depth give Table I's seven numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import shown
from ..geometry.grid import FACES
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from .interaction import NeedleTissueModel

Array = NDArray[np.float64]

TUNED = (
    "shaft_displacement", "shaft_pull", "shaft_decay", "pull_decay", "tip_displacement", "tip_radius", "tip_length",
)  # fmt: skip
"""Table I's seven; delta follows sigma_s."""
FEATURES = ("length", "cosine", "entry to wall", "tip to wall", "middle to wall")
"""Of a needle in a block: how long and how steep it is, how far from what is pinned; in sides of the block."""
LARGEST = 1.5
"""Of the logarithm of what a parameter is multiplied by."""
TRUNCATION = 3.0
"""delta over sigma_s: where the drag has decayed to 1 % it is cut off, as in Table I."""
_FILE = "amortised.json"


@dataclass(frozen=True, eq=False, repr=False)
class AmortisedParameters:
    """Ridge regression of the logarithms of the seven parameters on a needle's place, to second order.

    Parameters
    ----------
    constant : NeedleTissueModel
        What is multiplied, in cube sides.
    mean, scale : (5,) array_like
        Of :data:`FEATURES`.
    weights : (7, 21) array_like
        Of 1, the features so scaled, and their products, for each of :data:`TUNED`.

    Raises
    ------
    ValueError
        Arrays of other shapes.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import AmortisedParameters
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="z-")
    >>> steep, shallow = ss.Needle((.5, .5, 0), (.5, .5, .6)), ss.Needle((.5, .5, 0), (.6, .5, .25))
    >>> amortised = AmortisedParameters.shipped()
    >>> models = [amortised.model(tissue, needle) for needle in (steep, shallow)]
    >>> models[0] == models[1], models[0] == amortised.model(tissue, ss.Needle((.5, .5, 0), (.5, .5, .6)))
    (False, True)
    >>> field = ss.Insertion(tissue, models[0]).advance(steep)
    """

    constant: NeedleTissueModel
    mean: Array
    scale: Array
    weights: Array

    def __post_init__(self) -> None:
        terms = len(second_order(np.zeros(len(FEATURES))))
        shapes = {"mean": (len(FEATURES),), "scale": (len(FEATURES),), "weights": (len(TUNED), terms)}
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), float)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"{name} has shape {array.shape} or is not finite; give {shape} numbers")
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def shipped(cls) -> AmortisedParameters:
        """Return those that come with the package: for ``LineForce()`` in ``Material()``, made by
        ``scripts/make_amortised_parameters.py``."""
        return _shipped()

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> AmortisedParameters:
        """Return them from what :meth:`values` gave."""
        return cls(
            NeedleTissueModel(**values["constant"]), values["mean"], values["scale"], np.array(values["weights"])
        )

    def values(self) -> dict[str, Any]:
        """Return them as JSON holds them."""
        return {
            "constant": vars(self.constant), "mean": self.mean.tolist(), "scale": self.scale.tolist(),
            "weights": self.weights.tolist(),
        }  # fmt: skip

    def model(self, tissue: Tissue, needle: Needle) -> NeedleTissueModel:
        """Return the parameters of a needle in a block of tissue, in its units.

        Raises
        ------
        ValueError
            A needle outside the tissue.
        """
        if not isinstance(needle, Needle):
            raise ValueError(f"needle = {shown(needle)} is none; give a Needle")
        tissue.check_inside(entry=needle.entry, tip=needle.tip)
        terms = second_order((features(tissue, needle) - self.mean) / self.scale)
        return multiplied(self.constant, self.weights @ terms).scaled(tissue.grid.side)

    def __repr__(self) -> str:
        return f"AmortisedParameters({len(TUNED)} parameters of {len(FEATURES)} features)"


def features(tissue: Tissue, needle: Needle) -> Array:
    """(5,) of a needle in a block; the same for blocks that are turned or mirrored."""
    grid = tissue.grid
    axis, from_last = divmod(FACES.index(tissue.entry_face), 2)
    places = grid.local(np.stack([needle.entry, needle.tip])) / grid.extent
    inward = 1 - places[:, axis] if from_last else places[:, axis]
    beside = np.delete(places, axis, axis=1)
    walls = np.minimum(beside, 1 - beside).min(axis=1)
    middle = beside.mean(axis=0)
    length = float(np.linalg.norm(places[1] - places[0]))
    return np.array(
        [
            length, (inward[1] - inward[0]) / length, walls[0], min(walls[1], 1 - inward[1]),
            np.minimum(middle, 1 - middle).min(),
        ]
    )  # fmt: skip


def second_order(values: ArrayLike) -> Array:
    """1, some numbers, and their products, squares included."""
    found = np.asarray(values, float)
    pairs = combinations_with_replacement(found.tolist(), 2)
    return np.concatenate([[1.0], found, [a * b for a, b in pairs]])


def multiplied(constant: NeedleTissueModel, logarithms: ArrayLike) -> NeedleTissueModel:
    """Return a model with each of the seven multiplied, by no more than :data:`LARGEST` allows."""
    factors = np.exp(np.clip(np.asarray(logarithms, float), -LARGEST, LARGEST))
    return of_seven([getattr(constant, name) * factor for name, factor in zip(TUNED, factors.tolist(), strict=True)])


def of_seven(values: Sequence[float]) -> NeedleTissueModel:
    """Return the model whose :data:`TUNED` have some values."""
    found = dict(zip(TUNED, values, strict=True))
    return NeedleTissueModel(**found, shaft_radius=round(TRUNCATION * found["shaft_decay"], 12))


@cache
def _shipped() -> AmortisedParameters:
    return AmortisedParameters.of(json.loads(files(__package__).joinpath(_FILE).read_text("utf-8"))["parameters"])
