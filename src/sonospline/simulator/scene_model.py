"""The models of tissue as a scene has them."""

from __future__ import annotations

from typing import Any

from ..mechanics.material import Material
from ..models import registry
from ..models.contract import TissueModel
from ..models.maker import make
from ..ultrasound.needle_echo import LOOKS
from .scene import Scene


def scene_model(scene: Scene, name: str, **others: str) -> TissueModel:
    """Return a model of the registry for a scene's tissue: labelled where it knows labels, with the scene's options.

    Others are taken instead of the scene's where the model has them.

    Raises
    ------
    ValueError
        No model has the name, or an option of the scene is beyond its range.
    """
    spec, part = registry.spec(name), scene.spec.model
    homogeneous = Material(scene.spec.tissue.stiffness_kpa, part.poissons_ratio)
    labelled = scene.tissues is not None and "labels" in spec.capabilities
    given = {option.name: others.get(option.name, getattr(part, option.name, None)) for option in spec.options}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if "needle_radius_mm" in given:
        options.setdefault("needle_radius_mm", LOOKS[scene.spec.needle.look]().diameter_mm / 2)
    return make(name, scene.tissue, scene.tissues if labelled else homogeneous, **options)
