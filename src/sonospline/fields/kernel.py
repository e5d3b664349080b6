"""What a kernel of a field is: a small object that knows its values, sign and sums.

A kernel is what the fit and the field need to know of U: a scalar times the identity for
the radial ones. Where the definition asks for "conditionally definite", the sign says
which way: smoothing must push the spectrum away from zero, never towards it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Kernel(ABC):
    """A translation-invariant kernel K(p - c) acting on vector weights.

    Sums are written so that a matrix-valued kernel (elastic body spline, Kelvinlet) can
    take the same place: callers pass points, centres and weights, never distances.
    """

    sign: int
    """+1 or -1: the kernel times this is (conditionally) positive definite."""
    homogeneity: int
    """s in U(a r) = a^s U(r): how values and weights scale with the unit of length."""
    single_precision = False
    """Whether sums in float32 are accurate: their terms must not cancel too much."""
    multilevel = False
    """Whether the core has a multilevel sum of it."""

    @abstractmethod
    def matrix(self, points: Array, centres: Array) -> Array:
        """Return ``U(|p_i - c_j|)`` as an (m, n) array."""

    @abstractmethod
    def sum(self, points: Array, centres: Array, weights: Array, affine: Array, *, single: bool) -> Array:
        """Return affine part plus kernel sum at points (m, 3), as (m, 3)."""

    @abstractmethod
    def sum_on_lattice(
        self,
        shape: tuple[int, int, int],
        spacing: tuple[float, float, float],
        centres: Array,
        weights: Array,
        affine: Array,
        *,
        single: bool,
    ) -> Array:
        """Return the same sum on lattice nodes (i hx, j hy, k hz), as (nx, ny, nz, 3)."""

    @abstractmethod
    def gradient(self, points: Array, centres: Array, weights: Array, affine: Array) -> Array:
        """Return d u_a / d x_b of the same sum at points (m, 3), as (m, 3, 3)."""
