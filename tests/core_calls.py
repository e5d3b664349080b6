"""A sound call of each function and method of the core: what tests of its border spoil, one argument at a time."""

from dataclasses import dataclass
from inspect import signature
from types import ModuleType

import numpy as np

from sonospline import Grid
from sonospline._core import cubic_axis, twin
from sonospline.geometry import facing
from sonospline.geometry.volume import Volume
from sonospline.link import Coupling
from sonospline.ultrasound import Phantom, Probe
from sonospline.ultrasound.aim import aim
from sonospline.ultrasound.optics import Optics, Scan, picture_plane

SHAPE, SPACING = (6, 5, 7), (1.0, 1.5, 0.8)
AFFINE = np.vstack([np.zeros(3), np.eye(3)])
RNG = np.random.default_rng(31)


def rows(count):
    return RNG.random((count, 3)) * 4


def singles(*shape):
    return RNG.standard_normal(shape).astype(np.float32) / 10


POINTS = {"points": rows(9)}
SUM = {"kernel": 0, "centres": rows(5), "weights": rows(5), "affine": AFFINE}
SAMPLED = {"values": singles(*SHAPE, 3), "spacing": SPACING, "points": rows(9)}
PLAN = {"shape": (12, 9, 14), "spacing": (1.0, 1.0, 1.0), "tolerance": 3e-2, "orders": [4]}
FACTOR = 3 * np.eye(6) + np.ones((6, 6))
CELLS = ((4, 4, 4), (2, 2, 2))
NODES = (3, 5, 5, 5)
MULTIGRID = {
    "levels": [((4 / n[0],) * 3, np.full(n, 5, np.float32), np.ones(n, np.float32)) for n in CELLS],
    "pinned": [True, False, False, False, False, False],
    "full": False,
    "degree": 2,
    "coarse_inverse": np.eye(54, dtype=np.float32) / 10,
    "layered": np.array([[0, 0, 0], [3, 1, 2]]),
    "excess": np.tile(np.eye(6, dtype=np.float32), (2, 1, 1)),
    "springs": np.ones((3, *(n + 1 for n in CELLS[0])), np.float32),
}
HALF_FIXED = np.arange(125).reshape(5, 5, 5).astype(np.uint8) // 100
GALERKIN = {
    "lame": np.full((4, 4, 4), 5, np.float32), "shear": np.ones((4, 4, 4), np.float32), "dilatation": np.eye(24),
    "distortion": np.eye(24), "fixed": HALF_FIXED, "coarse": (3, 3, 3),
}  # fmt: skip

CONTACT = {
    "compliance": np.eye(4) + 0.3, "places": np.arange(-3.0, 1), "displacement": np.zeros(4), "forces": np.zeros(4),
    "anchors": np.arange(3.0, -1, -1), "low": np.full(4, -0.1), "high": np.full(4, 0.1), "tip": 3,
    "axis": np.array([0, 0.6, 0.8]), "origin": np.zeros(3), "lateral_stiffness": 0.2, "lateral_force": np.zeros(3),
}  # fmt: skip


