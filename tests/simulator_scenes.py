"""Small scenes for the simulator's tests: quick to make, and everything in them."""

import numpy as np

from sonospline.geometry import LabelMap
from sonospline.io.volumes import write_volume

SMALL = """name = "Small block"
description = "A vessel in gel"

[tissue]
source = "gel block"
voxel_mm = 1.0
nodes = 6000

[model]
solver_nodes = 3000

[needle]
length_mm = 80.0
u = -34.0
angle = 38.0

[probe]
kind = "linear"
name = "Small linear"
frequency_mhz = 2.0
depth_mm = 30.0
focus_mm = 20.0
lines = 64
right = [1.0, 0.0, 0.0]

[[targets]]
name = "vessel"
at = [60.0, 30.0, 24.0]

[[targets]]
name = "beside"
at = [70.0, 34.0, 20.0]

[[surfaces]]
name = "vessel"
tissues = ["blood", "vessel wall"]
colour = "#b5483f"
"""

SMALL_PAPER = SMALL.replace("[model]\n", '[model]\nuse = "paper"\n')

RIBS = """name = "Ribs"
[tissue]
source = "labels"
file = "ribs.nrrd"
entry_face = "z-"
nodes = 2000
[model]
solver_nodes = 1500
[needle]
u = 0.0
angle = 90.0
[probe]
kind = "linear"
frequency_mhz = 2.0
depth_mm = 40.0
lines = 16
right = [1.0, 0.0, 0.0]
"""


def write_ribs(folder):
    """Write a scene of fat, 78 x 58 x 58 mm: a rib 23 mm deep, a thin one deeper, one at the skin; return its file."""
    voxels = np.ones((40, 30, 30), np.uint8)
    voxels[15:25, :, 12:15] = 2
    voxels[5, :, 25:27] = 3
    voxels[36:, :, :2] = 4
    write_volume(LabelMap(voxels=voxels, spacing=2.0), folder / "ribs.nrrd")
    (folder / "ribs.csv").write_text("label,name\n1,fat\n2,rib_left_8\n3,rib_left_9\n4,rib_left_7\n")
    (folder / "ribs.toml").write_text(RIBS)
    return folder / "ribs.toml"
