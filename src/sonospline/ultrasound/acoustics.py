"""Acoustic properties of tissue: published defaults, and their table as CSV.

Sources of the table, read as tables or abstracts: [1] Bioengineering 2025;12:946, appendix A.
[2] Mech. Mater. 2012;44:174, table 3. [3] Diagnostics 2023;13:855, table 4. [4] Sensors 2023;23:5942,
table A2. [5] Ultrasound Med. Biol. 1999;25:1047. [6] Ultrasound Med. Biol. 1988;14:127. [7] Med. Ultrason.
2013;15:16. [8] Ultrasound Med. Biol. 1991;17:613. [9] J. Acoust. Soc. Am. 1985;78:871. [10] Diagnostics
2015, kidney sonography. "set" marks what was chosen by eye against real images. Speeds scatter by 3 %
between sources.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._core.textures import KINDS, texture_map
from ..io.tables import read_by_label
from ..io.writing import write_text

Texture = Literal["blobs", "fibres", "strands", "triads"]

NO_ECHO = -200.0
"""Backscatter of a fluid, dB: none."""


@dataclass(frozen=True, kw_only=True)
class AcousticTissue:
    """What ultrasound meets in one tissue.

    Parameters
    ----------
    name : str
        Its name, the key of the table.
    speed_m_s, density_kg_m3 : float
        Their product is the impedance Z, whose steps reflect.
    attenuation_db_cm_mhz : float
        One way.
    backscatter_db : float
        Level of its speckle relative to liver (0.5e-3 /cm/sr at 3 MHz [5]); :data:`NO_ECHO` for a fluid.
    texture_db : float, default: 0
        Standard deviation of the level from place to place (fibres, lobules).
    texture_mm : (float, float, float), default: (3, 3, 3)
        Correlation length of that along the texture's direction, and across it: along the phantom's axes by default.
    source : str, default: ""
        Where the numbers come from.
    roughness_db : float, default: -15
        Diffuse echo of its surface below that of a mirror, -12 (rough) to -18 (smooth); of two tissues, the
        rougher counts. Set by eye.
    wall_mm : float, default: 0
        Thickness of the wall around it, where it is a fluid: of a vessel, a bladder.
    texture : {"blobs", "fibres", "strands", "triads"}, default: "blobs"
        What varies: smoothly; thin bright sheets as between the fibrils of muscle; a wide net of them as the septa of
        fat; bright-walled tubes as the portal triads of liver.
    texture_direction : (float, float, float), default: (1, 0, 0)
        Along what, in the phantom's axes.

    Raises
    ------
    ValueError
        A number that is not finite or out of range, an unknown texture, or a direction of length zero.
    """

    name: str
    speed_m_s: float
    density_kg_m3: float
    attenuation_db_cm_mhz: float
    backscatter_db: float
    texture_db: float = 0.0
    texture_mm: tuple[float, float, float] = (3.0, 3.0, 3.0)
    source: str = field(default="", repr=False)
    roughness_db: float = -15.0
    wall_mm: float = 0.0
    texture: Texture = field(default="blobs", repr=False)
    texture_direction: tuple[float, float, float] = field(default=(1.0, 0.0, 0.0), repr=False)

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "density_kg_m3"):
            _validate.number(name, getattr(self, name), positive=True)
        for name in ("attenuation_db_cm_mhz", "texture_db", "wall_mm"):
            _validate.number(name, getattr(self, name))
        if not NO_ECHO <= self.backscatter_db <= 40:
            raise ValueError(
                f"backscatter_db = {self.backscatter_db} of {self.name}; give {NO_ECHO:g} to 40 dB re liver"
            )

        for axis, length in enumerate(self.texture_mm):
            _validate.number(f"texture_mm[{axis}]", length, positive=True)
        _validate.choice("texture", self.texture, KINDS)
        texture_map(self.texture_direction, self.texture_mm)
        if not -60 <= self.roughness_db <= 0:
            raise ValueError(f"roughness_db = {self.roughness_db} of {self.name}; give -60 to 0 dB below a mirror")

    @property
    def texture_kind(self) -> int:
        """The texture's number among all."""
        return KINDS.index(self.texture)

    @property
    def texture_map(self) -> NDArray[np.float64]:
        """What takes mm along the phantom's axes to voxels of the texture, (3, 3)."""
        return texture_map(self.texture_direction, self.texture_mm)

    @property
    def impedance(self) -> float:
        """Z in MRayl."""
        return 1e-6 * self.speed_m_s * self.density_kg_m3


