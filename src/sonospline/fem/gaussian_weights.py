"""What the nodes take of a force at a point that a Gaussian smooths: its exact integrals times the hat functions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import FACES
from ..geometry.tissue import Tissue

Array = NDArray[np.float64]


def gaussian_weights(tissue: Tissue, point: Array, width: float) -> Array:
    """Return the weight (nx, ny, nz) of each node of a tissue's grid.

    A Gaussian of three dimensions and a hat function of a hexahedron are both products of three
    functions of one axis, so that a weight is the product of three integrals. What lies beyond a
    free face is brought back by a mirror; what lies beyond the others is lost.

    Parameters
    ----------
    tissue : Tissue
        With the nodes.
    point : (3,) ndarray
        In the world.
    width : float
        Standard deviation of the Gaussian, in the unit of the grid.

    Examples
    --------
    >>> import numpy as np
    >>> import sonospline as ss
    >>> from sonospline.fem.gaussian_weights import gaussian_weights
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(9))
    >>> weights = gaussian_weights(tissue, np.array([0.5, 0.5, 0.5]), 0.05)
    >>> round(float(weights.sum()), 12), round(float(weights[4, 4, 4]), 4)
    (1.0, 0.3178)
    """
    grid = tissue.grid
    shares = []
    for axis, at in enumerate(grid.local(point)):
        nodes, spacing = grid.shape[axis], grid.spacing[axis]
        low, high = (face in tissue.free_faces for face in FACES[2 * axis : 2 * axis + 2])
        images = [at, *[-at] * low, *[2 * grid.extent[axis] - at] * high]
        shares.append(sum(_shares(image, nodes, spacing, width) for image in images))
    return np.einsum("i,j,k->ijk", *shares)


def _shares(at: float, nodes: int, spacing: float, width: float) -> Array:
    """Integrals (nodes,) of hat functions times a Gaussian of one axis, within the axis.

    Over a cell between nodes p and q, of a Gaussian's mass m and first moment e about its middle ``at``,
    the hat that falls from p has (m (q - at) - e) / h, and the one that rises to q (m (at - p) + e) / h.
    """
    from scipy.special import ndtr

    edges = (np.arange(nodes) * spacing - at) / width
    mass = np.diff(ndtr(edges))
    moment = -np.diff(np.exp(-0.5 * edges**2)) / np.sqrt(2 * np.pi)
    shares = np.zeros(nodes)
    shares[:-1] += (mass * edges[1:] - moment) * width / spacing
    shares[1:] += (moment - mass * edges[:-1]) * width / spacing
    return shares