def ultrasound():
    """Arguments for a small probe over two tissues: what the package gives to the core, and a frame."""
    voxels = np.zeros((25, 13, 25), np.uint8)
    voxels[:, :, 12:] = 1
    probe = Probe.curvilinear(frequency_mhz=3.5, depth_mm=20, lines=32, samples=160)
    phantom = Phantom(Volume(voxels=voxels, spacing=(1, 1, 1)), {0: "liver", 1: "muscle"})
    pose = facing((12, 6, 2), depth=(0, 0, 1), right=(1, 0, 0))
    optics, recorded = Optics(probe), {}

    class Recorder(ModuleType):
        def __getattr__(self, name):
            made = getattr(twin, name)

            def record(*arguments):
                recorded[name] = dict(signature(made).bind(*arguments).arguments)
                return made(*arguments)

            return record

    import sonospline._core as core

    active, core.active = core.active, Recorder("recorder")
    try:
        optics.plan(Scan.of(probe, picture_plane(probe, pose, (40, 36))))
        echoes = phantom.echoes
        choose = echoes.choose
        echoes.choose = lambda *a: (
            recorded.update({"EchoScene.choose": dict(signature(choose).bind(*a).arguments)}) or choose(*a)
        )
        grid = Grid.covering((24, 12, 24), nodes=600)
        seen = aim(phantom, optics, pose, grid, 1.0, 3, diffuse=True)
    finally:
        core.active = active
    recorded["BmodePlan.aim"] = seen._asdict()
    recorded["BmodePlan.render"] = {
        "values": singles(*grid.shape, 3),
        "spacing": grid.spacing,
        "echoes": np.array([[3, 40, 1, 0], [4.5, 60, 0, 1]], np.float32),
        "shadow": np.array([[10] * 32, [0.5] * 32], np.float32),
        "shadow_soft_mm": 2.0,
        "noise": singles(2 * 32 * 160),
        "noise_level": 0.1,
        "offset_db": singles(160),
        "range_db": 60.0,
        "wide": singles(9, 160, 2),
        "wide_scale": singles(160),
        "haze": singles(32, 40, 2),
        "texture": singles(32, 160, 2),
        "tail_level": 0.01,
        "tail_keep": 0.9,
        "ghosts": np.abs(singles(32, 10)),
        "unit": np.ones(160, np.float32),
        "loudness": np.ones(160, np.float32),
        "again": 0.1,
    }
    return recorded


def a_factor(core):
    factor = core.CholeskyFactor()
    factor.append(FACTOR[:4, :4].copy(), 1e-9)
    return factor


