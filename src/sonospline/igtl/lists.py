"""POINT, IMGMETA, LBMETA: lists of entries of one length each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from .._shown import place, shown, size
from .content import Content
from .scalars import SCALARS, kind_of
from .stamp import MOST_STAMP
from .wire import Reader, field, layout, singles, text_of, whole

_LONG, _GROUP, _ID = 64, 32, 20
Colour = tuple[int, int, int, int]
Size = tuple[int, int, int]
_MOST = 0xFFFF


@dataclass(frozen=True, eq=False, repr=False)
class Point(Content):
    """A point with a name, as a fiducial of 3D Slicer.

    Parameters
    ----------
    position : (3,) array_like
        RAS mm.
    name : str, optional
        At most 64 bytes.
    group : str, default: "Fiducial"
        At most 32 bytes.
    colour : (4,) ints, default: yellow
        Red, green, blue, opacity, 0 to 255.
    diameter_mm : float, default: 0
    owner : str, optional
        Name of the image that it belongs to, at most 20 bytes.
    """

    position: NDArray[np.float32]
    name: str = ""
    group: str = "Fiducial"
    colour: Colour = (255, 255, 0, 255)
    diameter_mm: float = 0.0
    owner: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", singles("position", self.position, 3))
        object.__setattr__(self, "diameter_mm", float(singles("diameter_mm", self.diameter_mm)))
        object.__setattr__(self, "colour", _bytes("colour", self.colour))
        field("name", self.name, _LONG), field("group", self.group, _GROUP), field("owner", self.owner, _ID)

    def packed(self) -> bytes:
        """Return its fields."""
        return layout("64s32s4B4f20s").pack(
            field("name", self.name, _LONG), field("group", self.group, _GROUP), *self.colour,
            *self.position.tolist(), self.diameter_mm, field("owner", self.owner, _ID),
        )  # fmt: skip

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return the next one."""
        name, group, colour = reader.text(_LONG), reader.text(_GROUP), reader.fields("4B")
        *position, diameter = reader.singles(4)
        return cls(np.array(position), name, group, colour, float(diameter), reader.text(_ID))

    def __repr__(self) -> str:
        return f"Point({place(self.position)}, {shown(self.name)})"


@dataclass(frozen=True, eq=False, repr=False)
class ImageEntry(Content):
    """What one image is, in a list of images.

    Parameters
    ----------
    id : str
        Its device name, by which GET_IMAGE asks for it; at most 20 bytes.
    size : (3,) ints
        Voxels along i, j, k.
    scalar : str, default: "uint8"
        Type of its voxels.
    name : str, optional
        At most 64 bytes; patient_name and patient_id, too.
    modality : str, default: "US"
        At most 32 bytes.
    stamp : int, default: 0
    """

    id: str
    size: Size
    scalar: str = "uint8"
    name: str = ""
    modality: str = "US"
    patient_name: str = ""
    patient_id: str = ""
    stamp: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _size(self.size))
        self.packed()

    def packed(self) -> bytes:
        """Return its fields."""
        codes = {str(kind): code for code, kind in SCALARS.items()}
        if self.scalar not in codes:
            raise ValueError(f"scalar = {shown(self.scalar)} is not known; choose one of {', '.join(codes)}")
        return layout("64s20s32s64s64sQ3HBx").pack(
            field("name", self.name, _LONG), field("id", self.id, _ID), field("modality", self.modality, _GROUP),
            field("patient_name", self.patient_name, _LONG), field("patient_id", self.patient_id, _LONG),
            whole("stamp", self.stamp, MOST_STAMP), *self.size, codes[self.scalar],
        )  # fmt: skip

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return the next one."""
        *texts, stamp, i, j, k, scalar = reader.fields("64s20s32s64s64sQ3HBx")
        name, id_, modality, patient, patient_id = map(text_of, texts)
        kind = str(kind_of(reader.what, scalar, SCALARS))
        return cls(id_, (i, j, k), kind, name, modality, patient, patient_id, stamp)

    def __repr__(self) -> str:
        return f"ImageEntry({shown(self.id)}, {size(self.size)} {self.scalar})"


@dataclass(frozen=True, eq=False, repr=False)
class LabelEntry(Content):
    """What one structure of a label map is, in a list of structures.

    Parameters
    ----------
    id : str
        Device name of its image; at most 20 bytes.
    label : int
        Its value in the label map, 0 to 255.
    name : str, optional
        At most 64 bytes.
    colour : (4,) ints, default: none
    size : (3,) ints, default: unknown
        Voxels of its box along i, j, k.
    owner : str, optional
        Name of the image that it belongs to; at most 20 bytes.
    """

    id: str
    label: int
    name: str = ""
    colour: Colour = (0, 0, 0, 0)
    size: Size = (0, 0, 0)
    owner: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", _size(self.size))
        object.__setattr__(self, "colour", _bytes("colour", self.colour))
        self.packed()

    def packed(self) -> bytes:
        """Return its fields."""
        return layout("64s20sBx4B3H20s").pack(
            field("name", self.name, _LONG), field("id", self.id, _ID), whole("label", self.label, 255),
            *self.colour, *self.size, field("owner", self.owner, _ID),
        )  # fmt: skip

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return the next one."""
        name, id_, label, r, g, b, a, i, j, k, owner = reader.fields("64s20sBx4B3H20s")
        return cls(text_of(id_), label, text_of(name), (r, g, b, a), (i, j, k), text_of(owner))

    def __repr__(self) -> str:
        return f"LabelEntry({shown(self.id)}, {self.label}: {shown(self.name)})"


