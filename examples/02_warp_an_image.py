"""Deform a 3-D image under a needle and follow the target the needle was aimed at."""

import numpy as np

import sonospline as ss
from sonospline.geometry.layered_block import default_needle, layered_block

volume = layered_block(seed=0)
path = default_needle()
grid = volume.grid(nodes=30_000)
insertion = ss.Insertion(ss.Tissue(grid, entry_face=grid.nearest_face(path.entry)))
field = insertion.advance(path)

warped = ss.ImageWarp.of(field).apply(volume)
target_shift = float(np.linalg.norm(field.displacement(path.tip)))

if __name__ == "__main__":
    print(f"the needle reached {path.tip} mm; the target had moved {target_shift:.2f} mm ahead of it")
    changed = np.mean(warped.voxels != volume.voxels)
    print(f"{100 * changed:.0f} % of the voxels changed")
