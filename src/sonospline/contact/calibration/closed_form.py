"""The force of a needle against its depth, in closed form: friction of what it has passed, and a tip on a spring.

With s the length of the cut, q and P friction and cutting force of the tissue there, R what a membrane breaks at,
and k the stiffness of the tissue ahead, the tip goes on at s when the needle is s + P / k deep (at a membrane
s + R / k), and

    F(d) = integral of q from 0 to s(d)  +  k (d - s(d)).

Where the tip goes on later at one place than at a farther one it jumps: a membrane that gives way. What this leaves out
of the track in elastic tissue is that friction, too, takes tissue along.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_STEP_MM = 0.05
"""Between the places at which the tip may rest."""


class Layer(NamedTuple):
    """A tissue on a needle's way."""

    tissue: str
    begin_mm: float
    """Along the way, before any tissue moved."""
    friction_n_per_mm: float
    cutting_force_n: float
    rupture_force_n: float = 0.0
    """Of the membrane before it; zero where there is none."""
    stiffness_n_mm: float = 0.25
    """Force that moves the tissue ahead of the tip by 1 mm."""


class Tip(NamedTuple):
    """Where a tip rests at some depths of its needle, and what holds it there."""

    cut_mm: Array
    layer: NDArray[np.intp]
    """The number of that tissue."""
    at_membrane: NDArray[np.bool_]
    """Whether it is at the beginning of it."""
    force_n: Array
    most_n: Array
    """Force under which it would go on."""


def tip_along(depths_mm: Array, layers: Sequence[Layer]) -> Tip:
    """Return where the tip of a needle that is pushed in rests; see :func:`force_along`."""
    places = np.arange(int(np.ceil(depths_mm.max() / _STEP_MM)) + 2) * np.float64(_STEP_MM)
    begins = np.array([layer.begin_mm for layer in layers])
    here = np.searchsorted(begins, places, side="right") - 1
    cutting, rupture, stiffness = (np.array([layer[column] for layer in layers]) for column in (3, 4, 5))
    held = cutting[here]
    first = np.searchsorted(places, begins)
    there = first < len(places)
    np.maximum.at(held, first[there], rupture[there])
    goes_on = np.maximum.accumulate(places + held / stiffness[here])
    at = np.searchsorted(goes_on, depths_mm)
    yields, most, at_membrane = stiffness[here[at]], held[at], np.isin(at, first)
    cutting_on = np.clip(depths_mm - most / yields, places[np.maximum(at - 1, 0)], places[at])
    cut = np.where(at_membrane, places[at], cutting_on)
    force = np.clip(yields * (depths_mm - cut), 0.0, most)
    return Tip(cut, here[at], at_membrane, force, most)


def lengths_in(cut_mm: Array, layers: Sequence[Layer]) -> Array:
    """Return how much (n, layers) of a cut lies in each tissue."""
    begins = np.array([layer.begin_mm for layer in layers])
    ends = np.append(begins[1:], np.inf)
    lengths: Array = np.clip(cut_mm[:, None], begins, ends) - begins
    return lengths


def force_along(depths_mm: ArrayLike, layers: Sequence[Layer]) -> Array:
    """Return the force in N of a needle that is pushed in.

    Parameters
    ----------
    depths_mm : (n,) array_like
        Of the needle's tip along its way, at or above zero.
    layers : sequence of Layer
        In the order in which they are met; the first begins at 0.

    Examples
    --------
    >>> from sonospline.contact.calibration import Layer, force_along
    >>> skin = Layer("skin", 0, friction_n_per_mm=0.05, cutting_force_n=0.5, rupture_force_n=2.0)
    >>> force_along([4, 7.9, 8.1, 30], [skin]).round(2).tolist()
    [1.0, 1.98, 0.8, 1.9]
    """
    tip = tip_along(np.asarray(depths_mm, float), layers)
    friction = np.array([layer.friction_n_per_mm for layer in layers])
    force: Array = lengths_in(tip.cut_mm, layers) @ friction + tip.force_n
    return force