class _Entries(Content):
    """Entries one after the other, as many as there are bytes."""

    ENTRY: ClassVar[Any]
    entries: tuple[Any, ...]

    def __post_init__(self) -> None:
        found = tuple(self.entries)
        for entry in found:
            if not isinstance(entry, self.ENTRY):
                raise ValueError(f"{shown(entry)} is not {self.ENTRY.__name__}; give some")
        object.__setattr__(self, "entries", found)

    def packed(self) -> bytes:
        """Return one after the other."""
        return b"".join(entry.packed() for entry in self.entries)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return as many as there are."""
        found = []
        while reader.left:
            found.append(cls.ENTRY.unpacked(reader))
        return cls(tuple(found))  # type: ignore[call-arg]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.entries)} entries)"


@dataclass(frozen=True, eq=False, repr=False)
class Points(_Entries):
    """A list of points.

    Parameters
    ----------
    entries : iterable of Point

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.Points([igtl.Point((1, 2, 3), "target")]).entries
    (Point((1, 2, 3), 'target'),)
    """

    TYPE: ClassVar[str] = "POINT"
    ENTRY: ClassVar[Any] = Point
    entries: tuple[Point, ...]


@dataclass(frozen=True, eq=False, repr=False)
class ImageList(_Entries):
    """Which images there are.

    Parameters
    ----------
    entries : iterable of ImageEntry
    """

    TYPE: ClassVar[str] = "IMGMETA"
    ENTRY: ClassVar[Any] = ImageEntry
    entries: tuple[ImageEntry, ...]


@dataclass(frozen=True, eq=False, repr=False)
class LabelList(_Entries):
    """Which structures label maps have.

    Parameters
    ----------
    entries : iterable of LabelEntry
    """

    TYPE: ClassVar[str] = "LBMETA"
    ENTRY: ClassVar[Any] = LabelEntry
    entries: tuple[LabelEntry, ...]


def _bytes(name: str, values: Iterable[int]) -> Colour:
    return _wholes(name, values, 4, 255)  # type: ignore[return-value]


def _size(values: Iterable[int]) -> Size:
    return _wholes("size", values, 3, _MOST)  # type: ignore[return-value]


def _wholes(name: str, values: Iterable[int], count: int, most: int) -> tuple[int, ...]:
    found = tuple(values) if isinstance(values, Iterable) else ()
    if len(found) != count:
        raise ValueError(f"{name} = {shown(values)} is not {count} whole numbers; give them")
    return tuple(whole(name, value, most) for value in found)
