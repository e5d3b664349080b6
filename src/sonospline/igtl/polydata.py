"""POLYDATA: surfaces, lines and points with values on them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import shown
from .content import Content
from .errors import ContentError, SizeError
from .wire import SINGLE, Reader, field, layout, singles, text_of

_INDEX = np.dtype(">u4")
_KINDS = {"scalars": 0, "vectors": 1, "normals": 2, "tensors": 3, "rgba": 4}
_COMPONENTS = {"vectors": 3, "normals": 3, "tensors": 9, "rgba": 4}
_ON_CELLS = 0x10
_MOST_NAME, _MOST_ATTRIBUTES = 255, 256

Indices = NDArray[np.uint32]


@dataclass(frozen=True, eq=False, repr=False)
class Attribute(Content):
    """Values on the points of :class:`PolyData`, or on its cells.

    Parameters
    ----------
    name : str
        At most 255 bytes.
    values : (n,) or (n, components) array_like
    kind : {"scalars", "vectors", "normals", "tensors", "rgba"}, default: "scalars"
        Vectors and normals have three components, tensors nine, colours four from 0 to 1.
    on_cells : bool, default: False
        The C++ library misreads those on cells.
    """

    name: str
    values: NDArray[np.float32]
    kind: str = "scalars"
    on_cells: bool = False

    def __post_init__(self) -> None:
        field("name", self.name, _MOST_NAME)
        if self.kind not in _KINDS:
            raise ValueError(f"kind = {shown(self.kind)} is not known; choose one of {', '.join(_KINDS)}")
        values = np.asarray(self.values, np.float32)
        values = singles("values", values[:, None] if values.ndim == 1 else values, -1, -1)
        components = values.shape[1]
        if components != _COMPONENTS.get(self.kind, components) or not 1 <= components <= 255:
            wanted = _COMPONENTS.get(self.kind, "1 to 255")
            raise ValueError(f"values have shape {values.shape}; {self.kind} have {wanted} components")
        object.__setattr__(self, "values", values)

    @property
    def code(self) -> int:
        """Its kind and place, as messages number them."""
        return _KINDS[self.kind] + (_ON_CELLS if self.on_cells else 0)

    def __repr__(self) -> str:
        count, components = self.values.shape
        return f"Attribute({shown(self.name)}, {self.kind}, {count} x {components})"


@dataclass(frozen=True, eq=False, repr=False)
class PolyData(Content):
    """Points, and cells that join them.

    Parameters
    ----------
    points : (n, 3) array_like
        RAS mm.
    vertices, lines, polygons, strips : (m, k) array_like or sequence of sequences, optional
        Cells: indices of points. Kept as the wire has them: how many indices, these, and so on.
    attributes : iterable of Attribute, optional

    Raises
    ------
    ValueError
        Indices beyond the points, or values that are not finite.

    Examples
    --------
    >>> from sonospline import igtl
    >>> surface = igtl.PolyData([(0, 0, 0), (1, 0, 0), (0, 1, 0)], polygons=[(0, 1, 2)])
    >>> surface, surface.polygons.tolist()
    (PolyData(3 points, 1 polygons), [3, 0, 1, 2])
    """

    TYPE: ClassVar[str] = "POLYDATA"
    points: NDArray[np.float32]
    vertices: Indices = ()  # type: ignore[assignment]
    lines: Indices = ()  # type: ignore[assignment]
    polygons: Indices = ()  # type: ignore[assignment]
    strips: Indices = ()  # type: ignore[assignment]
    attributes: tuple[Attribute, ...] = ()

    def __post_init__(self) -> None:
        points = self.points if len(self.points) else np.empty((0, 3))
        object.__setattr__(self, "points", singles("points", points, -1, 3))
        for name in _CELLS:
            cells = _flat(name, getattr(self, name))
            _count_cells(name, cells, len(self.points))
            object.__setattr__(self, name, cells)
        object.__setattr__(self, "attributes", tuple(self.attributes))

    def packed(self) -> bytes:
        """Return counts, points, cells and values."""
        cells = [getattr(self, name) for name in _CELLS]
        counts = [number for flat in cells for number in (_count_cells("cells", flat, len(self.points)), 4 * len(flat))]
        parts = [layout("10I").pack(len(self.points), *counts, len(self.attributes))]
        parts += [self.points.astype(SINGLE).tobytes(), *(flat.astype(_INDEX).tobytes() for flat in cells)]
        parts += [layout("BBI").pack(one.code, *one.values.shape[::-1]) for one in self.attributes]
        names = b"".join(field("name", one.name, _MOST_NAME) + b"\0" for one in self.attributes)
        parts += [names, b"\0" * (len(names) % 2), *(one.values.astype(SINGLE).tobytes() for one in self.attributes)]
        return b"".join(parts)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        points, *sizes, attributes = reader.fields("10I")
        places = reader.singles(points, 3)
        cells = {
            name: _cells(reader, count, size, points)
            for name, count, size in zip(_CELLS, sizes[::2], sizes[1::2], strict=True)
        }
        return cls(places, **cells, attributes=_attributes(reader, attributes))

    def __repr__(self) -> str:
        parts = [f"{_count_cells(name, getattr(self, name), len(self.points))} {name}" for name in _CELLS]
        values = [f"{len(self.attributes)} attributes"] if self.attributes else []
        return f"PolyData({', '.join([f'{len(self.points)} points', *(p for p in parts if p[0] != '0'), *values])})"


_CELLS = ("vertices", "lines", "polygons", "strips")


def _flat(name: str, cells: ArrayLike | Sequence[Sequence[int]]) -> Indices:
    """Return cells as the wire has them; those that are so already as they are."""
    if isinstance(cells, np.ndarray) and cells.ndim == 1 and cells.dtype == np.uint32:
        flat = cells.copy() if cells.flags.writeable else cells
    elif isinstance(cells, np.ndarray) and cells.ndim == 2 and cells.dtype.kind in "iu":
        counts = np.full((len(cells), 1), cells.shape[1])
        flat = _indices(name, np.hstack([counts, cells]).ravel())
    elif isinstance(cells, Iterable) and not isinstance(cells, str | np.ndarray):
        rows: list[Any] = list(cells)
        flat = _indices(name, np.array([number for row in rows for number in (len(row), *row)], object))
    else:
        raise ValueError(f"{name} = {shown(cells)} is not a list of cells; give indices of points, a row for each")
    flat.setflags(write=False)
    return flat


def _indices(name: str, numbers: NDArray[Any]) -> Indices:
    if numbers.dtype.kind in "iu":
        fine = not numbers.size or bool(numbers.min() >= 0 and numbers.max() < 1 << 32)
    else:
        fine = all(isinstance(number, int | np.integer) and 0 <= number < 1 << 32 for number in numbers.tolist())
    if not fine:
        raise ValueError(f"{name} have indices that are no whole numbers from 0 on; give indices of points")
    return numbers.astype(np.uint32)


def _count_cells(name: str, flat: Indices, points: int) -> int:
    """Return how many cells there are; ValueError where they do not end with the array or name no point."""
    count = at = 0
    if len(flat) and len(flat) % (step := int(flat[0]) + 1) == 0 and (flat[::step] == step - 1).all():
        count, indices = len(flat) // step, flat.reshape(-1, step)[:, 1:]
    else:
        mask = np.ones(len(flat), bool)
        while at < len(flat):
            mask[at] = False
            at += int(flat[at]) + 1
            count += 1
        if at != len(flat):
            raise SizeError(f"{name} end within a cell: {len(flat)} numbers, the last cell wants {at - len(flat)} more")
        indices = flat[mask]
    if indices.size and indices.max() >= points:
        raise ContentError(f"{name} name point {indices.max()}; there are {points}")
    return count


def _cells(reader: Reader, count: int, size: int, points: int) -> Indices:
    if size % 4:
        raise SizeError(f"{reader.what} has cells of {size} bytes, which is no multiple of 4")
    flat = reader.array(_INDEX, size // 4)
    flat.setflags(write=False)
    if _count_cells(f"cells of {reader.what}", flat, points) != count:
        raise SizeError(f"{reader.what} announces {count} cells; its indices have another number of them")
    return flat


def _attributes(reader: Reader, count: int) -> tuple[Attribute, ...]:
    if count > _MOST_ATTRIBUTES:
        raise ContentError(f"{reader.what} has {count} attributes; at most {_MOST_ATTRIBUTES} are read here")
    heads = [reader.fields("BBI") for _ in range(count)]
    names = [_name(reader) for _ in range(count)]
    reader.bytes(sum(len(name) + 1 for name in names) % 2)
    kinds = {code: name for name, code in _KINDS.items()}
    found = []
    for (code, components, length), name in zip(heads, names, strict=True):
        kind = kinds.get(code & ~_ON_CELLS)
        if kind is None:
            raise ContentError(f"{reader.what} has an attribute of kind {code:#x}; known are 0 to 4 on points or cells")
        values = reader.singles(length, _COMPONENTS.get(kind, components))
        found.append(Attribute(text_of(name), values, kind, on_cells=bool(code & _ON_CELLS)))
    return tuple(found)


def _name(reader: Reader) -> bytes:
    name = bytearray()
    while (byte := bytes(reader.bytes(1))) != b"\0":
        name += byte
        if len(name) > _MOST_NAME:
            raise ContentError(f"{reader.what} has a name of an attribute of more than {_MOST_NAME} bytes")
    return bytes(name)
