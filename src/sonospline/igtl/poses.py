"""TRANSFORM, POSITION, QTRANS: one pose. TDATA, QTDATA: those of several tools at one moment."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import place, shown
from .content import Content
from .errors import ContentError
from .wire import SINGLE, Reader, field, layout, singles, whole

Singles = NDArray[np.floating[Any]]
_NAME = 20
_UNIT_WITHIN = 1e-3
"""How far the length of a quaternion may be from 1: more than rounding to 32 bits ever does."""


@dataclass(frozen=True, eq=False, repr=False)
class Transform(Content):
    """A linear transform, as tools, probes and images have it; ``NeedleToReference`` is in the message's device name.

    Parameters
    ----------
    matrix : (4, 4) array_like
        In mm; its last row is 0, 0, 0, 1. Kept in 32 bits, as the wire carries it.

    Raises
    ------
    ValueError
        Another shape, numbers that are not finite, or another last row.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> igtl.Transform(np.eye(4))
    Transform(origin (0, 0, 0))
    """

    TYPE: ClassVar[str] = "TRANSFORM"
    matrix: Singles

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", _affine("matrix", self.matrix))

    @property
    def rigid(self) -> NDArray[np.float64]:
        """(4, 4) the same, freed of rounding; ContentError where it scales, shears or mirrors."""
        return _rigid(self.matrix)

    def packed(self) -> bytes:
        """Return the columns of the matrix, without its last row."""
        return _columns(self.matrix)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        return cls(_read_columns(reader))

    def __repr__(self) -> str:
        return f"Transform(origin {place(self.matrix[:3, 3])})"


@dataclass(frozen=True, eq=False, repr=False)
class Position(Content):
    """A rigid pose as a place and a quaternion.

    Parameters
    ----------
    position : (3,) array_like
        mm.
    quaternion : (4,) array_like, default: no rotation
        x, y, z, w. It may have any length, as the wire does; :attr:`matrix` wants 1.

    Raises
    ------
    ValueError
        Numbers that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> pose = igtl.Position((1, 2, 3), (0, 0, 1, 0))
    >>> pose.matrix[:3].tolist()
    [[-1.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]]
    """

    TYPE: ClassVar[str] = "POSITION"
    position: Singles
    quaternion: Singles = (0, 0, 0, 1)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", singles("position", self.position, 3))
        object.__setattr__(self, "quaternion", singles("quaternion", self.quaternion, 4))

    @classmethod
    def of(cls, matrix: ArrayLike) -> Self:
        """Return the pose of a rigid (4, 4) matrix."""
        position, quaternion = _place_and_quaternion(matrix)
        return cls(position, quaternion)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) the pose as a matrix; ContentError where the quaternion is none of length 1."""
        return _matrix(self.position, self.quaternion)

    def packed(self) -> bytes:
        """Return place and quaternion."""
        return _packed(self.position, self.quaternion)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold: a place alone, or one with three or four numbers of a quaternion."""
        position = reader.singles(3)
        if not reader.left:
            return cls(position)
        if reader.left == 12:
            vector = reader.singles(3)
            return cls(position, np.append(vector, np.sqrt(max(0.0, 1 - float(vector @ vector)))))
        return cls(position, reader.singles(4))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({place(self.position)}, {place(self.quaternion)})"


class QuaternionTransform(Position):
    """A rigid pose, in the bytes of a :class:`Position`, as a message of type QTRANS."""

    TYPE: ClassVar[str] = "QTRANS"


@dataclass(frozen=True, eq=False, repr=False)
class Tool(Content):
    """One tool of :class:`TrackingData`.

    Parameters
    ----------
    name : str
        As devices are called; at most 20 bytes.
    matrix : (4, 4) array_like
        In mm.
    kind : int, default: 2
        1: tracker, 2: tool with a pose, 3: its tip alone, 4: tip and direction.
    """

    name: str
    matrix: Singles
    kind: int = 2

    def __post_init__(self) -> None:
        field("name", self.name, _NAME)
        whole("kind", self.kind, 255)
        object.__setattr__(self, "matrix", _affine("matrix", self.matrix))

    @property
    def rigid(self) -> NDArray[np.float64]:
        """(4, 4) the same, freed of rounding; ContentError where it scales, shears or mirrors."""
        return _rigid(self.matrix)

    def packed(self) -> bytes:
        """Return name, kind and matrix."""
        return layout("20sBx").pack(field("name", self.name, _NAME), self.kind) + _columns(self.matrix)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return the next one."""
        name, kind = reader.text(_NAME), reader.fields("Bx")[0]
        return cls(name, _read_columns(reader), kind)

    def __repr__(self) -> str:
        return f"Tool({shown(self.name)}, origin {place(self.matrix[:3, 3])})"


