"""A scene that comes through a page reads ordinary files of the server's folder, and nothing else."""

import os
import socket

import numpy as np
import pytest

from sonospline.server.file_access import refuse_elsewhere
from sonospline.server.scene_catalog import SceneCatalog
from sonospline.simulator import SceneFile

pytest.importorskip("SimpleITK")

VOXELS = np.zeros((6, 6, 6), np.uint8)
META = (
    "NDims = 3\nBinaryData = True\nDimSize = 6 6 6\nElementSpacing = 2 2 2\nElementType = MET_UCHAR\n"
    "ElementDataFile = {}\n"
)
NRRD = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 6 6 6\nspacings: 2 2 2\nencoding: raw\ndata file: {}\n\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The server's folder, with a secret beside it."""
    folder = tmp_path / "here"
    folder.mkdir()
    (tmp_path / "secret.raw").write_bytes(VOXELS.tobytes())
    (tmp_path / "secret.mhd").write_text(META.format("secret.raw"))
    (tmp_path / "secret.csv").write_text("1,secret\n")
    (folder / "own.raw").write_bytes(VOXELS.tobytes())
    (folder / "own.mhd").write_text(META.format("own.raw"))
    (folder / "own.csv").write_text("1,liver\n")
    monkeypatch.chdir(folder)
    return folder


def scene(**tissue):
    values = ", ".join(f"{key} = '{value}'" for key, value in {"source": "volume", **tissue}.items())
    return SceneFile.parse(f"name = 'x'\ntissue = {{{values}}}")


def test_files_of_the_folder_are_its_own(here):
    (here / "inner").mkdir()
    (here / "inner" / "also.nhdr").write_text(NRRD.format("../own.raw"))
    (here / "link.mhd").symlink_to("own.mhd")
    for file in ("own.mhd", "./own.mhd", "inner/../own.mhd", "inner/also.nhdr", "link.mhd", str(here / "own.mhd")):
        refuse_elsewhere(scene(file=file, ct="own.mhd", names="own.csv"))
    refuse_elsewhere(scene(source="labels", file="own.mhd"))
    refuse_elsewhere(scene(source="gel block"))


@pytest.mark.parametrize("key", ["file", "ct", "names", "materials"])
@pytest.mark.parametrize(
    "named", ["../secret.mhd", "{up}/secret.mhd", "/etc/passwd", "link", "door/secret.mhd", "/dev/zero"]
)
def test_what_lies_elsewhere_is_refused_by_its_key(here, key, named):
    (here / "link").symlink_to("../secret.mhd")
    (here / "door").symlink_to("..")
    named = named.format(up=here.parent)
    with pytest.raises(ValueError, match=rf"tissue\.{key} = '.*' lies outside the folder the server was started in"):
        refuse_elsewhere(scene(**{"file": "own.mhd", key: named}))


@pytest.mark.parametrize("header", [META, NRRD])
@pytest.mark.parametrize("key", ["file", "ct"])
@pytest.mark.parametrize("named", ["../secret.raw", "{up}/secret.raw", "link.raw"])
def test_a_header_points_nowhere_else(here, header, key, named):
    (here / "link.raw").symlink_to("../secret.raw")
    spy = "spy.mhd" if header is META else "spy.nhdr"
    (here / spy).write_text(header.format(named.format(up=here.parent)))
    with pytest.raises(ValueError, match=rf"tissue\.{key} = '.*\.raw' lies outside the folder"):
        refuse_elsewhere(scene(**{"file": "own.mhd", key: spy}))


def test_names_beside_a_label_map_may_not_lead_elsewhere(here):
    (here / "own.csv").unlink()
    (here / "own.csv").symlink_to("../secret.csv")
    with pytest.raises(ValueError, match=r"tissue\.names = 'own\.csv' lies outside the folder"):
        refuse_elsewhere(scene(source="labels", file="own.mhd"))


def pipe(path):
    os.mkfifo(path)


def listening(path):
    with socket.socket(socket.AF_UNIX) as door:
        door.bind(str(path))


@pytest.mark.parametrize("key", ["file", "ct", "names", "materials"])
@pytest.mark.parametrize(
    ("make", "says"),
    [
        (pipe, "is a named pipe"),
        (listening, "is a socket"),
        (lambda path: path.mkdir(), "is a folder"),
        (lambda path: path.symlink_to(path.name), "cannot be read|does not exist"),
        (lambda path: None, "does not exist"),
    ],
)
def test_what_is_no_file_is_refused_at_once(here, key, make, says):
    make(here / "odd.mhd")
    with pytest.raises(ValueError, match=rf"tissue\.{key} = 'odd\.mhd' ({says})"):
        refuse_elsewhere(scene(**{"file": "own.mhd", key: "odd.mhd"}))


@pytest.mark.parametrize("named", ["a\\u0000b", "x" * 999, "a/" * 400])
def test_what_is_no_path_is_refused(here, named):
    spec = SceneFile.parse(f'name = "x"\ntissue = {{source = "volume", file = "{named}"}}')
    with pytest.raises(ValueError, match=r"tissue\.file = '.*(cannot be read|does not exist)"):
        refuse_elsewhere(spec)


@pytest.mark.parametrize("key", ["file", "ct", "names", "materials"])
def test_a_pipe_does_not_hold_up_the_maker_of_scenes(here, key):
    os.mkfifo(here / "odd.mhd")
    catalog = SceneCatalog()
    values = {"source": "labels", "file": "own.mhd", key: "odd.mhd"}
    text = "name = 'x'\n[tissue]\n" + "\n".join(f"{name} = '{value}'" for name, value in values.items())
    with pytest.raises(ValueError, match=rf"tissue\.{key} = 'odd\.mhd' is a named pipe"):
        catalog.order("x.toml", text, lambda share: None).result(60)
    assert catalog.close(10)
