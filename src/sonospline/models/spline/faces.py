"""Every node of the pinned faces as an anchor: a base of many thousand landmarks.

The five faces are symmetric under reflection across the two axes along the entry face, and
so is their kernel matrix. Parts that are even or odd in each axis decouple it into four
blocks of a quarter the size, which are factored once for a grid and kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ... import _cache, _memory
from ...fields.kernel import Kernel
from ...geometry.grid import FACES
from ...geometry.tissue import Tissue
from .anchored import Base

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Progress = Callable[[int, int], None]
"""Called with steps done and steps in all."""

_PARITIES = ((1, 1), (-1, 1), (1, -1), (-1, -1))
"""Even (1) or odd (-1) under each of the two reflections."""
_AUGMENTATION = 10.0
"""c of c R R^T, in units of the largest kernel value."""
_LARGEST_ERROR = 1e-2
"""Of a solution of size one that is known beforehand: beyond it nothing is left of double precision."""
_CACHE_FORMAT = 1


class FaceBase(Base):
    """All nodes of a tissue's pinned faces.

    Points are given in the lattice's coordinates: along the lattice axes, from the middle of the
    box, in units of ``scale``.

    Parameters
    ----------
    tissue : Tissue
        Grid and faces.
    kernel : Kernel
        K.
    scale : float
        Unit of these lengths, in mm.
    diagonal : float, default: 0.0
        Added to the diagonal of ``kernel.sign * K``.
    progress : callable, optional
        Called with the steps done and the steps in all of the one-time set-up.
    """

    def __init__(
        self,
        tissue: Tissue,
        kernel: Kernel,
        scale: float,
        *,
        diagonal: float = 0.0,
        progress: Progress | None = None,
    ) -> None:
        nodes = np.argwhere(tissue.pinned)
        grid = tissue.grid
        self.size = len(nodes)
        self._kernel = kernel
        self._points = (nodes * grid.spacing - grid.extent / 2) / scale
        entry_axis = FACES.index(tissue.entry_face) // 2
        along_face = [axis for axis in range(3) if axis != entry_axis]
        if not all(np.array_equal(tissue.pinned, np.flip(tissue.pinned, axis)) for axis in along_face):
            raise ValueError(
                f"anchors = 'all' needs opposite faces beside the entry both pinned or both free, and pinned_faces = "
                f"{tissue.pinned_faces}; give a number of anchors"
            )
        orbits = _orbits(nodes, grid.shape, along_face)
        # Two square matrices of a block at once while it is made, half a one for each block kept.
        _memory.refuse_beyond(4 * 8 * len(orbits) ** 2, f"anchors = 'all' with {self.size:,} face nodes")
        largest = float(kernel.matrix(self._points[:1], self._points[-1:])[0, 0])  # opposite corners
        augmentation = _AUGMENTATION * abs(largest)
        self._blocks = [_Block(parity, orbits, self._points, along_face, augmentation) for parity in _PARITIES]
        faces = tissue.entry_face, tissue.pinned_faces
        signature = (_CACHE_FORMAT, grid.shape, np.round(np.divide(grid.spacing, scale), 12).tolist())
        folder = f"faces-{_cache.digest(*signature, *faces, repr(kernel), diagonal)}"
        for number, block in enumerate(self._blocks):
            if progress:
                progress(number, len(self._blocks))
            file = _cache.place(folder, f"block{number}.npy")
            packed = _cache.recall(file, partial(_read_block, size=block.packed_size), "the factored faces")
            if packed is None:
                packed = block.factor(kernel, diagonal)
                _cache.keep(file, partial(np.save, arr=packed), "the factored faces")
            block.take(packed)
        if progress:
            progress(len(self._blocks), len(self._blocks))

    def columns(self, points: Array) -> Array:
        return np.column_stack([self._kernel.matrix(points, self._points), np.ones(len(points)), points])

    def solve(self, columns: Array) -> Array:
        sign = self._kernel.sign
        out = np.zeros_like(columns)
        for block in self._blocks:
            polynomials = self.size + block.polynomials
            values = block.gather(sign * columns[:, : self.size])
            weights, affine = block.solve(values, columns[:, polynomials].T)
            block.scatter(weights, out)
            out[:, polynomials] = sign * affine.T
        return out


class _Block:
    """The part of the system that is even or odd under each reflection.

    Its unknowns are one per orbit of mirror images: the orthonormal vector that is +-1 on
    the orbit's nodes. The matrix is made definite by c R R^T, which changes no weights,
    since R^T w is prescribed.
    """

    def __init__(
        self, parity: tuple[int, int], orbits: Index, points: Array, along_face: list[int], augmentation: float
    ) -> None:
        self._signs = np.array([1, parity[0], parity[1], parity[0] * parity[1]])
        # An orbit that a reflection with sign -1 maps onto itself has no such vector.
        fixed = orbits == orbits[:, :1]
        self._orbits = orbits[~(fixed & (self._signs < 0)).any(axis=1)]
        sizes = 4 / (self._orbits == self._orbits[:, :1]).sum(axis=1)
        self._weights = np.sqrt(sizes) / 4
        self._points = points
        self._augmentation = augmentation
        # of 1, x, y, z those with this parity: reflection turns the sign of its own axis alone
        behaviour = [(1, 1), *(_linear_parity(axis, along_face) for axis in range(3))]
        self.polynomials: Index = np.flatnonzero([b == parity for b in behaviour])
        everything = np.column_stack([np.ones(len(points)), points])
        self._affine = self.gather(everything[:, self.polynomials].T)

    @property
    def packed_size(self) -> int:
        """Numbers in the packed factor."""
        n = len(self._orbits)
        return n * (n + 1) // 2

    def gather(self, values: Array) -> Array:
        """Components (n, m) of values (m, nodes) in this block."""
        total = sum(sign * values[:, images] for sign, images in zip(self._signs, self._orbits.T, strict=True))
        return np.ascontiguousarray((total * self._weights).T)

    def scatter(self, components: Array, out: Array) -> None:
        """Add the values of components (n, m) to the first columns of (m, nodes or more)."""
        weighted = (self._weights[:, None] * components).T
        for sign, images in zip(self._signs, self._orbits.T, strict=True):
            out[:, images] += sign * weighted

    def factor(self, kernel: Kernel, diagonal: float) -> Array:
        """Return the block's packed Cholesky factor."""
        from scipy.linalg import lapack

        representatives = self._points[self._orbits[:, 0]]
        matrix = np.zeros((len(representatives),) * 2)
        for sign, images in zip(self._signs, self._orbits.T, strict=True):
            matrix += sign * kernel.matrix(representatives, self._points[images])
        matrix *= 4 * kernel.sign * np.outer(self._weights, self._weights)
        np.einsum("ii->i", matrix)[:] += diagonal
        matrix += self._augmentation * (self._affine @ self._affine.T)
        packed, _ = lapack.dtrttf(matrix, transr="N", uplo="L")
        packed, failed = lapack.dpftrf(len(matrix), packed, transr="N", uplo="L", overwrite_a=1)
        known = np.cos(np.arange(len(matrix)))[:, None]
        if failed or np.abs(_substitute(packed, matrix @ known) - known).max() > _LARGEST_ERROR:
            raise ValueError(
                f"anchors = 'all': the block of {len(matrix)} face nodes is singular to rounding; set smoothing above "
                "zero, or use a grid of more even spacing or the kernel U = r"
            )
        return packed

    def take(self, packed: Array) -> None:
        """Use a packed factor."""
        self._packed = packed
        self._to_affine = self._back(self._affine)
        self._gram = self._affine.T @ self._to_affine

    def solve(self, values: Array, constraints: Array) -> tuple[Array, NDArray[Any]]:
        """Solve K w + R a = values (n, m), R^T w = constraints (p, m)."""
        weights = self._back(values + self._augmentation * (self._affine @ constraints))
        # 2 x 2 at most and nearly the identity over c, thanks to c R R^T: its condition stays below a hundred
        affine = np.linalg.solve(self._gram, self._affine.T @ weights - constraints)
        return weights - self._to_affine @ affine, affine

    def _back(self, right: Array) -> Array:
        return _substitute(self._packed, right)


