"""Scenes and label maps as sources: every file counts, what changes is seen, and a patient is in one split."""

import json
import pickle
from collections import defaultdict

import numpy as np
import pytest

import sonospline as ss
from small_datasets import PATIENTS_SCENE, SMALL, write_map
from sonospline.dataset import DataSet, Plan, Specification, World, make_dataset
from sonospline.dataset.checking import check
from sonospline.dataset.provenance import provenance
from sonospline.dataset.recipe import UnplaceableError
from sonospline.dataset.shard import Job, WorkerError, make_shard
from sonospline.dataset.source import Origin, WarpedSource, source
from sonospline.dataset.source_files import hash_of
from sonospline.dataset.store import store_at
from sonospline.simulator.scene_file import SceneFile
from sonospline.ultrasound import Artefacts, Display

pytest.importorskip("zarr", reason="needs the extra 'data'")
pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

BLOCK = '[[sources]]\nkind = "block"'
LABELS = '[[sources]]\nkind = "labels"\nfolder = "maps"\nscene = "scene.toml"\n[target]\ntissues = ["liver"]'


@pytest.fixture
def asked(tmp_path):
    """A data set of two label maps."""
    (tmp_path / "maps").mkdir()
    for skin, name in enumerate(("Jane_Doe", "John_Doe"), 2):
        write_map(tmp_path / "maps", name, skin)
    (tmp_path / "scene.toml").write_text(PATIENTS_SCENE)
    (tmp_path / "asked.toml").write_text(SMALL.replace(BLOCK, LABELS))
    return Specification.read(tmp_path / "asked.toml")


def job_of(asked, place):
    plan = Plan(asked)
    labels, sources = plan.labels_and_hashes()
    return Job(plan=plan, place=store_at(place), labels=labels, sources=sources, made_by=provenance())


def test_every_file_of_a_scene_counts_and_no_name_does(tmp_path):
    part = 'file = "{}.mha"\nnames = "n.csv"\nct = "ct.mhd"\nmaterials = "m.toml"'
    scenes = [SceneFile.parse(PATIENTS_SCENE.replace('file = "none.nii.gz"', part.format(name))) for name in ("a", "b")]
    for name in ("a.mha", "b.mha", "n.csv", "m.toml"):
        (tmp_path / name).write_bytes(b"1")
    ss.write_volume(ss.Volume(voxels=np.zeros((3, 3, 3), np.int16), spacing=(1, 1, 1)), tmp_path / "ct.mhd")
    (voxels,) = (file for file in tmp_path.glob("ct.*") if file.suffix != ".mhd")
    assert hash_of(scenes[0], tmp_path) == hash_of(scenes[1], tmp_path)
    found = {hash_of(scenes[0], tmp_path)}
    for file in (tmp_path / "a.mha", tmp_path / "n.csv", tmp_path / "m.toml", voxels):
        file.write_bytes(file.read_bytes() + b" ")
        found.add(hash_of(scenes[0], tmp_path))
    assert len(found) == 5
    (tmp_path / "n.csv").unlink()
    with pytest.raises(ValueError, match=r"names = '.*n.csv' cannot be read \(No such file or directory\)"):
        hash_of(scenes[0], tmp_path)


def test_slices_of_a_series_count_however_it_is_named_and_others_beside_all_frames_do_not(tmp_path):
    pydicom = pytest.importorskip("pydicom", reason="needs the extra 'dicom'")
    from dicom_files import places, write_enhanced, write_series

    axes, pixels = np.eye(3)[:2], np.zeros((3, 4, 5), np.int16)
    write_series(tmp_path / "series", pixels, places(3, axes), axes)
    for file in (tmp_path / "series").iterdir():
        with pydicom.dcmread(file) as slice_:
            slice_.NumberOfFrames = 1
            slice_.save_as(file)
    write_enhanced(tmp_path / "series.dcm", pixels, places(3, axes), axes)
    first, *_, last = sorted((tmp_path / "series").iterdir())

    def hashes():
        named = ("series", f"series/{first.name}", "series.dcm")
        return [hash_of(SceneFile.parse(PATIENTS_SCENE.replace("none.nii.gz", name)), tmp_path) for name in named]

    before = hashes()
    last.write_bytes(last.read_bytes() + b"  ")
    (tmp_path / "other.dcm").write_bytes(b"other")
    assert [one == two for one, two in zip(before, hashes(), strict=True)] == [False, False, True]
    before = hashes()
    (tmp_path / "series.csv").write_text("label,name\n1,skin\n")
    assert [one == two for one, two in zip(before, hashes(), strict=True)] == [False, True, False]


def test_the_folder_of_a_specification_goes_with_it_and_another_one_changes_none(asked, tmp_path):
    assert pickle.loads(pickle.dumps(asked)).folder == asked.folder == tmp_path
    other = asked.seen_from(tmp_path / "elsewhere")
    assert other == asked and other.digest == asked.digest
    assert (other.folder, asked.folder) == (tmp_path / "elsewhere", tmp_path)


def test_a_file_that_changes_is_read_again(asked):
    origin = Plan(asked).origins[0]
    before = source(asked, origin)
    assert source(asked, origin) is before
    (asked.folder / "maps/Jane_Doe.csv").write_text("label,name\n1,fat\n2,liver\n")
    assert "fat" in source(asked, origin).names.values()