@dataclass(frozen=True, eq=False, repr=False)
class QuaternionTool(Content):
    """One tool of :class:`QuaternionTrackingData`: a :class:`Tool` by place and quaternion."""

    name: str
    position: Singles
    quaternion: Singles = (0, 0, 0, 1)  # type: ignore[assignment]
    kind: int = 2

    def __post_init__(self) -> None:
        field("name", self.name, _NAME)
        whole("kind", self.kind, 255)
        object.__setattr__(self, "position", singles("position", self.position, 3))
        object.__setattr__(self, "quaternion", singles("quaternion", self.quaternion, 4))

    @classmethod
    def of(cls, name: str, matrix: ArrayLike) -> Self:
        """Return a tool at the pose of a rigid (4, 4) matrix."""
        position, quaternion = _place_and_quaternion(matrix)
        return cls(name, position, quaternion)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(4, 4) the pose as a matrix; ContentError where the quaternion is none of length 1."""
        return _matrix(self.position, self.quaternion)

    def packed(self) -> bytes:
        """Return name, kind, place and quaternion."""
        front = layout("20sBx").pack(field("name", self.name, _NAME), self.kind)
        return front + _packed(self.position, self.quaternion)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return the next one."""
        name, kind = reader.text(_NAME), reader.fields("Bx")[0]
        return cls(name, reader.singles(3), reader.singles(4), kind)

    def __repr__(self) -> str:
        return f"QuaternionTool({shown(self.name)}, {place(self.position)}, {place(self.quaternion)})"


class _Tools(Content):
    """Tools one after the other, as many as there are bytes."""

    TOOL: ClassVar[Any]
    tools: tuple[Any, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "tools", _all_of(self.TOOL, self.tools))

    def packed(self) -> bytes:
        """Return one after the other."""
        return b"".join(tool.packed() for tool in self.tools)

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return as many as there are."""
        found = []
        while reader.left:
            found.append(cls.TOOL.unpacked(reader))
        return cls(tuple(found))  # type: ignore[call-arg]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({shown(', '.join(tool.name for tool in self.tools))})"


@dataclass(frozen=True, eq=False, repr=False)
class TrackingData(_Tools):
    """Poses of several tools at one moment.

    Parameters
    ----------
    tools : iterable of Tool
    """

    TYPE: ClassVar[str] = "TDATA"
    TOOL: ClassVar[Any] = Tool
    tools: tuple[Tool, ...]


@dataclass(frozen=True, eq=False, repr=False)
class QuaternionTrackingData(_Tools):
    """Poses of several tools at one moment, by quaternions.

    Parameters
    ----------
    tools : iterable of QuaternionTool
    """

    TYPE: ClassVar[str] = "QTDATA"
    TOOL: ClassVar[Any] = QuaternionTool
    tools: tuple[QuaternionTool, ...]


def _all_of(kind: Any, items: Iterable[Any]) -> tuple[Any, ...]:
    found = tuple(items)
    for item in found:
        if not isinstance(item, kind):
            raise ValueError(f"{shown(item)} is not a {kind.__name__}; give one")
    return found


def _affine(name: str, matrix: ArrayLike) -> Singles:
    found = singles(name, matrix, 4, 4)
    if found[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"{name} has the last row {found[3].tolist()}; give 0, 0, 0, 1")
    return found


def _columns(matrix: Singles) -> bytes:
    return matrix[:3].T.astype(SINGLE).tobytes()


def _read_columns(reader: Reader) -> Singles:
    matrix = np.eye(4, dtype=np.float32)
    matrix[:3] = reader.singles(4, 3).T
    return matrix


def _packed(position: Singles, quaternion: Singles) -> bytes:
    return np.concatenate([position, quaternion]).astype(SINGLE).tobytes()


def _rigid(matrix: ArrayLike) -> NDArray[np.float64]:
    from ..geometry.pose import rigid

    try:
        return rigid("matrix", matrix)
    except ValueError as error:
        raise ContentError(str(error)) from None


def _place_and_quaternion(matrix: ArrayLike) -> tuple[Singles, Singles]:
    from scipy.spatial.transform import Rotation  # which takes as long to load as the rest of the link

    pose = _rigid(matrix)
    return pose[:3, 3].astype(np.float32), Rotation.from_matrix(pose[:3, :3]).as_quat().astype(np.float32)


def _matrix(position: Singles, quaternion: Singles) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > _UNIT_WITHIN:
        raise ContentError(f"quaternion = {place(quaternion)} has length {length:.4g} and is no rotation; give 1")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    pose[:3, 3] = position
    return pose
