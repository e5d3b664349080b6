"""A scene's tissue as breathing moves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..elasticity.background import Background
from ..elasticity.solver import ElasticSolver
from ..fields.grid_field import GridField
from ..mechanics.breathing import EXCURSION_MM, Breathing
from .scene import Scene
from .scene_file import BreathingPart
from .scene_motion import scene_motion


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
