"""What a step of a session is about: where needles and probe are, and how the scanner is set; checked at the border."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from .._shown import shown
from ..geometry import pose
from ..geometry.needle import Needle
from ..geometry.needles import named
from .command import ImageSettings
from .scene import Scene
from .tissue_settings import TissueSettings

Array = NDArray[np.float64]
Needles = Mapping[str, Needle]


class Poses(NamedTuple):
    """Needles by name, the probe's pose, and the settings of scanner and tissue."""

    needles: Needles
    probe_to_reference: Array
    settings: ImageSettings
    tissue: TissueSettings

    @classmethod
    def at_start(cls, scene: Scene) -> Poses:
        """Return those a scene starts with: no needle, the probe at rest."""
        place = scene.frame.probe_to_reference(scene.start.probe, scene.spec.probe.press_mm)
        return cls({}, place, scene.start.image, scene.start.tissue or TissueSettings())

    def changed(
        self,
        scene: Scene,
        needles: Needles | None,
        probe_to_reference: ArrayLike | None,
        settings: ImageSettings | None,
        tissue: TissueSettings | None,
    ) -> Poses:
        """Return them with what is given changed.

        Raises
        ------
        ValueError
            Needles without names, a pose that is not rigid, settings beyond the scene's, or breathing where the
            scene has no part for it.
        """
        return Poses(
            self.needles if needles is None else _named(needles),
            _moved(self.probe_to_reference, probe_to_reference),
            self.settings if settings is None or settings == self.settings else _within(scene, settings),
            self.tissue if tissue is None or tissue == self.tissue else _able(scene, tissue),
        )

    @property
    def needle(self) -> Needle | None:
        """The needle that is shown: the first; None while none is in."""
        return next(iter(self.needles.values()), None)


def same(a: Needles, b: Needles) -> bool:
    """Return whether needles have the same names and poses."""
    return a.keys() == b.keys() and all(
        isinstance(b[name], Needle) and (a[name].entry == b[name].entry).all() and (a[name].tip == b[name].tip).all()
        for name in a
    )


def _named(needles: Needles) -> Needles:
    """A copy of needles by name, in their order."""
    if not isinstance(needles, Mapping):
        raise ValueError(f'needles = {shown(needles)} has no names; give {{"needle": Needle(entry, tip)}}')
    named(needles)
    return dict(needles)


def _moved(place: Array, to: ArrayLike | None) -> Array:
    """A pose of the probe, checked; the present one, which needs no check, where it has not moved."""
    if to is None or np.array_equal(place, to):
        return place
    pose.rigid("probe_to_reference", to)  # the imager frees it of its rounding, once
    moved = np.array(to, float)
    moved.setflags(write=False)
    return moved


def _within(scene: Scene, settings: ImageSettings) -> ImageSettings:
    if not isinstance(settings, ImageSettings):
        raise ValueError(f"settings = {shown(settings)} is not ImageSettings; change some of scene.start.image")
    scene.check(replace(scene.start, image=settings))
    return settings


def _able(scene: Scene, tissue: TissueSettings) -> TissueSettings:
    if not isinstance(tissue, TissueSettings):
        raise ValueError(f"tissue = {shown(tissue)} is not TissueSettings; make one, e.g. TissueSettings()")
    scene.check(replace(scene.start, tissue=tissue))
    return tissue
