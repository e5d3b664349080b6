"""Needles a hand can bring about in a box: on edges and corners, along faces, a hair deep or through it."""

import numpy as np

import sonospline as ss

_DEPTHS = (1e-4, 1e-3, 1e-2, 0.1, 0.3, 0.6, 0.9, 0.999, 1.0)
_NEAR = (0.0, 0.0, 1e-3, 1e-2, 0.99, 1.0)

BOXES = {"cube": (13, 13, 13), "rod": (130, 13, 13), "plate": (13, 40, 40), "slab": (13, 121, 30), "coarse": (3, 3, 3)}
"""Nodes along each axis, from a cube to 10 : 1."""


def poses(rng, tissue, count):
    """Yield ``count`` needles from the entry face of a tissue, most of them near to faces, edges and corners."""
    grid, face = tissue.grid, tissue.entry_face
    axis, end = divmod(ss.FACES.index(face), 2)
    while count:
        near = rng.random(3) < 0.5
        share = np.where(near, rng.choice(_NEAR, 3), rng.random(3))
        share[axis] = end
        step = rng.normal(size=3) * (rng.random(3) < 0.8)
        step[axis] = -abs(step[axis]) if end else abs(step[axis])
        ahead = np.where(step > 0, 1 - share, share) * grid.extent
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step != 0, ahead / np.abs(step), np.inf).min()
        if np.isfinite(room) and room * np.linalg.norm(step) > 1e-6 * grid.side:
            entry = share * grid.extent
            tip = entry + rng.choice(_DEPTHS) * room * step
            yield ss.Needle(*grid.world(np.clip([entry, tip], 0, grid.extent)))
            count -= 1
