"""Every example in a docstring runs, and importing a module needs no extra."""

import doctest
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import sonospline

ROOT = Path(sonospline.__file__).parent
EXTRAS = (
    *("SimpleITK", "vtk", "vtkmodules", "matplotlib", "PIL", "pyvista", "pydicom", "rich"),
    *("skfem", "pyamg", "pypardiso", "pymoo", "distributed", "starlette", "uvicorn", "websockets"),
    "gymnasium",
)


def module_names():
    """All modules by their files: nothing is imported to find them."""
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT.parent).with_suffix("").parts
        if parts[-1] != "__main__":  # importing it is running the program
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = list(module_names())


def test_the_search_finds_the_rooms():
    assert {"sonospline", "sonospline.models.spline.spline", "sonospline._core.twin"} <= set(MODULES)


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # an example may write a file
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    results = doctest.testmod(importlib.import_module(name))
    assert results.failed == 0


@pytest.mark.parametrize(
    "name",
    [
        *("geometry.grid", "geometry.needle", "geometry.tissue", "fields.field"),
        *("fields.polyharmonic", "models.spline.insertion", "mechanics.interaction", "models.spline.spline"),
    ],
)
def test_public_rooms_have_examples(name):
    finder = doctest.DocTestFinder()
    module = importlib.import_module(f"sonospline.{name}")
    assert sum(len(test.examples) for test in finder.find(module)) > 0


def test_importing_any_module_needs_no_extra():
    """In a fresh interpreter where every optional package refuses to be imported."""
    code = (
        "import importlib, sys\n"
        f"for extra in {EXTRAS!r}: sys.modules[extra] = None\n"
        f"for name in {MODULES!r}: importlib.import_module(name)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
