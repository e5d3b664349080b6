"""Data sets small enough to be made in a moment."""

import numpy as np

import sonospline as ss
from sonospline.dataset import Specification

SMALL = """
name = "small"
samples = 6
seed = 5
licence = "CC-BY-4.0"
[[sources]]
kind = "block"
[anatomy]
samples = 4
voxel_mm = 2.0
[view]
samples = 2
lines = 32
depth_mm = [30, 30]
frequency_mhz = [4, 4]
[model]
use = "elastic"
solver_nodes = 1200
[stored]
pixels = 32
volume = 5
[storage]
shard = 2
"""
PATIENTS_SCENE = """
name = "Patients"
[tissue]
source = "labels"
file = "none.nii.gz"
entry_face = "z-"
nodes = 1500
[probe]
kind = "linear"
depth_mm = 30
frequency_mhz = 4
"""
"""Of label maps, which each names its own."""


def write_map(folder, name, skin):
    """Write a label map of liver under so many voxels of skin, and the names of both."""
    voxels = np.full((20, 16, 16), 2, np.uint8)
    voxels[..., :skin] = 1
    ss.write_volume(ss.Volume(voxels=voxels, spacing=(3, 3, 3)), folder / f"{name}.nii.gz")
    (folder / f"{name}.csv").write_text("label,name\n1,skin\n2,liver\n")


def small(form="zarr", **changed):
    """The small specification in a form, with some of its own numbers changed."""
    text = SMALL + f'form = "{form}"\n'
    for name, value in changed.items():
        line = next(line for line in text.splitlines() if line.startswith(f"{name} ="))
        text = text.replace(line, f"{name} = {value}", 1)
    return Specification.parse(text)