def _tissue(
    name: str,
    c: float,
    rho: float,
    alpha: float,
    level: float,
    source: str,
    texture_db: float = 0.0,
    texture_mm: tuple[float, float, float] = (3.0, 3.0, 3.0),
) -> AcousticTissue:
    return AcousticTissue(
        name=name,
        speed_m_s=c,
        density_kg_m3=rho,
        attenuation_db_cm_mhz=alpha,
        backscatter_db=level,
        texture_db=texture_db,
        texture_mm=texture_mm,
        source=source,
    )


_DEFAULTS = (
    _tissue("gel", 1480, 1000, 0.002, NO_ECHO, "alpha [3]; c, rho as water"),
    _tissue("skin", 1620, 1110, 0.6, 6, "c, rho [1][2]; alpha 0.35 [3], set; level set", 1.0),
    _tissue("fat", 1465, 940, 0.63, -7, "c, rho [1][2]; alpha [3]; level set", 2.5, (6, 6, 1.2)),
    _tissue("perirenal fat", 1465, 940, 0.63, 3, "as fat; level set", 2.0, (6, 6, 2.5)),
    _tissue("sinus fat", 1470, 950, 0.63, 9, "as fat; bright [10]; level set", 2.5, (3, 3, 2)),
    _tissue("muscle", 1580, 1055, 1.0, -6, "c, rho [1]; alpha 0.96-1.4 [3][4]; level set", 3.5, (12, 6, 1.0)),
    _tissue("fascia", 1640, 1090, 1.0, 0, "as tendon [2]; level set"),
    _tissue("liver", 1575, 1058, 0.5, 0, "c, rho [1][2]; alpha [3][5][6]; level [5]", 0.8, (4, 4, 4)),
    _tissue("kidney cortex", 1560, 1052, 0.7, -3, "c, rho [1][2]; alpha 1.0 [3], set; level [7][10]", 0.8, (3, 3, 3)),
    _tissue("kidney medulla", 1557, 1050, 0.7, -10, "as cortex; darker [8][10], amount set"),
    _tissue("urine", 1500, 1005, 0.02, NO_ECHO, "c, rho as salt water; alpha set"),
    _tissue("blood", 1575, 1055, 0.18, -24, "alpha 0.15 [3]; c, rho [1]; level set"),
    _tissue("vessel wall", 1600, 1070, 0.6, 2, "c, rho as muscle and tendon [2]; level set"),
    _tissue("bone", 3200, 1900, 15, 6, "c, rho [1][2]; alpha 15 [3], 1-10 [4]; level set"),
    _tissue("cartilage", 1665, 1100, 3, -8, "c [2]; rho [1]; alpha, level set"),
    _tissue("gas", 340, 1.2, 40, 0, "c, rho of air; alpha [3]; level set"),
    _tissue("gassy bowel", 1000, 600, 5, 8, "stands for what gas in foam sends back, a dirty shadow; set", 2.0),
    _tissue("aerated lung", 900, 500, 5.0, 6, "as gassy bowel, less deep; set"),
    _tissue("spleen", 1570, 1054, 0.4, -2, "c, rho [2]; alpha [3][9]; level set"),
    _tissue("pancreas", 1570, 1050, 0.8, 1, "as other parenchyma [2]; level set", 1.5, (2, 2, 2)),
    _tissue("bowel wall", 1590, 1045, 0.8, -2, "as muscle; level set"),
    _tissue("soft tissue", 1560, 1050, 0.7, -4, "mean of muscle and organs [2]; level set", 2.0, (5, 5, 3)),
)

_ROUGHNESS_DB = {
    "gel": -18.0, "skin": -14.0, "fat": -13.0, "muscle": -13.0, "fascia": -13.0, "bone": -14.0, "gas": -12.0,
    "perirenal fat": -14.0, "sinus fat": -13.0, "bowel wall": -12.0, "liver": -16.0, "spleen": -16.0,
    "kidney cortex": -15.0, "urine": -18.0, "blood": -18.0, "vessel wall": -17.0,
}  # fmt: skip
_WALL_MM = {"urine": 0.8, "blood": 0.8}
"""Urothelium and the wall of a middling vessel: set by eye."""

