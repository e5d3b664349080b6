"""Kernels of the spline: U = r, equation (3), and its smoother neighbour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .kernel import Kernel

Array = NDArray[np.float64]


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


KERNELS: dict[str, type[Kernel]] = {"biharmonic": Biharmonic, "triharmonic": Triharmonic}
"""Kernels by the names that options give them."""
