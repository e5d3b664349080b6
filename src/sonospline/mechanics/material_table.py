"""The table of materials by the names of tissues, read from TOML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib.resources import files
from os import PathLike
from typing import Any

from .._shown import shown
from ..io.files import read_text
from ..io.tables import read_names
from ..io.toml_text import TomlError, loads
from .material import Material
from .moduli import check_ratio

BACKGROUND = "soft_tissue"
"""What label 0 is, where the names do not say."""


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """Materials by the name of the tissue; a name may be a pattern, such as ``rib_*``.

    Examples
    --------
    >>> from sonospline.mechanics import MaterialTable
    >>> table = MaterialTable.assumed()
    >>> table["rib_left_7"].rigid, table["rib_left_7"].source
    (True, 'assumed')
    """

    materials: Mapping[str, Material]

    @classmethod
    def assumed(cls) -> MaterialTable:
        """Return the table that comes with the package: plausible values, none of them measured."""
        return _assumed()

    @classmethod
    def read(cls, path: str | PathLike[str]) -> MaterialTable:
        """Read a TOML file of ``[tissue name]`` tables; tissues it does not name are the assumed ones.

        Raises
        ------
        ValueError
            A file that is not there or not TOML, an unknown key, or a value out of range.
        """
        try:
            entries = loads(read_text(path, "materials", "a TOML file"))
        except TomlError as error:
            raise ValueError(f"materials = {str(path)!r} is not TOML ({error}); write [liver] tables") from None
        return cls.assumed().preferring(_parsed(f"materials = {str(path)!r}", entries))

    @classmethod
    def of(cls, materials: Materials | None) -> MaterialTable:
        """Return a table as it is, or the assumed one with a file's or a mapping's materials before its own."""
        if materials is None:
            return cls.assumed()
        if isinstance(materials, MaterialTable):
            return materials
        if isinstance(materials, Mapping):
            return cls.assumed().preferring(materials)
        if isinstance(materials, str | PathLike):
            return cls.read(materials)
        raise ValueError(f"materials = {shown(materials)} is for a box of one tissue; give a table by name for labels")

    def preferring(self, others: Mapping[str, Material]) -> MaterialTable:
        """Return the table with others in the place of, and before, its own."""
        return MaterialTable({**others, **{k: v for k, v in self.materials.items() if k not in others}})

    def __getitem__(self, name: str) -> Material:
        """Return the material of a tissue.

        Raises
        ------
        ValueError
            The table has none; the message lists what it has.
        """
        for pattern, material in self.materials.items():
            if name == pattern or fnmatchcase(name, pattern):
                return material
        known = ", ".join(self.materials)
        raise ValueError(f"label {name!r} has no material; add a [{name}] table, or use one of {known}")

    def __repr__(self) -> str:
        return f"MaterialTable({len(self.materials)} tissues)"


def read_label_names(path: str | PathLike[str]) -> dict[int, str]:
    """Read the names of labels, see :func:`~sonospline.io.tables.read_names`; label 0 is soft tissue by default."""
    return {0: BACKGROUND, **read_names(path, "label names")}


Materials = MaterialTable | Mapping[str, Material] | str | PathLike[str]
"""What a table of materials is made of."""


@lru_cache(maxsize=1)
def _assumed() -> MaterialTable:
    text = files(__package__).joinpath("assumed_materials.toml").read_text()
    return MaterialTable(_parsed("assumed_materials.toml", loads(text)))


def _parsed(where: str, entries: dict[str, Any]) -> dict[str, Material]:
    known = [field.name for field in fields(Material)]
    table = {}
    for name, values in entries.items():
        if not isinstance(values, dict):
            raise ValueError(
                f"{where}: {name} = {shown(values)} is not a table; write [{name}] with stiffness_kpa = ..."
            )
        for key in values:
            if key not in known:
                raise ValueError(f"{where}: [{name}] has an unknown key {key!r}; use {', '.join(known)}")
        if "stiffness_kpa" not in values and not values.get("rigid"):
            raise ValueError(f"{where}: [{name}] lacks stiffness_kpa; add it")
        try:
            table[name] = Material(**values)
            check_ratio(table[name].poissons_ratio)
        except ValueError as error:
            raise ValueError(f"{where}: [{name}] {error}") from None
    return table
