"""Poses and a small scene, for tests of links."""

import numpy as np
from scipy.spatial.transform import Rotation

SMALL_BLOCK = """name = "Small block"
tissue = {source = "gel block", voxel_mm = 1.0, nodes = 5000}
probe = {kind = "linear", frequency_mhz = 3, depth_mm = 40, lines = 64}
needle = {u = -34, angle = 38}
"""


def turned(seed, mm=40):
    """A rigid pose, drawn."""
    draw = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=int(draw.integers(1 << 30))).as_matrix()
    pose[:3, 3] = draw.uniform(-mm, mm, 3)
    return pose
