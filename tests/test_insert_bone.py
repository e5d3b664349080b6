"""``sonospline insert`` into bone: it goes as far, says so, and refuses where it was asked to be strict."""

import json

import numpy as np
import pytest

from sonospline import cli
from sonospline.geometry.volume import Volume
from sonospline.io.volumes import write_volume

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

SMALL = ["--nodes", "3000", "--steps", "3", "--quiet"]


def insert(*arguments):
    return cli.main(["insert", *map(str, arguments)])


@pytest.fixture
def label_files(tmp_path):
    """Fat over liver with a bone in it."""
    voxels = np.ones((24, 20, 20), np.uint8)
    voxels[8:], voxels[14:18, 8:12, 8:12] = 2, 3
    write_volume(Volume(voxels=voxels, spacing=2.0), tmp_path / "organs.nii.gz")
    (tmp_path / "organs.csv").write_text("label,name\n1,fat\n2,liver\n3,bone\n")
    return tmp_path / "organs.nii.gz"


INTO = ("--entry", "0,18,18", "--target", "32,18,18")
STOPS = "bone stops the needle: bone after 27.0 of 32.0 mm"


def test_who_asks_to_be_strict_gets_no_file_of_a_needle_that_bone_stops(label_files, tmp_path, capsys):
    arguments = ("--labels", label_files, "--model", "elastic", *INTO, "--out", tmp_path / "out", *SMALL)
    assert insert(*arguments, "--strict") == 2
    refused = capsys.readouterr()
    assert (refused.out, refused.err.count("\n")) == ("", 1)
    assert f"--strict: {STOPS}; choose a path beside it" in refused.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_bone_stops_the_needle(label_files, tmp_path, capsys, caplog):
    """It goes as far as the bone, says so, and the files are of what was reached."""
    arguments = ("--labels", label_files, "--model", "elastic", *INTO, "--out", tmp_path / "out", *SMALL)
    assert insert(*arguments, "--json") == 0
    assert STOPS in caplog.text
    summary = json.loads(capsys.readouterr().out)
    assert summary["blocked"] == {"needle": "needle", "by": "bone", "depth_mm": pytest.approx(27, abs=0.01)}
    assert summary["depth_mm"] == summary["blocked"]["depth_mm"]
    assert (summary["target_ras_mm"], summary["tip_ras_mm"]) == ([32, 18, 18], pytest.approx([27, 18, 18], abs=0.01))
    assert summary["smallest_det_jacobian"] > 0.2
    beside = ("--entry", "0,18,12", "--target", "32,18,12")
    assert insert(*arguments, *beside, "--strict", "--json") == 0
    assert json.loads(capsys.readouterr().out)["blocked"] is None


def test_a_needle_that_starts_in_bone_is_refused(label_files, tmp_path, capsys):
    inside = ("--entry", "30,18,18", "--target", "2,18,18")
    assert insert("--labels", label_files, "--model", "elastic", *inside, "--out", tmp_path / "out", *SMALL) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "entry = (30, 18, 18) of needle 'needle' lies in bone, bone; enter beside" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_loose_fragment_that_gives_way_stops_the_needle_where_it_was_met(label_files, tmp_path, capsys):
    (tmp_path / "loose.toml").write_text("[bone]\nrigid = true\nfloating = true\n")
    arguments = ("--labels", label_files, "--materials", tmp_path / "loose.toml", "--model", "elastic", *INTO, *SMALL)
    assert insert(*arguments, "--out", tmp_path / "out", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["blocked"]["by"] == "bone"
    assert 26.9 < summary["depth_mm"] == summary["blocked"]["depth_mm"] < 32


@pytest.mark.slow
def test_a_rib_of_a_real_abdomen_stops_the_needle(shared_data, tmp_path, capsys, caplog):
    where = ["--entry", "137,310,158", "--target", "137,170,158", "--nodes", "150000", "--steps", "4", "--quiet"]
    arguments = ["--labels", shared_data / "abdomen_labels.nii.gz", "--model", "elastic", *where]
    assert insert(*arguments, "--out", tmp_path / "out", "--json") == 0
    assert "bone stops the needle: rib_right_9 after 132.2 of 140.0 mm" in caplog.text
    summary = json.loads(capsys.readouterr().out)
    assert summary["max_displacement_mm"] < 10 and summary["smallest_det_jacobian"] > 0.2
