"""The insertions of the study: three to tune on, eight held out."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from ..geometry.grid import FACES
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlannedInsertion:
    """A straight insertion for a block of any size, in fractions of its sides.

    Parameters
    ----------
    name : str
        What tables call it.
    entry, target : (float, float, float)
        Where the needle enters and where its tip ends: depth from the entry face, then
        along that face's two axes, in cyclic order x, y, z.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.study.insertions import PlannedInsertion
    >>> plan = PlannedInsertion("straight", (0, .5, .5), (.6, .5, .5))
    >>> plan.on(ss.Tissue(ss.Grid.unit_cube(25), entry_face="z+"))
    Needle(entry=(0.5, 0.5, 1), tip=(0.5, 0.5, 0.4))
    """

    name: str
    entry: tuple[float, float, float]
    target: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name in ("entry", "target"):
            place = _validate.vector(name, getattr(self, name))
            if (place < 0).any() or (place > 1).any():
                raise ValueError(f"{name} = {place.tolist()} leaves the block; give fractions between 0 and 1")
            object.__setattr__(self, name, tuple(place.tolist()))

    def on(self, tissue: Tissue) -> Needle:
        """Return the needle at the target of this insertion into a block of tissue."""
        return Needle(_place(self.entry, tissue), _place(self.target, tissue))

    @property
    def angle(self) -> float:
        """Degrees between a cube's entry face normal and the needle."""
        across = np.subtract(self.target, self.entry)
        return float(np.degrees(np.arctan2(np.hypot(*across[1:]), across[0])))


def tuning_insertions() -> tuple[PlannedInsertion, ...]:
    """Return the three insertions that parameters are tuned on, eq. (24).

    Examples
    --------
    >>> from sonospline.study.insertions import tuning_insertions
    >>> [plan.name for plan in tuning_insertions()]
    ['T1', 'T2', 'T3']
    """
    return _read("tuning")


def held_out_insertions() -> tuple[PlannedInsertion, ...]:
    """Return the eight insertions, all oblique, that no tuning sees.

    Examples
    --------
    >>> from sonospline.study.insertions import held_out_insertions
    >>> min(round(plan.angle) for plan in held_out_insertions())
    9
    """
    return _read("held_out")


@cache
def _read(group: str) -> tuple[PlannedInsertion, ...]:
    rows = tomllib.loads(files(__package__).joinpath("insertions.toml").read_text("utf-8"))[group]
    return tuple(PlannedInsertion(row["name"], tuple(row["entry"]), tuple(row["target"])) for row in rows)


def _place(fractions: tuple[float, float, float], tissue: Tissue) -> Array:
    axis, from_last = divmod(FACES.index(tissue.entry_face), 2)
    depth, *along_face = fractions
    place = np.empty(3)
    place[axis] = 1 - depth if from_last else depth
    place[(axis + 1) % 3], place[(axis + 2) % 3] = along_face
    return tissue.grid.world((place * tissue.grid.extent)[None])[0]