def _substitute(packed: Array, right: Array) -> Array:
    from scipy.linalg import lapack

    if right.size == 0:
        return right
    return lapack.dpftrs(len(right), packed, right, transr="N", uplo="L")[0]


def _orbits(nodes: Index, shape: tuple[int, int, int], along_face: list[int]) -> Index:
    """Numbers (orbits, 4) of each node in one quarter and of its three mirror images."""
    quarter = np.logical_and.reduce([2 * nodes[:, a] <= shape[a] - 1 for a in along_face])
    numbers = np.ravel_multi_index(tuple(nodes.T), shape)  # ascending, as argwhere gives them
    images = []
    for flip in ((), along_face[:1], along_face[1:], along_face):
        image = nodes[quarter].copy()
        for axis in flip:
            image[:, axis] = shape[axis] - 1 - image[:, axis]
        images.append(np.searchsorted(numbers, np.ravel_multi_index(tuple(image.T), shape)))
    return np.stack(images, axis=1)


def _linear_parity(axis: int, along_face: list[int]) -> tuple[int, int]:
    """How the coordinate along an axis behaves under the two reflections."""
    return tuple(-1 if axis == mirrored else 1 for mirrored in along_face)  # type: ignore[return-value]


def _read_block(stream: IO[bytes], size: int) -> Array:
    packed = np.load(stream)
    if packed.shape != (size,) or packed.dtype != np.float64:
        raise ValueError(f"it holds {packed.dtype} {packed.shape}, not {size} numbers")
    return packed
