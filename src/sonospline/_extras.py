"""Optional libraries: imported where they are used, named where they are missing."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

PROVIDES = {
    "SimpleITK": "io",
    "h5py": "io",
    "vtkmodules": "io",
    "matplotlib": "plot",
    "rich": "cli",
    "skfem": "fem",
    "pyamg": "fem",
    "pypardiso": "direct",
    "pymoo": "tune",
    "dask": "data",
    "distributed": "data",
    "zarr": "data",
    "fsspec": "data",
    "torch": "torch",
    "PIL": "plot",
    "pyvista": "view",
    "pydicom": "dicom",
    "starlette": "serve",
    "uvicorn": "serve",
    "websockets": "serve",
    "playwright": "bench",
    "mcap": "record",
    "gymnasium": "envs",
    "av": "lerobot",
    "sqlalchemy": "lab",
    "pyarrow": "lab",
}
"""Module -> the extra that brings it."""


class MissingExtraError(ImportError):
    """An optional library is not installed; the message says which extra brings it."""


def present(module: str) -> bool:
    """Return whether an optional module can be imported, without importing it."""
    return find_spec(module) is not None


def require(module: str) -> Any:
    """Return an optional module, or raise one clear line naming its extra."""
    package = module.partition(".")[0]
    if not present(package):
        extra = PROVIDES[package]
        raise MissingExtraError(f"{package} is not installed; run: pip install 'sonospline[{extra}]'")
    return import_module(module)
