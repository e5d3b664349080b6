"""Generated tissue to test and to compare on: a cube with layers, inclusions or a whole body."""

from __future__ import annotations

import numpy as np

from .. import _validate
from ..geometry.volume import Volume
from .material import Material
from .tissue_map import TissueMap

TISSUES = {
    "homogeneous": ("tissue",),
    "layers": ("first layer", "stiff layer, x 5", "last layer, x 2"),
    "sphere": ("tissue", "sphere, x 10"),
    "bone": ("tissue", "bone, x 1000"),
    "cavity": ("tissue", "cavity, x 0.1"),
    "body": ("organ", "skin", "fat", "muscle", "tumour", "cavity", "bone"),
}
"""The tissues of each cube, in the order of their labels."""

LABELLED_CUBES = tuple(TISSUES)


def labelled_cube(
    name: str, *, side: float = 1.0, voxels: int = 96, stiffness_kpa: float = 1.0, poissons_ratio: float = 0.45
) -> TissueMap:
    """Return a labelled cube [0, side]^3.

    Parameters
    ----------
    name : {"homogeneous", "layers", "sphere", "bone", "cavity", "body"}
        ``layers``: 1, 5 and 2 times the stiffness in thirds along x. ``sphere``: ten times as stiff,
        beside the usual paths. ``bone``: a bar along y, a thousand times as stiff, elastic. ``cavity``: a
        tenth. ``body``: skin, fat, muscle, an organ, a tumour, a cavity and bone.
    side : float, default: 1.0
        Side of the cube, in the unit of the grid.
    voxels : int, default: 96
        Voxels along each side.
    stiffness_kpa, poissons_ratio : float
        Of the background.

    Examples
    --------
    >>> from sonospline.mechanics import labelled_cube
    >>> labelled_cube("body", voxels=24).labels.voxels.max()
    np.uint8(6)
    """
    _validate.choice("name", name, LABELLED_CUBES)
    voxels = _validate.count("voxels", voxels, least=8)
    spacing = _validate.number("side", side, positive=True) / voxels
    x, y, z = np.meshgrid(*[(np.arange(voxels) + 0.5) / voxels] * 3, indexing="ij")
    labels = np.zeros(x.shape, np.uint8)
    relative = [1.0]

    def add(where: np.ndarray, stiffness: float) -> None:
        labels[where] = len(relative)
        relative.append(stiffness)

    def ball(centre: tuple[float, float, float], radius: float) -> np.ndarray:
        return (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 < radius**2

    bar = (x > 0.33) & (x < 0.5) & (z > 0.2) & (z < 0.33)
    if name == "layers":
        add((x > 1 / 3) & (x < 2 / 3), 5.0)
        add(x >= 2 / 3, 2.0)
    elif name == "sphere":
        add(ball((0.6, 0.5, 0.72), 0.14), 10.0)
    elif name == "bone":
        add(bar, 1000.0)
    elif name == "cavity":
        add(ball((0.5, 0.5, 0.28), 0.14), 0.1)
    elif name == "body":
        add(x < 1 / 12, 3.0)
        add((x >= 1 / 12) & (x < 1 / 4), 0.5)
        add((x >= 1 / 4) & (x < 5 / 12), 2.0)
        add(ball((0.62, 0.5, 0.5), 0.1), 8.0)
        add(ball((0.55, 0.3, 0.7), 0.1), 0.1)
        add(bar, 1000.0)
    table = {
        label: Material(stiffness_kpa=stiffness_kpa * factor, poissons_ratio=poissons_ratio)
        for label, factor in enumerate(relative)
    }
    return TissueMap(Volume(voxels=labels, spacing=(spacing,) * 3, origin=np.full(3, spacing / 2)), table)
