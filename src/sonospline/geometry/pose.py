"""Rigid transforms that place an image or a probe in the world.

``ImageToReference`` has its origin at the centre of pixel (0, 0), ``ProbeToReference`` in the
middle of the probe's face. Both are in mm: x to the right (the marked side of the probe), y away
from the transducer, z = x cross y. The reference is the world, RAS mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown

Array = NDArray[np.float64]

_UPRIGHT = np.eye(3)
_NEARLY = 1e-4 + 1e-5 * _UPRIGHT
"""How far files may round."""
_LAST = np.array([0.0, 0.0, 0.0, 1.0])


def rigid(name: str, matrix: ArrayLike, *, within: float | Array = _NEARLY) -> Array:
    """Return a rigid (4, 4) transform, read-only; ValueError for one that shears, scales, mirrors or collapses.

    Products of its columns may be off by ``within``; it is freed of that.
    """
    try:
        transform = np.array(matrix, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {shown(matrix)} is not numeric; give a 4 x 4 matrix") from None
    if transform.shape != (4, 4):
        raise ValueError(f"{name} has shape {transform.shape}; give a 4 x 4 matrix")
    if not np.isfinite(transform).all():
        raise ValueError(f"{name} = {shown(transform.tolist())} contains NaN or infinity; give finite numbers")
    rotation = transform[:3, :3]
    determinant = np.linalg.det(rotation)
    if not (np.abs(rotation.T @ rotation - _UPRIGHT) <= within).all() or determinant < 0:
        raise ValueError(
            f"{name} is not rigid (determinant {determinant:.4g}); its columns must be orthonormal unit vectors in mm, "
            "right-handed: fold pixel sizes into spacing_mm"
        )
    if not (np.abs(transform[3] - _LAST) <= 1e-8 + 1e-5 * _LAST).all():
        raise ValueError(f"{name} has the last row {transform[3].tolist()}; give 0, 0, 0, 1")
    left, _, right = np.linalg.svd(rotation)
    transform[:3, :3] = left @ right
    transform.setflags(write=False)
    return transform


def facing(origin: ArrayLike, *, depth: ArrayLike, right: ArrayLike) -> Array:
    """Return the pose of what lies at ``origin`` and looks along ``depth``.

    With the middle of a probe's face it is the probe's ``ProbeToReference``, with the centre of pixel (0, 0)
    an image's ``ImageToReference``.

    Parameters
    ----------
    origin : (3,) array_like
        World position of the middle of the probe's face, or of the first pixel.
    depth : (3,) array_like
        World direction away from the transducer: y.
    right : (3,) array_like
        World direction of x; its part along ``depth`` is taken out.

    Raises
    ------
    ValueError
        Directions that are zero or parallel.

    Examples
    --------
    >>> from sonospline.geometry import facing
    >>> facing((50, 50, 0), depth=(0, 0, 1), right=(1, 0, 0))[:3, 2].tolist()
    [0.0, -1.0, 0.0]
    """
    start = _validate.vector("origin", origin)
    y, x = _validate.vector("depth", depth), _validate.vector("right", right)
    if not y.any():
        raise ValueError("depth = [0, 0, 0] has no direction; give a vector away from the transducer")
    y = y / np.linalg.norm(y)
    across = x - (x @ y) * y
    if np.linalg.norm(across) <= 1e-9 * max(1.0, float(np.linalg.norm(x))):
        raise ValueError(f"right = {x.tolist()} is zero or parallel to depth; give a vector across it")
    x = across / np.linalg.norm(across)
    transform = np.eye(4)
    transform[:3] = np.column_stack([x, y, np.cross(x, y), start])
    transform.setflags(write=False)
    return transform


def pose_along(tip: Array, direction: Array) -> Array:
    """Return a pose (4, 4) at a tip with z along a needle; x is square to the world's axis that it is furthest from."""
    z = direction / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3] = np.column_stack([x, np.cross(z, x), z, tip])
    return pose


def shifted(transform: Array, x: float, y: float) -> Array:
    """Return a pose whose origin lies at (x, y, 0) mm of another one, turned as it is.

    Examples
    --------
    >>> from sonospline.geometry import facing, shifted
    >>> probe_to_reference = facing((50, 50, 0), depth=(0, 0, 1), right=(1, 0, 0))
    >>> shifted(probe_to_reference, -19, 0)[:3, 3].tolist()
    [31.0, 50.0, 0.0]
    """
    moved = transform.copy()
    moved[:3, 3] = transform[:3, 3] + x * transform[:3, 0] + y * transform[:3, 1]
    moved.setflags(write=False)
    return moved


def to_reference(transform: Array, points: ArrayLike) -> Array:
    """Return image points (m, 3), or one (3,), in reference coordinates."""
    return np.asarray(points) @ transform[:3, :3].T + transform[:3, 3]


def to_image(transform: Array, points: ArrayLike) -> Array:
    """Return reference points (m, 3), or one (3,), in image coordinates; inverse of :func:`to_reference`."""
    return (np.asarray(points) - transform[:3, 3]) @ transform[:3, :3]