SOUND = {
    **dict.fromkeys(("sum_at_points_f32", "sum_at_points_f64", "gradient_at_points"), SUM | POINTS),
    **dict.fromkeys(("sum_on_lattice_f32", "sum_on_lattice_f64"), SUM | {"shape": SHAPE, "spacing": SPACING}),
    "kernel_matrix": {"kernel": 1, "points": rows(4), "centres": rows(5)},
    "kelvinlet_sum": POINTS | {"centres": rows(5), "forces": rows(5), "width": 0.3, "poissons_ratio": 0.45},
    "sample_lattice": SAMPLED | {"order": 3},
    "gradient_lattice": {"coefficients": SAMPLED["values"], "spacing": SPACING, "points": rows(9)},
    "invert_lattice": SAMPLED | {"tolerance": 1e-3, "most": 20, "order": 1},
    "resample_lattice": {
        "values": singles(3, 5, 6, 4), "x": singles(8, 7), "y": singles(9, 8), "z_transposed": singles(4, 5),
    },
    "reslice": {
        "values": SAMPLED["values"], "spacing": SPACING, "pixel": np.array([[0.2, 0, 0], [0, 0.2, 0], [0, 0, 2.0]]),
        "voxels": singles(6, 7, 8), "seen": np.ones((6, 7, 8), np.uint8), "index": np.eye(3, 4), "shape": (11, 21),
        "tolerance": 0.01, "most": 20,
    },
    "nodal_forces": {
        "shape": SHAPE, "spacing": SPACING, "points": 2 * np.abs(rows(6)), "amounts": np.arange(1.0, 7),
        "direction": np.array([1.0, 0, 0]), "width": 0.7, "mirrored": [True, False, False, False, False, False],
    },
    "nodal_force_vectors": {
        "shape": SHAPE, "spacing": SPACING, "points": 2 * np.abs(rows(6)), "forces": rows(6), "width": 0.7,
        "mirrored": [True, False, False, False, False, False],
    },
    "displacement_at": {
        "displacement": 0.1 * singles(3, 5, 6, 4), "spacing": SPACING, "x": cubic_axis.filter_matrix(5),
        "y": cubic_axis.filter_matrix(6), "z": cubic_axis.filter_matrix(4), "points": 2 * np.abs(rows(6)),
    },
    "followed": {
        "fields": singles(4, *NODES), "start": singles(*NODES), "change": singles(*NODES),
        "forgotten": np.array([0.1, 0.2, 0.3, 1.0]), "taken_up": np.array([0.05, 0.1, 0.2, 0.7]), "nil": 1e-12,
    },
    "clipped_forces": {
        "compliance": np.eye(5) + 0.3, "apart": np.arange(5.0) - 2, "low": np.full(5, -1.0), "high": np.full(5, 0.5),
        "start": np.zeros(5), "sweeps": 50, "tolerance": 1e-9,
    },
    "cut_on": {
        "compliance": np.eye(5) + 0.3, "behind": 2 - np.arange(5.0), "bond": np.full(6, 0.1),
        "resistance": np.full((4, 5), 0.3), "anchors": 1.5 - np.arange(5.0), "axial": np.array([0.1, -0.2, 0, 0.3, 0]),
        "tip": 0.2, "cut": 2.2, "sliding": np.array([1, 0, 0, 0, 1], np.uint8), "used": np.zeros(5, np.uint8),
        "apart": 1.0, "reuse": 0.6, "speed": 0.1, "membrane": 3.0, "rupture": 0.4, "slow": 0.1, "sweeps": 50,
        "tolerance": 1e-9, "ends": 1e-3, "grown": 0.01, "most": 20,
    },
    "held_across": {
        "compliance": np.eye(12) + 0.3, "places": rows(4), "axis": np.array([0, 0.6, 0.8]),
        "held": np.array([0, 1, 1, 1], np.uint8), "offsets": rows(4), "lateral": rows(4), "share": 0.9, "bond": 0.1,
        "soft": 0.3, "least": 1e-9,
    },
    "ForceLaw": {"hands": 2, "options": Coupling().for_core(), "sweeps": 8},
    "ForceLaw.renew": CONTACT,
    "ForceLaw.tick": {"positions": rows(2), "device_age": np.zeros(2), "contact_age": 0.0},
    "ForceLoop": {"options": Coupling().for_core(), "sweeps": 8},
    "ForceLoop.publish": CONTACT,
    "ForceLoop.place": {"position": np.arange(3.0)},
    "crc64": {"data": RNG.integers(0, 256, 200).astype(np.uint8), "start": 1 << 63},
    "undeformed_points": {
        "displacement": 0.1 * singles(3, 5, 6, 4), "spacing": SPACING, "x": cubic_axis.filter_matrix(5),
        "y": cubic_axis.filter_matrix(6), "z": cubic_axis.filter_matrix(4),
        "points": 2 * np.abs(rows(6)), "start": 2 * np.abs(rows(6)),
        "iterations": 20,
    },
    "MultilevelPlan": PLAN,
    "MultilevelPlan.evaluate": {
        "centre_index": RNG.integers(0, 9, (20, 3)), "weights": rows(20), "affine": AFFINE, "depth": 1,
        "out": np.zeros((*PLAN["shape"], 3), np.float32),
    },
    "CholeskyFactor.append": {"rows": FACTOR[4:].copy(), "smallest_pivot": 1e-9},
    "CholeskyFactor.solve": {"x": np.ones((3, 4)), "first": 0},
    "ElasticMultigrid": MULTIGRID,
    "ElasticMultigrid.iterate": {
        "load": singles(*NODES), "start": np.zeros(NODES, np.float32), "iterations": 2, "estimate": True,
    },
    "ElasticMultigrid.product": {"values": singles(*NODES)},
    "galerkin_of_cells": GALERKIN,
    "galerkin_of_stencil": {"stencil": singles(126, 5, 5, 5), "coarse": (3, 5, 3)},
    **ultrasound(),
}  # fmt: skip
"""Of each function, class or method, arguments that fit."""


def prepared(core, call):
    """A function of the core, or a method of an object made for it, and a copy of arguments that fit."""
    arguments = {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in SOUND[call].items()}
    name, _, method = call.partition(".")
    if not method:
        return getattr(core, name), arguments
    made = a_factor(core) if name == "CholeskyFactor" else getattr(core, name)(**SOUND[name])
    if call == "BmodePlan.render":
        made.aim(**SOUND["BmodePlan.aim"])
    return getattr(made, method), arguments


@dataclass(frozen=True)
class Argument:
    """One argument of one call."""

    call: str
    name: str

    def __str__(self):
        return f"{self.call}-{self.name}"

    @property
    def sound(self):
        return SOUND[self.call][self.name]


ARRAYS = [
    Argument(call, name) for call, given in SOUND.items() for name, x in given.items() if isinstance(x, np.ndarray)
]