TISSUES: dict[str, AcousticTissue] = {
    tissue.name: replace(
        tissue, roughness_db=_ROUGHNESS_DB.get(tissue.name, -15.0), wall_mm=_WALL_MM.get(tissue.name, 0.0)
    )
    for tissue in _DEFAULTS
}
"""The default table, by name."""

_TEXTURES: dict[str, dict[str, Any]] = {
    "muscle": {"texture": "fibres", "texture_db": 4.2, "texture_mm": (16.0, 8.0, 1.7)},
    "fat": {"texture": "strands", "texture_db": 3.2, "texture_mm": (6.0, 6.0, 1.5)},
    "perirenal fat": {"texture": "strands", "texture_db": 2.2, "texture_mm": (7.0, 7.0, 3.0)},
    "liver": {
        "texture": "triads", "texture_db": 2.2, "texture_mm": (2.4, 2.4, 2.4), "texture_direction": (0.8, 0.5, 0.33)
    },
    "spleen": {
        "texture": "triads", "texture_db": 1.2, "texture_mm": (1.6, 1.6, 1.6), "texture_direction": (0.8, 0.5, 0.33)
    },
    "kidney cortex": {"texture_db": 1.4, "texture_mm": (2.0, 2.0, 2.0)},
    "kidney medulla": {"texture": "fibres", "texture_db": 1.2, "texture_mm": (5.0, 1.0, 1.0)},
    "sinus fat": {"texture": "strands", "texture_db": 2.2, "texture_mm": (2.5, 2.5, 1.5)},
}  # fmt: skip
"""How tissues vary from place to place, where they are given textures: set by eye; oblique ones hide their period."""


def textured(tissue: AcousticTissue, direction: tuple[float, float, float] | None = None) -> AcousticTissue:
    """Return a tissue with the texture that its kind has, along a direction of its own where one is given.

    Examples
    --------
    >>> from sonospline.ultrasound.acoustics import TISSUES, textured
    >>> textured(TISSUES["muscle"]).texture, textured(TISSUES["urine"]).texture
    ('fibres', 'blobs')
    """
    changed = replace(tissue, **_TEXTURES.get(tissue.name, {}))
    return changed if direction is None else replace(changed, texture_direction=direction)


_COLUMNS = ("name", "speed_m_s", "density_kg_m3", "attenuation_db_cm_mhz", "backscatter_db", "texture_db", "source")
_VECTORS = ("texture_mm", "texture_direction")
"""Their three numbers are parted by blanks."""
_OPTIONAL = ("roughness_db", "wall_mm", "texture", *_VECTORS)
"""Columns that a table need not have."""


def known(name: str, table: dict[str, AcousticTissue] | None = None) -> AcousticTissue:
    """Return a tissue of a table by its name; ValueError listing the known ones where there is none."""
    tissues = TISSUES if table is None else table
    if name not in tissues:
        raise ValueError(f"tissue {name!r} has no acoustic properties; use one of {', '.join(sorted(tissues))}")
    return tissues[name]


def write_table(path: str | PathLike[str], labelled: Iterable[tuple[int, AcousticTissue]]) -> None:
    """Write labels and their properties as CSV."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(("label", *_COLUMNS, *_OPTIONAL))
    for label, tissue in labelled:
        cells = {column: getattr(tissue, column) for column in (*_COLUMNS, *_OPTIONAL)}
        cells |= {column: " ".join(map(str, cells[column])) for column in _VECTORS}
        writer.writerow((label, *cells.values()))
    write_text(path, text.getvalue())


def read_table(path: str | PathLike[str]) -> dict[int, AcousticTissue]:
    """Read what :func:`write_table` wrote: label -> tissue."""
    table = {}
    for label, row in read_by_label(path, "table", _COLUMNS).items():
        try:
            given = (*_COLUMNS, *(column for column in _OPTIONAL if row.cells.get(column)))
            table[label] = AcousticTissue(**{column: _value(column, row.cells[column]) for column in given})
        except ValueError as error:
            raise ValueError(f"table = {str(path)!r}, line {row.line}: {error}; give numbers in range") from None
    return table


def _value(column: str, cell: str) -> Any:
    """What a cell says."""
    if column in ("name", "source", "texture"):
        return cell
    if column in _VECTORS:
        return tuple(_validate.vector(column, [float(number) for number in cell.split()]).tolist())
    return float(cell)
