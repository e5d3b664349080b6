"""Small scenes for the simulator's tests: quick to make, and everything in them."""

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
