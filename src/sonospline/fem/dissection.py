"""Nested dissection: in which order to eliminate the nodes of a mesh, so that a factor stays small."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_LEAF = 27
"""Parts of so many nodes are not cut further."""


def nested_dissection(points: NDArray[np.float64], neighbours: Any) -> NDArray[np.int64]:
    """Return node numbers (n,) in an order that leaves the nodes between two halves to the end, in each half again.

    Parameters
    ----------
    points : (n, 3) array
        Where the nodes are; halves are cut across their longest extent.
    neighbours : (n, n) sparse CSR matrix
        An entry for each pair of nodes that the matrix couples; symmetric.

    Notes
    -----
    George, *Nested dissection of a regular finite element mesh*, SIAM J. Numer. Anal. 10 (1973) 345-363: a factor of
    n^(4/3) entries in three dimensions, where minimum degree has no bound.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.sparse import diags
    >>> from sonospline.fem.dissection import nested_dissection
    >>> line = np.arange(63.0)[:, None] * [1, 0, 0]
    >>> nested_dissection(line, diags([1.0, 1.0], [-1, 1], shape=(63, 63), format="csr"))[-1]   # the middle comes last
    np.int64(31)
    """

    def order(nodes: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        if len(nodes) <= _LEAF:
            return [nodes]
        places = points[nodes]
        along = places[:, np.ptp(places, axis=0).argmax()]
        low = along < np.median(along)
        near, far = nodes[low], nodes[~low]
        between = neighbours[far][:, near].getnnz(axis=1) > 0
        if not low.any() or between.all():
            return [nodes]
        return [*order(near), *order(far[~between]), far[between]]

    return np.concatenate(order(np.arange(len(points))))
