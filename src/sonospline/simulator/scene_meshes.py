"""Which meshes the 3-D view shows of a scene: the organs it names, or its largest, then skin and grid lines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..geometry.volume import Volume
from . import surfaces
from .organs import organs
from .scene_content import SceneContent
from .scene_file import SceneFile, SurfacePart
from .skin_frame import SkinFrame
from .surfaces import MOST_VERTICES, Mesh

_OWN_SURFACES = 8
_NETS = 2000
"""Vertices left for the skin and the grid lines."""
_COLOURS = ("#9c5247", "#b5483f", "#d8d4c6", "#d9b36c", "#7d8fa8", "#8aa37b", "#a889a8", "#b08968")


def scene_meshes(spec: SceneFile, content: SceneContent, frame: SkinFrame) -> tuple[Mesh, ...]:
    """Return the meshes of a scene, the grid lines last."""
    nets = surfaces.skin(content.grid, spec.tissue.entry_face, frame), surfaces.grid_lines(content.grid, frame)
    if content.labels is None or content.names is None:
        return nets
    parts = spec.surfaces or _largest(content.labels, content.names)
    if not parts:
        return nets
    return *organs(content.labels, content.names, parts, most=(MOST_VERTICES - _NETS) // len(parts)), *nets


def _largest(labels: Volume, names: Mapping[int, str]) -> list[SurfacePart]:
    """The largest organs of a label map that comes without a list of them."""
    numbers, counts = np.unique(labels.voxels, return_counts=True)
    order = [int(n) for n in numbers[np.argsort(-counts)] if n and int(n) in names]
    return [
        SurfacePart(name=names[n], tissues=(names[n],), colour=_COLOURS[k], opacity=0.7)
        for k, n in enumerate(order[:_OWN_SURFACES])
    ]
