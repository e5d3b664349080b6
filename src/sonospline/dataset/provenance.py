"""What made a data set: versions, instruction set, and a hash of this package's own code."""

from __future__ import annotations

import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .. import _core
from .._digest import digest_of_bytes

PACKAGES = ("sonospline", "numpy", "zarr", "numcodecs", "pyarrow")
"""Whose versions the bytes of a data set may depend on."""
_KINDS = ("*.py", "*.toml", "*.json")
Provenance = dict[str, str]


@lru_cache(maxsize=1)
def provenance() -> Provenance:
    """Return what this process would make samples with.

    Examples
    --------
    >>> from sonospline.dataset.provenance import provenance
    >>> sorted(provenance())[:4]
    ['backend', 'code', 'core', 'instruction_set']
    """
    found = {"backend": _core.backend(), "instruction_set": _core.instruction_set()}
    found |= {"code": code_hash(), "core": _core_hash()}
    return {**found, "python": ".".join(platform.python_version_tuple()[:2]), **{n: _version(n) for n in PACKAGES}}


def code_hash() -> str:
    """Return a hash of the package's Python files and tables, which two checkouts of one version may differ in."""
    folder = Path(__file__).parents[1]
    files = sorted(file for kind in _KINDS for file in folder.rglob(kind))
    return digest_of_bytes(
        b"".join(f"{file.relative_to(folder).as_posix()}\n".encode() + file.read_bytes() for file in files)
    )


def _core_hash() -> str:
    """Of the compiled core; its twin is among the Python files."""
    if _core.backend() == "numpy":
        return "numpy"
    return digest_of_bytes(Path(str(_core.native.__file__)).read_bytes())


def difference(asked: Provenance, found: Provenance) -> str:
    """Return in what two differ, in words; empty where in nothing."""
    return ", ".join(
        f"{name} is {found.get(name, 'missing')} instead of {value}" for name, value in asked.items()
        if found.get(name) != value
    )  # fmt: skip


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
