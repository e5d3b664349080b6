"""IMAGE: voxels and where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import size
from .content import Content
from .errors import ContentError
from .scalars import SCALARS, code_of, kind_of
from .wire import Reader, layout, singles

_VERSION, _RAS, _LPS, _BIG, _LITTLE = 1, 1, 2, 1, 2
_LAYOUT = "HBBBB3H12f6H"
_MOST = 0xFFFF


@dataclass(frozen=True, eq=False, repr=False)
class Image(Content):
    """An image in RAS mm.

    The wire says where the middle of the image's centres of voxels is, not where voxel (0, 0, 0) is: :meth:`of` and
    :attr:`ijk_to_reference` translate. An image that comes in LPS is turned into RAS; one that goes out is RAS.

    Parameters
    ----------
    voxels : (k, j, i) or (k, j, i, components) array_like
        Whole numbers of 8, 16 or 32 bits, or floating point of 32 or 64.
    axes : (3, 3) array_like
        Columns: the steps from a voxel to the next along i, j, k.
    centre : (3,) array_like
        The middle between the first and the last voxel.

    Raises
    ------
    ValueError
        Voxels of another type or number of axes, more than 65,535 along one, or places that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> place = np.diag([0.5, 0.5, 1.0, 1.0])
    >>> image = igtl.Image.of(np.zeros((1, 3, 5), np.uint8), place)
    >>> image, image.centre.tolist(), bool((image.ijk_to_reference == place).all())
    (Image(5 x 3 x 1 uint8), [1.0, 0.5, 0.0], True)
    """

    TYPE: ClassVar[str] = "IMAGE"
    voxels: NDArray[Any]
    axes: NDArray[np.float32]
    centre: NDArray[np.float32]

    def __post_init__(self) -> None:
        voxels = np.asarray(self.voxels)
        if voxels.ndim not in (3, 4) or not voxels.size or max(voxels.shape[:3]) > _MOST:
            raise ValueError(f"voxels have shape {voxels.shape}; give k x j x i of them, each 1 to {_MOST}")
        if voxels.ndim == 4 and voxels.shape[3] > 255:
            raise ValueError(f"voxels have {voxels.shape[3]} components; give at most 255")
        code_of("voxels", voxels.dtype, SCALARS)
        voxels = voxels.astype(voxels.dtype.newbyteorder("="), order="C", copy=voxels.flags.writeable)
        voxels.setflags(write=False)
        object.__setattr__(self, "voxels", voxels)
        object.__setattr__(self, "axes", singles("axes", self.axes, 3, 3))
        object.__setattr__(self, "centre", singles("centre", self.centre, 3))

    @classmethod
    def of(cls, voxels: ArrayLike, ijk_to_reference: ArrayLike) -> Self:
        """Return an image by the (4, 4) transform of its indices: sizes of voxels in its columns, RAS mm."""
        found, matrix = np.asarray(voxels), np.asarray(ijk_to_reference, float)
        if matrix.shape != (4, 4):
            raise ValueError(f"ijk_to_reference has shape {matrix.shape}; give a 4 x 4 matrix")
        middle = (np.array(found.shape[2::-1]) - 1) / 2
        if middle.shape != (3,):
            raise ValueError(f"voxels have shape {found.shape}; give k x j x i of them")
        return cls(found, matrix[:3, :3], matrix[:3, :3] @ middle + matrix[:3, 3])

    @property
    def size(self) -> tuple[int, int, int]:
        """Voxels along i, j, k."""
        k, j, i = self.voxels.shape[:3]
        return i, j, k

    @property
    def ijk_to_reference(self) -> NDArray[np.float64]:
        """(4, 4) from indices to RAS mm."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes
        matrix[:3, 3] = self.centre - matrix[:3, :3] @ ((np.array(self.size) - 1) / 2)
        return matrix

    def packed(self) -> bytes:
        """Return the header of the image and its voxels, little-endian, whole and in RAS."""
        return b"".join(self.parts())

    def parts(self) -> tuple[bytes | memoryview, ...]:
        """Return the header and the voxels."""
        components = self.voxels.shape[3] if self.voxels.ndim == 4 else 1
        header = layout(_LAYOUT).pack(
            _VERSION, components, code_of("voxels", self.voxels.dtype, SCALARS), _LITTLE, _RAS, *self.size,
            *self.axes.T.ravel().tolist(), *self.centre.tolist(), 0, 0, 0, *self.size,
        )  # fmt: skip
        voxels = self.voxels.astype(self.voxels.dtype.newbyteorder("<"), copy=False)
        return header, voxels.reshape(-1).view(np.uint8).data

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        version, components, scalar, endian, coordinates, *rest = reader.fields(_LAYOUT)
        lengths, places, offset, part = rest[:3], rest[3:15], rest[15:18], rest[18:]
        if version != _VERSION:
            raise ContentError(f"{reader.what} has the image header of version {version}; {_VERSION} is known here")
        if endian not in (_BIG, _LITTLE) or coordinates not in (_RAS, _LPS):
            raise ContentError(f"{reader.what} has byte order {endian}, coordinates {coordinates}; each is 1 or 2")
        if not components or not all(lengths):
            raise ContentError(f"{reader.what} is {size(lengths)} with {components} components: it has no voxels")
        if any(offset) or part != lengths:
            raise ContentError(f"{reader.what} is a part of an image, {size(part)} of {size(lengths)}; send it whole")
        kind = kind_of(reader.what, scalar, SCALARS).newbyteorder("<" if endian == _LITTLE else ">")
        shape = lengths[::-1] if components == 1 else [*lengths[::-1], components]
        flip = np.array([-1, -1, 1] if coordinates == _LPS else [1, 1, 1], np.float32)
        columns = np.array(places, np.float32).reshape(4, 3) * flip
        voxels = reader.array(kind, *shape)
        voxels.setflags(write=False)  # it is nobody else's: the image need not copy it
        return cls(voxels, columns[:3].T, columns[3])

    def __repr__(self) -> str:
        components = f" x {self.voxels.shape[3]} components" if self.voxels.ndim == 4 else ""
        return f"Image({size(self.size)}{components} {self.voxels.dtype})"