def test_sources_are_read_once_before_the_first_sample(asked, tmp_path, monkeypatch):
    """However many there are: only the last ones are kept."""
    for number in range(4):
        write_map(asked.folder / "maps", f"Patient_{number}", 2 + number % 2)
    read, of = [], WarpedSource.of
    monkeypatch.setattr(WarpedSource, "of", lambda *scene: read.append(scene) or of(*scene))
    monkeypatch.setattr(Plan, "check", lambda plan: None)
    monkeypatch.setattr("sonospline.dataset.factory._made", lambda job, missing, at: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        make_dataset(asked, tmp_path / "out")
    assert len(read) == 6


def test_a_worker_that_reads_another_label_map_or_none_is_refused(asked, tmp_path):
    job = job_of(asked, tmp_path / "out")
    write_map(asked.folder / "maps", "Jane_Doe", 5)
    write_map(asked.folder / "maps", "John_Doe", 5)
    with pytest.raises(WorkerError, match="reads another label map or scene than was planned"):
        make_shard(job, 0)
    for file in (asked.folder / "maps").iterdir():
        file.unlink()
    with pytest.raises(ValueError, match=r"cannot be read \(No such file or directory\)"):
        make_shard(pickle.loads(pickle.dumps(job)), 0)  # in another process
    assert not list(tmp_path.glob("out/receipts/*"))


@pytest.mark.parametrize("kept", [False, True])
def test_names_of_files_are_kept_where_that_is_asked_for(kept, asked, tmp_path, monkeypatch):
    recipe = Plan.recipe

    def drawn(self, index):
        if index == 3:
            raise UnplaceableError(f"labels = {self.origin(0).file!r}: label 7 has no name")
        return recipe(self, index)

    text = (asked.folder / "asked.toml").read_text() + f'form = "recipe"\nnames_of_files = {str(kept).lower()}\n'
    (asked.folder / "asked.toml").write_text(text)
    asked = Specification.read(asked.folder / "asked.toml")
    monkeypatch.setattr(Plan, "recipe", drawn)
    assert list(make_dataset(asked, tmp_path / "out").failed) == [3]
    held = b"".join(file.read_bytes() for file in (tmp_path / "out").rglob("*") if file.is_file())
    assert (b"Doe" in held) == kept
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert set(manifest.get("files", {}).values()) == ({"Jane_Doe.nii.gz", "John_Doe.nii.gz"} if kept else set())


def test_all_that_is_warped_of_a_label_map_is_in_one_split():
    asked = Specification.parse(SMALL.replace(BLOCK, LABELS).replace("samples = 6", "samples = 1600"))
    plan = Plan(asked, [Origin(0, f"{number}.nii.gz", 1.0) for number in range(20)])
    splits = defaultdict(set)
    for anatomy in range(asked.anatomies):
        splits[plan.origin(anatomy).file].add(plan.split(anatomy * asked.anatomy.samples))
    assert len(splits) == 20
    assert all(len(found) == 1 for found in splits.values())
    assert set.union(*splits.values()) == {"train", "validation", "test"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["scene", "labels"])
def test_samples_of_scenes_and_of_label_maps_are_made_and_made_again(kind, asked, tmp_path):
    if kind == "scene":
        asked = Specification.parse(SMALL.replace(BLOCK, '[[sources]]\nkind = "scene"\nscene = "gel"'))
    assert make_dataset(asked, tmp_path / "out").failed == {}
    data = DataSet(tmp_path / "out")
    hashes = {source(asked, origin).hash for origin in Plan(asked).origins}
    assert {row["source"] for row in data.rows()} <= hashes
    assert all(data.shard(number)["image"].any() for number in range(3))
    assert not check(data, remade=2, folder=asked.folder).problems


@pytest.mark.parametrize("scene", ["kidney", "kidney-wide"])
def test_a_phantom_without_its_dent_is_the_same_phantom(scene):
    text = f'samples = 1\n[[sources]]\nkind = "scene"\nscene = "{scene}"\n[anatomy]\nvoxel_mm = 4.0'
    plan = Plan(Specification.parse(text))
    found = source(plan.asked, plan.origins[0])
    shown, meant = (set(np.unique(labels.voxels)) for labels in (found.acoustic, found.mechanical))
    assert shown == meant and (13 in shown) == (scene == "kidney-wide")
    assert found.press_mm == 0 and found.acoustic.voxels[:, :, 0].all(), "no gel between the skin and the probe"


@pytest.mark.parametrize("textures", ["true", "false"])
def test_a_scene_is_imaged_as_it_is_shown(textures, asked):
    shown = f"[display]\ngain_db = 3\nartefacts = false\ntextures = {textures}"
    (asked.folder / "scene.toml").write_text(PATIENTS_SCENE + shown)
    plan = Plan(asked)
    scanner = World(plan.anatomy(0), plan.labels()).scanner(plan.recipe(0), 1.0)
    assert (scanner.phantom.tissues == scanner.phantom.textured().tissues) == (textures == "true")
    assert scanner.display.gain_db == Display().gain_db + 3 and scanner.artefacts == Artefacts.none()
    assert scanner.probe == plan.anatomy(0).probe and scanner.probe.downshift_db_cm_mhz == 0
