"""SENSOR and NDARRAY: readings, and arrays of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from .._shown import shown, size
from .content import Content
from .errors import ContentError
from .scalars import NUMBERS, code_of, kind_of
from .wire import DOUBLE, Reader, finite, layout, whole

_MOST_AXES = 32
"""As many as every NumPy in use takes."""
_UNITS = (
    "", "meter", "gram", "second", "ampere", "kelvin", "mole", "candela", "radian", "steradian", "hertz", "newton",
    "pascal", "joule", "watt", "coulomb", "volt", "farad", "ohm", "siemens", "weber", "tesla", "henry", "lumen", "lux",
    "becquerel", "gray", "sievert",
)  # fmt: skip
_PREFIXES = {
    "": 0, "deka": 1, "hecto": 2, "kilo": 3, "mega": 4, "giga": 5, "tera": 6, "peta": 7, "deci": 9, "centi": 10,
    "milli": 11, "micro": 12, "nano": 13, "pico": 14, "femto": 15,
}  # fmt: skip


def unit(*factors: str | tuple[str, int], prefix: str = "") -> int:
    """Return a unit as SENSOR messages number it.

    Parameters
    ----------
    *factors : str or (str, int)
        Names of SI units (``"newton"``), at most six, with their powers from -7 to 7 where they are not 1.
    prefix : str, optional
        Of the whole (``"milli"``).

    Examples
    --------
    >>> from sonospline import igtl
    >>> hex(igtl.unit("newton")), hex(igtl.unit("meter", ("second", -2), prefix="milli"))
    ('0x2c4000000000000', '0xb0443e0000000000')
    """
    if prefix not in _PREFIXES:
        raise ValueError(f"prefix = {shown(prefix)} is not known; choose one of {', '.join(_PREFIXES)}")
    if len(factors) > 6:
        raise ValueError(f"{len(factors)} factors were given; give at most 6")
    number = _PREFIXES[prefix]
    for factor in (*factors, *[("", 0)] * (6 - len(factors))):
        name, power = factor if isinstance(factor, tuple) else (factor, 1)
        if name not in _UNITS:
            raise ValueError(f"unit = {shown(name)} is not known; choose one of {', '.join(_UNITS[1:])}")
        number = number << 10 | _UNITS.index(name) << 4 | whole("power", power, 7, -7) & 15
    return number


@dataclass(frozen=True, eq=False, repr=False)
class Sensor(Content):
    """Readings of one sensor at one moment.

    Parameters
    ----------
    values : (n,) array_like
        At most 255, finite.
    unit : int, default: 0
        See :func:`unit`.
    status : int, default: 0

    Examples
    --------
    >>> from sonospline import igtl
    >>> igtl.Sensor((1.5, 0, 0), igtl.unit("newton"))
    Sensor(3 values, unit 0x2c4000000000000)
    """

    TYPE: ClassVar[str] = "SENSOR"
    values: NDArray[np.float64]
    unit: int = 0
    status: int = 0

    def __post_init__(self) -> None:
        values = np.array(self.values, float)
        if values.ndim != 1 or len(values) > 255:
            raise ValueError(f"values have shape {values.shape}; give at most 255 in a row")
        values.setflags(write=False)
        object.__setattr__(self, "values", finite("values", values))
        whole("unit", self.unit, (1 << 64) - 1)
        whole("status", self.status, 255)

    def packed(self) -> bytes:
        """Return how many there are, status, unit and readings."""
        return layout("BBQ").pack(len(self.values), self.status, self.unit) + self.values.astype(DOUBLE).tobytes()

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        count, status, number = reader.fields("BBQ")
        return cls(finite(reader.what, reader.array(DOUBLE, count)), number, status)

    def __repr__(self) -> str:
        return f"Sensor({len(self.values)} values, unit {self.unit:#x})"


@dataclass(frozen=True, eq=False, repr=False)
class NumberArray(Content):
    """An array of numbers, of whatever meaning; 3D Slicer leaves these messages out.

    Parameters
    ----------
    array : array_like
        1 to 32 axes of at most 65,535 entries each; whole numbers of 8, 16 or 32 bits, floating point of 32 or 64,
        or complex of 128.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline import igtl
    >>> igtl.NumberArray(np.zeros((2, 3)))
    NumberArray(2 x 3 float64)
    """

    TYPE: ClassVar[str] = "NDARRAY"
    array: NDArray[Any]

    def __post_init__(self) -> None:
        array = np.array(self.array, order="C")
        if not 1 <= array.ndim <= _MOST_AXES or max(array.shape) > 0xFFFF:
            raise ValueError(f"array has shape {array.shape}; give 1 to {_MOST_AXES} axes of at most 65535 entries")
        code_of("array's numbers", array.dtype, NUMBERS)
        array = array.astype(array.dtype.newbyteorder("="))
        array.setflags(write=False)
        object.__setattr__(self, "array", array)

    def packed(self) -> bytes:
        """Return type, shape and numbers."""
        axes, kind = self.array.ndim, self.array.dtype
        header = layout(f"BB{axes}H").pack(code_of("array's numbers", kind, NUMBERS), axes, *self.array.shape)
        return header + self.array.astype(kind.newbyteorder(">")).tobytes()

    @classmethod
    def unpacked(cls, reader: Reader) -> Self:
        """Return what bytes hold."""
        code, axes = reader.fields("BB")
        kind = kind_of(reader.what, code, NUMBERS).newbyteorder(">")
        if not 1 <= axes <= _MOST_AXES:
            raise ContentError(f"{reader.what} has {axes} axes; 1 to {_MOST_AXES} are read here")
        return cls(reader.array(kind, *reader.fields(f"{axes}H")))

    def __repr__(self) -> str:
        return f"NumberArray({size(self.array.shape)} {self.array.dtype})"
