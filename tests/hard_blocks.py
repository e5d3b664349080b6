"""Blocks of 100 mm that are hard to solve: bone at a great contrast, layers thinner than a cell, a soft inclusion."""

from functools import cache

import numpy as np

import sonospline as ss
from real_anatomy import DISPLAY, Case, beside_bone, through_organs
from sonospline.geometry.volume import Volume
from sonospline.mechanics import Material, TissueMap

SIDE = 100.0


def block(parts, materials, voxels=100):
    """A cube in which each part, a label and where it is, covers those before it."""
    spacing = SIDE / voxels
    labels = np.zeros((voxels,) * 3, np.uint8)
    for label, where in parts(*np.meshgrid(*[(np.arange(voxels) + 0.5) * spacing] * 3, indexing="ij", sparse=True)):
        labels[np.broadcast_to(where, labels.shape)] = label
    return TissueMap(Volume(voxels=labels, spacing=(spacing,) * 3, origin=np.full(3, spacing / 2)), materials)


@cache
def bone_and_cavity(poissons_ratio=0.45, *, rigid=True, contrast=1e5):
    """Four layers, a stiff sphere, a cavity of fluid, and a bar of bone from wall to wall."""

    def parts(x, y, z):
        yield 1, x < 7.3
        yield 2, (x >= 7.3) & (x < 21.6)
        yield 3, (x >= 21.6) & (x < 38.2)
        yield 4, (x - 62) ** 2 + (y - 50) ** 2 + (z - 68) ** 2 < 12.0**2
        yield 5, (x - 55) ** 2 + (y - 32) ** 2 + (z - 42) ** 2 < 10.0**2
        yield 6, (x > 30) & (x < 41) & (z > 22) & (z < 33)

    def of(kpa, **properties):
        return Material(stiffness_kpa=kpa, poissons_ratio=poissons_ratio, **properties)

    fluid = of(4, fluid=True)
    bone = of(contrast * fluid.shear_modulus * 2 * (1 + poissons_ratio), rigid=rigid, cutting_force_n=50)
    return block(parts, {0: of(6), 1: of(30), 2: of(3), 3: of(12), 4: of(60), 5: fluid, 6: bone})


@cache
def thin_layers():
    """A fascia of 2 mm, tilted by 7 degrees, and an organ in a capsule of 2 mm: neither lies along the cells."""

    def parts(x, y, z):
        across = np.cos(np.deg2rad(7.0)) * (x - 23.7) + np.sin(np.deg2rad(7.0)) * (y - 50)
        yield 1, (across >= 0) & (across < 2.0)
        radius = np.sqrt((x - 63.1) ** 2 + (y - 51.3) ** 2 + (z - 48.7) ** 2)
        yield 1, radius < 22.0
        yield 2, radius < 20.0

    return block(parts, {0: Material(4), 1: Material(100), 2: Material(8)}, voxels=200)


@cache
def soft_sphere():
    """A sphere of a tenth of the stiffness, in which the tip ends."""
    return block(
        lambda x, y, z: [(1, (x - 60) ** 2 + (y - 50) ** 2 + (z - 50) ** 2 < 10.0**2)],
        {0: Material(10), 1: Material(1)},
    )


def tissue():
    return ss.Tissue(ss.Grid.covering((SIDE,) * 3, nodes=DISPLAY), entry_face="x-")


def bone_cases():
    """Beside the bar and through the layers, with bone that is held and bone that is merely stiff."""
    for ratio in (0.45, 0.49):
        for rigid in (True, False):
            name = f"bone and cavity, nu {ratio}, {'held' if rigid else 'x 1e5'}"
            tissues, held = bone_and_cavity(ratio, rigid=rigid), bone_and_cavity()
            yield Case(f"{name}, beside bone", tissue(), tissues, beside_bone(tissue(), held, np.random.default_rng(5)))
            yield Case(
                f"{name}, through organs", tissue(), tissues, through_organs(tissue(), held, np.random.default_rng(6))
            )


def layer_cases():
    for seed in (8, 9):
        needle = through_organs(tissue(), thin_layers(), np.random.default_rng(seed))
        yield Case(f"thin layers {seed}", tissue(), thin_layers(), needle)


def soft_cases():
    yield Case("soft sphere", tissue(), soft_sphere(), ss.Needle((0, 41.3, 57.8), (60, 50, 50)))
