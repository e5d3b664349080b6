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
Provenance = dict[str, str]


@lru_cache(maxsize=1)
def provenance() -> Provenance:
    """Return what this process would make samples with.

    Examples
    --------
    >>> from sonospline.dataset.provenance import provenance
    >>> sorted(provenance())[:3]
    ['backend', 'code', 'instruction_set']
    """
    found = {"backend": _core.backend(), "instruction_set": _core.instruction_set(), "code": code_hash()}
    return {**found, "python": ".".join(platform.python_version_tuple()[:2]), **{n: _version(n) for n in PACKAGES}}


def code_hash() -> str:
    """Return a hash of the package's Python files, which two checkouts of one version may differ in."""
    folder = Path(__file__).parents[1]
    files = sorted(folder.rglob("*.py"))
    return digest_of_bytes(
        b"".join(f"{file.relative_to(folder).as_posix()}\n".encode() + file.read_bytes() for file in files)
    )


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
