"""A scene's tissue as breathing moves it, and what a needle does to it, one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..elasticity.background import Background, undeformed
from ..elasticity.solver import ElasticSolver
from ..fields.carried_field import CarriedField
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..mechanics.breathing import EXCURSION_MM, Breathing
from .scene import Scene
from .scene_file import BreathingPart
from .scene_motion import scene_motion

Needles = Mapping[str, Needle]


class MovingTissue:
    """The field of one millimetre of the diaphragm, on the scene's display grid, linear between its nodes.

    So is all that a session makes of it: pictures, surfaces, targets, and where undeformed tissue has a needle.
    """

    def __init__(self, per_mm: GridField, breathing: Breathing) -> None:
        self.per_mm, self.breathing = per_mm, breathing

    @classmethod
    def of(cls, scene: Scene, solver: ElasticSolver) -> MovingTissue:
        """Return that of a scene whose file has a part for breathing."""
        part = scene.spec.breathing
        breathing = Breathing() if part is None else breathing_of(part)
        motion = scene_motion(scene, solver, breathing=breathing)
        assert motion.carried is not None
        return cls(GridField.of(motion.field(Background(motion.carried))), breathing)

    def at(self, excursion_mm: float) -> GridField | None:
        """Return the displacement while the diaphragm is so far from its rest; None at rest."""
        if excursion_mm == 0:
            return None
        return GridField(self.per_mm.grid, self.per_mm.values * np.float32(excursion_mm))

    def __repr__(self) -> str:
        return f"MovingTissue({self.breathing!r})"


def breathing_of(part: BreathingPart) -> Breathing:
    """Return how a scene's patient breathes: as published, with breaths as deep as its file has them."""
    deep = replace(EXCURSION_MM, **{name: part.depth * value for name, value in vars(EXCURSION_MM).items()})
    return Breathing(excursion_mm=deep, seed=part.seed)


def both(first: GridField | None, second: GridField | None) -> GridField | None:
    """Return the sum of two displacements of undeformed tissue, on the same grid."""
    if first is None or second is None:
        return second if first is None else first
    return GridField(first.grid, first.values + second.values)


def needles_at_rest(background: GridField | None, needles: Needles) -> Needles:
    """Return needles as undeformed tissue has them; those that are where no tissue is are left out."""
    if background is None:
        return needles
    found = {name: undeformed(background, needle) for name, needle in needles.items()}
    return {name: needle for name, needle in found.items() if needle is not None}


def composed(by_needles: GridField, background: GridField | None) -> GridField:
    """Return where tissue is: first the needles' displacement, then the background's."""
    if background is None:
        return by_needles
    if not by_needles.values.any():
        return background
    return GridField(by_needles.grid, CarriedField(by_needles, background).on_grid())
