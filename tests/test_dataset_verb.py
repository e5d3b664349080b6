"""The verb ``dataset`` from a specification to samples made again, and label maps of patients as a source."""

import json
import shutil

import numpy as np
import pytest

from small_datasets import PATIENTS_SCENE, SMALL, write_map
from sonospline import cli
from sonospline.commands import _rate
from sonospline.dataset import DataSet, Specification, make_dataset

pytest.importorskip("zarr", reason="needs the extra 'data'")

PATIENTS = """
[[sources]]
kind = "labels"
folder = "patients"
scene = "scene.toml"
[target]
tissues = ["liver"]
"""


def said(capsys, *arguments):
    assert cli.main(["dataset", *map(str, arguments)]) == 0
    return capsys.readouterr().out


@pytest.mark.slow
def test_from_a_specification_to_samples_made_again(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "asked.toml").write_text(SMALL + 'form = "recipe"\n')
    assert "6 in recipes, 6 of them made now" in said(capsys, "make", "asked.toml", "--out", "recipes")
    assert "0 of them made now, 6 were there" in said(capsys, "make", "asked.toml", "--out", "recipes")
    report = json.loads(said(capsys, "rebuild", "recipes", "--out", "full", "--form", "webdataset", "--json"))
    assert report["failed"] == {}
    assert "6 samples (" in said(capsys, "show", "full")
    assert "2 samples made again, bit for bit" in said(capsys, "check", "full", "--remake", "2")
    assert "force_axial_n" in said(capsys, "stats", "full")
    shard = tmp_path / "full/shards/000001.tar"
    shard.write_bytes(shard.read_bytes()[:-1])
    assert cli.main(["dataset", "check", "full"]) == 1
    assert "shards/000001.tar is not what manifest.json says" in capsys.readouterr().err
    assert "shards 1; make makes them again" in said(capsys, "check", "full", "--repair")
    assert cli.main(["dataset", "stats", "recipes"]) == 2
    assert "holds recipes alone" in capsys.readouterr().err


@pytest.mark.slow
def test_label_maps_of_patients_are_known_by_their_hashes(tmp_path):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    folder = tmp_path / "patients"
    folder.mkdir()
    for skin, patient in enumerate(("Jane_Doe", "John_Doe"), 2):
        write_map(folder, patient, skin)
    (tmp_path / "scene.toml").write_text(PATIENTS_SCENE)
    (tmp_path / "asked.toml").write_text(
        SMALL.replace('[[sources]]\nkind = "block"', PATIENTS).replace("shard = 2", "")
    )
    asked = Specification.read(tmp_path / "asked.toml")
    assert make_dataset(asked, tmp_path / "out").failed == {}
    data = DataSet(tmp_path / "out")
    assert {"liver", "skin"} < set(data.labels.values())
    assert "liver" in {row["target"] for row in data.rows()}
    held = b"".join(file.read_bytes() for file in (tmp_path / "out").rglob("*") if file.is_file())
    assert b"Doe" not in held
    shutil.copy(folder / "Jane_Doe.nii.gz", folder / "Third.nii.gz")
    shutil.copy(folder / "Jane_Doe.csv", folder / "Third.csv")
    with pytest.raises(ValueError, match="was made of other label maps or scenes; bring those back"):
        make_dataset(asked, tmp_path / "out")


def test_the_pace_is_that_of_this_run():
    """Samples that were there before count for nothing."""
    now = iter([0.0, 10.0, 20.0])
    pace = _rate.Pace(lambda: next(now))
    assert np.isnan(pace.at(100, 1000)).all()
    assert pace.at(200, 1000) == (10.0, 80.0)
    assert pace.at(400, 1000) == (15.0, 40.0)
    assert (
        _rate.text("making", 400, 1000, 2, 15.0, 40.0)
        == "making: 400 of 1,000 samples, 15 a second, 40 s left; 2 failed"
    )
