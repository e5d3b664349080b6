"""Kernels of the spline: small objects that know their values, sign and polynomial degree.

A kernel is what the fit and the field need to know of U: a scalar times the identity for
the radial ones here. Where the definition asks for "conditionally definite", the sign says
which way: smoothing must push the spectrum away from zero, never towards it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _core

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


class _Radial(Kernel):
    """A scalar kernel U(r) of the core, known there by its number."""

    _number: int

    def matrix(self, points: Array, centres: Array) -> Array:
        return _core.active.kernel_matrix(self._number, points, centres)

    def sum(self, points: Array, centres: Array, weights: Array, affine: Array, *, single: bool) -> Array:
        function = _core.active.sum_at_points_f32 if single else _core.active.sum_at_points_f64
        return function(self._number, points, centres, weights, affine)

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
        function = _core.active.sum_on_lattice_f32 if single else _core.active.sum_on_lattice_f64
        return function(self._number, shape, spacing, centres, weights, affine)

    def gradient(self, points: Array, centres: Array, weights: Array, affine: Array) -> Array:
        return _core.active.gradient_at_points(self._number, points, centres, weights, affine)


@dataclass(frozen=True)
class Biharmonic(_Radial):
    """U(r) = r, equation (3): the lowest-order polyharmonic kernel of three dimensions.

    Its symbol is ``-8 pi / |xi|^4``: conditionally *negative* definite, so the paper's +eps on
    the diagonal (eq. 4) moves the system towards singularity.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> ss.Biharmonic().matrix(np.zeros((1, 3)), np.array([[3., 4., 0.]])).tolist()
    [[5.0]]
    """

    sign = -1
    homogeneity = 1
    single_precision = True
    multilevel = True
    _number = 0


@dataclass(frozen=True)
class Triharmonic(_Radial):
    """U(r) = r^3: smooth across its centres (no kink), conditionally positive definite."""

    sign = 1
    homogeneity = 3
    _number = 1
