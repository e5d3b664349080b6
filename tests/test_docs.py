"""Every program in the README and in the pages of documentation runs, on small files made for it."""

import inspect
import re
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import sonospline as ss

ROOT = Path(__file__).parents[1]
PAGES = {path.name: path for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))}
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROGRAMS = {name: BLOCK.findall(path.read_text()) for name, path in PAGES.items()}
NEEDS = {
    "README.md": ("SimpleITK", "h5py", "matplotlib"),
    "start.md": ("SimpleITK", "h5py", "matplotlib"),
    "elastic.md": ("SimpleITK",),
    "ultrasound.md": ("SimpleITK",),
    "coordinates.md": ("SimpleITK",),
    "fem.md": ("skfem", "pyamg"),
    "datasets.md": ("zarr", "pyarrow"),
}
NAMES = "label,name\n1,skin\n2,liver\n3,tumour\n"


def write_files(folder):
    """Every file that a program reads: a block of 98 mm of skin (at y = 98), liver and tumour, and a CT of it."""
    voxels = np.full((50, 50, 50), 2, np.uint8)
    voxels[:, -2:] = 1
    voxels[20:30, 15:22, 20:30] = 3
    labels = ss.Volume(voxels=voxels, spacing=(2, 2, 2))
    for name in ("organs", "abdomen_labels"):
        ss.write_volume(labels, folder / f"{name}.nii.gz")
        (folder / f"{name}.csv").write_text(NAMES)
    ss.write_volume(ss.Volume(voxels=np.int16(40 * voxels), spacing=(2, 2, 2)), folder / "ct.nii.gz")
    (folder / "mine.toml").write_text("[liver]\nstiffness_kpa = 6.5\n")
    (folder / "out").mkdir()
    values = np.zeros((3, 3, 3, 3))
    ss.GridField(ss.Grid(shape=(3, 3, 3), spacing=50), values).save(folder / "out" / "displacement.h5")


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    return tmp_path


def run(page):
    """Run a page's programs one after the other, as its reader would; return the names they leave."""
    names = {"__name__": "page", **READER.get(page, {})}
    for number, program in enumerate(PROGRAMS[page]):
        exec(compile(program, f"{page}, program {number + 1}", "exec"), names)
    return SimpleNamespace(**names)


READER = {
    "simulator.md": {
        **dict.fromkeys(("draw", "record", "show", "warn"), lambda *_: None),
        "page_is_ready": lambda: True,
    }
}
"""What the text around a program says is the reader's own."""


def test_the_pages_have_programs():
    assert {"README.md", *NEEDS} <= {name for name, programs in PROGRAMS.items() if programs}


@pytest.mark.parametrize("page", [name for name, programs in PROGRAMS.items() if programs])
def test_every_program_runs(page, files):
    for module in NEEDS.get(page, ()):
        pytest.importorskip(module, reason="needs an extra")
    if {"SimpleITK", "h5py"} & set(NEEDS.get(page, ())):
        write_files(files)
    left = run(page)
    check = CHECKS.get(page)
    if check is not None:
        check(left, files)


def the_readme(left, files):
    assert left.r.forces["needle"].axial_n == pytest.approx(0.03 * 55 + 0.7, rel=0.1)
    assert 0.5 < left.r.field.displacement((62, 74, 50)) @ left.needle.direction < 8
    assert left.r.settled
    assert {"slice.png", "warp.h5", "ultrasound.png"} <= {path.name for path in files.iterdir()}
    lines = [line for line in PROGRAMS["README.md"][0].splitlines() if line and not line.startswith("#")]
    assert len(lines) <= 12


def the_start(left, files):
    assert left.field.on_grid().shape == (53, 53, 53, 3)
    assert (files / "u.h5").exists()


def the_ultrasound(left, files):
    assert left.image.pixels.std() > 20
    assert {"after.png", "scene.seg.nrrd", "tissues.csv"} <= {path.name for path in files.iterdir()}


CHECKS = {"README.md": the_readme, "start.md": the_start, "ultrasound.md": the_ultrasound}


# --- the list of names ---

DIRECTIVE = re.compile(r"^\.\. auto(?:class|function|data|module):: (\S+)\n(?:   :members:([^\n]*)\n)?", re.MULTILINE)


def listed():
    """Every name of the API's page, and the members it asks for."""
    for name, members in DIRECTIVE.findall((ROOT / "docs" / "api" / "index.rst").read_text()):
        yield name
        yield from (f"{name}.{member.strip()}" for member in members.split(",") if member.strip())


def found(name):
    module, attributes = name, []
    while True:
        try:
            value = import_module(module)
            break
        except ModuleNotFoundError:
            module, _, attribute = module.rpartition(".")
            attributes.insert(0, attribute)
    for attribute in attributes:
        value = getattr(value, attribute, None) or inspect.getattr_static(value, attribute)
    return value


@pytest.mark.parametrize("name", list(listed()))
def test_every_name_of_the_api_is_there_and_says_what_it_is(name):
    assert inspect.getdoc(found(name))


def test_a_name_that_is_not_there_is_missed():
    with pytest.raises(AttributeError):
        found("sonospline.Nonsense")


def test_every_public_name_is_in_the_api():
    names = set(listed())
    assert {name for name in ss.__all__ if f"sonospline.{name}" not in names} <= {"Session"}
