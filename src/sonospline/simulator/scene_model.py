"""The models of tissue as a scene has them."""

from __future__ import annotations

from typing import Any

from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.tissue_map import TissueMap
from ..models import registry
from ..models.contract import TissueModel
from ..models.maker import make
from ..ultrasound.needle_echo import LOOKS
from .scene import Scene
from .scene_file import SceneFile


def scene_model(scene: Scene, name: str, **others: str) -> TissueModel:
    """Return a model of the registry for a scene's tissue: labelled where it knows labels, with the scene's options.

    Others are taken instead of the scene's where the model has them.

    Raises
    ------
    ValueError
        No model has the name, or an option of the scene is beyond its range.
    """
    return tissue_model(scene.spec, scene.tissue, scene.tissues, name, **others)


def tissue_model(spec: SceneFile, tissue: Tissue, tissues: TissueMap | None, name: str, **others: str) -> TissueModel:
    """Return a model for tissue that is as a scene file says, as :func:`scene_model` does for its own."""
    known, part = registry.spec(name), spec.model
    homogeneous = Material(spec.tissue.stiffness_kpa, part.poissons_ratio)
    labelled = tissues is not None and "labels" in known.capabilities
    given = {option.name: others.get(option.name, getattr(part, option.name, None)) for option in known.options}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if "needle_radius_mm" in given:
        options.setdefault("needle_radius_mm", LOOKS[spec.needle.look]().diameter_mm / 2)
    return make(name, tissue, tissues if labelled else homogeneous, **options)
