"""Label maps: one reader, one rule for what is a label, background where they end, and their names."""

import csv
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline.geometry.label_map import LabelMap
from sonospline.geometry.volume import Volume
from sonospline.io.labels import names_beside, names_of
from sonospline.io.tables import read_names
from sonospline.io.volumes import write_volume
from sonospline.mechanics import Material, TissueMap, read_label_names
from sonospline.phantoms.phantom_file import read_phantom
from sonospline.simulator import SceneFile
from sonospline.ultrasound import Phantom
from sonospline.ultrasound.acoustics import read_table
from sonospline.ultrasound.organs import phantom_from_organs

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

SOFT, BONE = Material(stiffness_kpa=6), Material(stiffness_kpa=6000, rigid=True)
TURNED = np.diag([-1.0, -1.0, 1.0])


def labelled(voxels, **place):
    return Volume(voxels=np.asarray(voxels), spacing=(2.0, 2.0, 2.0), **place)


def block(value=1.0, dtype=np.float64):
    """Background with a block of one value in the middle."""
    voxels = np.zeros((10, 10, 10), dtype)
    voxels[3:7, 3:7, 3:7] = value
    return voxels


def by_insert(path):
    return TissueMap.read(path).labels


def by_image(path):
    return read_phantom(path, names=names_beside(path)).labels


def by_serve(path):
    from sonospline.simulator import make_scene

    scene = SceneFile.parse(f'name = "own"\n[tissue]\nsource = "labels"\nfile = "{path.name}"\nnodes = 1000')
    return make_scene(scene, folder=path.parent).tissues.labels


@pytest.mark.parametrize("read", [by_insert, by_image, by_serve])
@pytest.mark.parametrize("value", [-1, -252, 4.002, 0.5, np.nan, np.inf, 70_000])
def test_every_verb_refuses_the_same_numbers_by_name(tmp_path, read, value):
    write_volume(labelled(block(value)), tmp_path / "organs.nrrd")
    (tmp_path / "organs.csv").write_text("label,name\n4,liver\n")
    with pytest.raises(ValueError, match=r"labels = '.*organs\.nrrd' has a voxel of .*; give (a label map|numbers)"):
        read(tmp_path / "organs.nrrd")


@pytest.mark.parametrize("read", [by_insert, by_image, by_serve])
@pytest.mark.parametrize("names", ["label,name\n4,liver\n", "label,name\n5,pixie dust\n"])
def test_every_verb_names_the_file_whose_label_has_no_name_or_tissue(tmp_path, read, names):
    write_volume(labelled(block(5)), tmp_path / "organs.nrrd")
    (tmp_path / "organs.csv").write_text(names)
    with pytest.raises(ValueError, match=r"labels = '.*organs\.nrrd': (labels? .?5|.*pixie dust)"):
        read(tmp_path / "organs.nrrd")


@pytest.mark.parametrize("read", [by_insert, by_image, by_serve])
@pytest.mark.parametrize("value", [4.9999995, 5.0009, 4.9991])
def test_every_verb_rounds_what_is_nearly_whole(tmp_path, read, value):
    write_volume(labelled(block(value)), tmp_path / "organs.nrrd")
    (tmp_path / "organs.csv").write_text("label,name\n5,liver\n")
    labels = read(tmp_path / "organs.nrrd")
    assert 5 in np.unique(labels.voxels)
    assert 4 not in np.unique(labels.voxels)


def test_whole_numbers_keep_their_type_and_their_memory():
    voxels = block(7, np.uint8)
    assert np.shares_memory(LabelMap.of(labelled(voxels)).voxels, voxels)
    same = LabelMap.of(labelled(voxels))
    assert LabelMap.of(same) is same
    with pytest.raises(ValueError, match="a voxel of 7; give a label map, whole numbers 0 to 6"):
        LabelMap.of(same, largest=6)
    with pytest.raises(ValueError, match="a voxel of inf; give a label map"):
        LabelMap.of(labelled(block(np.inf)))
    with pytest.raises(ValueError, match="type complex"):
        LabelMap.of(labelled(block(1, complex)))


def test_between_voxels_a_label_is_the_nearest_one_and_outside_it_is_background():
    labels = LabelMap(voxels=np.full((3, 3, 3), 9, np.uint8), spacing=(2.0, 2.0, 2.0), direction=TURNED)
    points = np.array([[0, 0, 0], [-4.9, -4.9, 4.9], [-5.1, 0, 0], [1.1, 0, 0], [0.9, 0.9, -0.9]])
    assert labels.sample(points).tolist() == [9, 9, 0, 0, 9]


def test_beyond_a_cropped_segmentation_is_background_and_not_its_organ():
    whole = block(1, np.uint8)
    cropped = labelled(whole[3:7, 3:7, 3:7], origin=np.full(3, 6.0))
    materials = {0: SOFT, 1: BONE}
    full, cut = TissueMap(labelled(whole), materials), TissueMap(cropped, materials)
    tilt = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    for grid in (
        ss.Grid(shape=(7, 7, 7), spacing=3.0),
        ss.Grid(shape=(5, 5, 5), spacing=3.0, origin=(4, 1, 3), direction=tilt),
    ):
        for modulus in ("shear", "lame"):
            assert np.array_equal(getattr(full.moduli(grid), modulus), getattr(cut.moduli(grid), modulus))
        assert np.array_equal(full.labels_at(grid.points), cut.labels_at(grid.points))
        assert np.array_equal(full.resistance(grid.points), cut.resistance(grid.points))


def test_a_cropped_segmentation_needs_a_material_for_the_background():
    cut = TissueMap(labelled(np.full((4, 4, 4), 1, np.uint8)), {1: SOFT})
    assert cut.moduli(ss.Grid(shape=(4, 4, 4), spacing=2.0)).shear == pytest.approx(SOFT.shear_modulus)
    with pytest.raises(ValueError, match="label 0, the background beyond, has no material"):
        cut.moduli(ss.Grid(shape=(9, 9, 9), spacing=2.0))
    with pytest.raises(ValueError, match="label 0, the background beyond, has no material"):
        cut.resistance(np.array([[50.0, 0, 0]]))


@pytest.mark.parametrize("name", ["turned", "shifted", "permuted", "finer"])
def test_a_ct_on_another_lattice_is_laid_where_it_lies(name):
    labels = labelled(block(1, np.uint8))
    ct = np.full((10, 10, 10), -100, np.int16)  # fat, then soft tissue, then air
    ct[:, :5], ct[:2] = 50, -900
    given = {
        "turned": labelled(ct[::-1, ::-1], origin=np.array([18.0, 18, 0]), direction=TURNED),
        "shifted": labelled(ct[2:], origin=np.array([4.0, 0, 0])),
        "permuted": labelled(ct.transpose(1, 0, 2), direction=np.eye(3)[[1, 0, 2]]),
        "finer": Volume(voxels=ct.repeat(2, 2), spacing=(2.0, 2.0, 1.0), origin=np.array([0, 0, -0.5])),
    }[name]
    expected = phantom_from_organs(labels, {1: "liver"}, ct=labelled(ct), spacing_mm=None)
    found = phantom_from_organs(labels, {1: "liver"}, ct=given, spacing_mm=None)
    assert np.array_equal(found.bytes, expected.bytes)
    assert len(np.unique(expected.bytes)) == 4


def test_a_ct_of_somewhere_else_is_refused():
    with pytest.raises(ValueError, match="ct does not overlap the labels"):
        phantom_from_organs(labelled(block(1, np.uint8)), {1: "liver"}, ct=labelled(block(), origin=np.full(3, 500.0)))


def test_a_scene_takes_what_every_other_reader_takes():
    assert Phantom(labelled(block(1.0)), {0: "gel", 1: "liver"}).bytes.max() == 1
    with pytest.raises(ValueError, match="labels has a voxel of -1; give a label map, whole numbers 0 to 255"):
        Phantom(labelled(block(-1, np.int16)), {0: "gel", 1: "liver"})


def test_names_lie_beside_an_image_under_exactly_its_name(tmp_path):
    assert names_beside("a/patient.01.nii.gz").name == "patient.01.csv"
    assert names_beside("scan.seg.nrrd").name == "scan.seg.csv"
    (tmp_path / "patient.csv").write_text("label,name\n1,liver\n")
    with pytest.raises(ValueError, match=r"has no patient\.01\.csv beside it; give the names"):
        names_of(tmp_path / "patient.01.nii.gz", None)
    with pytest.raises(ValueError, match=r"it names no segments"):
        names_of(tmp_path / "x.seg.nrrd", None)


@pytest.mark.parametrize(
    "text",
    [
        "label,name\n1,liver\n2,left kidney\n",
        "\ufefflabel,name\r\n1,liver\r\n2,left kidney\r\n",
        "Label;NAME\n1;liver\n2;left kidney\n",
        "\n label\tvoxels\tname \n 1 \t70\t liver\n\n2\t80\tleft kidney\n,,\n".replace(",,", "\t\t"),
        'name,"label"\n"liver"," 1"\n"left kidney","2"\n',
        "1,liver\n2,left kidney\n",
        "label,name\n1.0,liver\n+2,left kidney",
    ],
)
def test_names_are_read_however_a_spreadsheet_wrote_them(tmp_path, text):
    (tmp_path / "names.csv").write_bytes(text.encode())
    assert read_names(tmp_path / "names.csv") == {1: "liver", 2: "left kidney"}
    assert read_label_names(tmp_path / "names.csv") == {0: "soft_tissue", 1: "liver", 2: "left kidney"}


def test_names_of_a_windows_program_are_read(tmp_path):
    (tmp_path / "names.csv").write_bytes("label\tname\r\n1\tLunge, übrige\r\n".encode("utf-16"))
    assert read_names(tmp_path / "names.csv") == {1: "Lunge, übrige"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty; give a CSV file"),
        (b"number,tissue\n1,liver\n", "lacks the column 'label'"),
        (b"label,name,Name\n1,liver,x\n", "has twice the column 'name'"),
        (b"label,name\n1,liver\n1,spleen\n", "label 1 twice, in lines 2 and 3"),
        (b"label,name\none,liver\n", "line 2: label 'one' is not a whole number"),
        (b"label,name\n-1,liver\n", "line 2: label '-1' is not a whole number"),
        (b"label,name\n1.5,liver\n", "line 2: label '1.5' is not a whole number"),
        (b"label,name\n1\n", "line 2: 1 cells are too few"),
        (b"label,name\n1,  \n", "line 2: label 1 has an empty name"),
        (b"label,name\n1,l\xe9ber\n", "is not UTF-8 text"),
        (b"label,name\n" + b"9" * 40 + b",liver\n", "is not a whole number"),
    ],
)
def test_a_bad_table_of_names_is_refused_in_one_line(tmp_path, content, message):
    (tmp_path / "names.csv").write_bytes(content)
    with pytest.raises(ValueError, match=message) as refusal:
        read_names(tmp_path / "names.csv")
    assert "names.csv" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_an_acoustic_table_is_read_by_the_same_rules(tmp_path):
    head = "\ufeffLabel;name;speed_m_s;density_kg_m3;attenuation_db_cm_mhz;backscatter_db;texture_db;source\r\n"
    (tmp_path / "t.csv").write_text(head + "3;liver;1575; 1058;0.5;0;0.8;mine\r\n")
    assert read_table(tmp_path / "t.csv")[3].density_kg_m3 == 1058
    (tmp_path / "t.csv").write_text(head + "3;liver;1575;much;0.5;0;0.8;mine\r\n")
    with pytest.raises(ValueError, match=r"t\.csv', line 2: could not convert.*much"):
        read_table(tmp_path / "t.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
def test_what_is_no_ordinary_file_is_refused_at_once(tmp_path, kind):
    from sonospline import models
    from sonospline.commands import _parameters
    from sonospline.io.volumes import read_volume
    from sonospline.mechanics import MaterialTable
    from sonospline.ultrasound import Frame, read_dicom

    def made(name):
        path = tmp_path / name
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        else:
            path.symlink_to("/dev/zero")
        return path

    readers = {
        "names.csv": read_names,
        "table.csv": read_table,
        "materials.toml": MaterialTable.read,
        "parameters.toml": lambda path: _parameters.read(path, models.spec("paper"), 1.0),
        "scene.toml": SceneFile.read,
        "volume.mha": read_volume,
        "labels.nii.gz": ss.read_labels,
        "clip.dcm": read_dicom,
        "frame.png": lambda path: Frame.read(path, image_to_reference=np.eye(4)),
    }
    for name, read in readers.items():
        with pytest.raises(ValueError, match=f"{name}' is (a named pipe|a folder|a device); give "):
            read(made(name))


# --- label maps that move ---


def organs(shape=(30, 28, 26)):
    """Two blocks side by side in background, numbered far apart."""
    voxels = np.zeros(shape, np.uint8)
    voxels[4:26, 6:15, 5:20], voxels[4:26, 15:24, 5:20] = 3, 200
    return voxels


def test_a_warped_label_map_holds_no_label_that_was_not_there():
    from sonospline.fields import ImageWarp

    labels = LabelMap(voxels=organs(), spacing=(2.0, 2.0, 2.0))
    grid = labels.grid(4000)
    field = ss.Insertion(ss.Tissue(grid, entry_face="x-")).advance(ss.Needle((0, 26, 25), (40, 27, 25)))
    warp = ImageWarp.of(field)
    moved, blurred = warp.apply(labels), warp.apply(Volume(voxels=organs(), spacing=(2.0, 2.0, 2.0)))
    assert isinstance(moved, LabelMap)
    assert np.unique(moved.voxels).tolist() == [0, 3, 200]
    assert (moved.voxels != labels.voxels).any()
    assert len(np.unique(blurred.voxels)) > 10


def test_label_maps_are_told_from_images():
    from sonospline.geometry.label_map import looks_like_labels

    noise = np.random.default_rng(0).integers(0, 256, (30, 28, 26))
    smooth = np.indices((30, 28, 26)).sum(0)
    for voxels in (organs(), organs().astype(np.float32), (organs() > 100).astype(np.uint8) * 255):
        assert looks_like_labels(labelled(voxels))
    for voxels in (noise, smooth, smooth >> 2, noise * (organs() > 0), organs() - 1.5, np.zeros((9, 9, 9), int)):
        assert not looks_like_labels(labelled(voxels))


def test_real_images_and_label_maps_are_told_apart(shared_data):
    from sonospline.geometry.label_map import looks_like_labels
    from sonospline.io.volumes import read_volume

    assert looks_like_labels(read_volume(shared_data / "abdomen_labels.nii.gz"))
    for name in ("abdomen_ct.nii.gz", "spine_phantom_us.mha", "liver_speckle.mha"):
        assert not looks_like_labels(read_volume(shared_data / name))


@pytest.fixture
def insert(tmp_path, capsys):
    """Run ``insert`` beside a label map and an image; return its summary and what it said on stderr."""
    write_volume(labelled(organs()), tmp_path / "organs.nii.gz")
    (tmp_path / "organs.csv").write_text("label,name\n3,liver\n200,spleen\n")
    write_volume(labelled(np.indices((30, 28, 26)).sum(0).astype(np.int16)), tmp_path / "ct.nrrd")

    def run(*options):
        import json

        from sonospline.cli import main

        given = [f"{tmp_path / option}" if option.startswith(("organs", "ct")) else option for option in options]
        places = ["--entry", "0,26,25", "--target", "40,27,25", "--nodes", "4000", "--steps", "2"]
        assert main(["insert", *given, *places, "--out", str(tmp_path / "out"), "--quiet", "--json"]) == 0
        printed = capsys.readouterr()
        return json.loads(printed.out)

    return run


@pytest.mark.slow
def test_insert_warps_the_labels_beside_the_image(tmp_path, insert):
    summary = insert("--labels", "organs.nii.gz", "--volume", "ct.nrrd", "--model", "elastic", "--solver-nodes", "2000")
    assert {"warped.nrrd", "warped_labels.nii.gz"} <= set(summary["files"])
    assert summary["volume_kind"] == "image"
    moved = ss.read_labels(tmp_path / "out" / "warped_labels.nii.gz").voxels
    assert np.unique(moved).tolist() == [0, 3, 200]
    assert (moved != organs()).any()


def test_insert_takes_a_label_map_for_what_it_is_and_says_so(tmp_path, insert, caplog):
    summary = insert("--volume", "organs.nii.gz")
    assert summary["volume_kind"] == "labels"
    assert "is taken for a label map" in caplog.text
    assert np.unique(ss.read_labels(tmp_path / "out" / "warped.nii.gz").voxels).tolist() == [0, 3, 200]
    caplog.clear()
    assert insert("--volume", "organs.nii.gz", "--volume-kind", "image")["volume_kind"] == "image"
    assert len(np.unique(ss.read_labels(tmp_path / "out" / "warped.nii.gz").voxels)) > 10
    assert not caplog.text


# --- whatever is in a file ---


@given(st.dictionaries(st.integers(0, 10**6), st.text(st.characters(exclude_categories=("C", "Z")), min_size=1)))
def test_what_a_spreadsheet_writes_is_what_is_read(names):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "names.csv")
        for delimiter, encoding in ((",", "utf-8"), (";", "utf-8-sig"), ("\t", "utf-16")):
            with path.open("w", newline="", encoding=encoding) as file:
                writer = csv.writer(file, delimiter=delimiter, quoting=csv.QUOTE_ALL)
                writer.writerows([("label", "name"), *names.items()])
            assert read_names(path) == names


@given(st.binary(max_size=300))
def test_a_table_is_read_or_refused_in_one_line(content):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "names.csv")
        for start in (b"", b"label,name\n", b"label;name\r\n1;"):
            path.write_bytes(start + content)
            try:
                names = read_names(path)
            except ValueError as error:
                assert "names.csv" in str(error)
                assert "\n" not in str(error)
            else:
                assert all(label >= 0 and name == name.strip() != "" for label, name in names.items())


@given(st.integers(0, 65_535), st.floats(-0.01, 0.01), st.sampled_from([np.float32, np.float64]))
def test_a_number_is_a_label_where_it_is_within_a_thousandth_of_one(label, off, kind):
    stored = np.array(label + off, kind)
    volume = labelled(np.full((2, 2, 2), stored))
    if abs(float(stored) - label) <= 1e-3:
        assert (LabelMap.of(volume).voxels == label).all()
    else:
        with pytest.raises(ValueError, match="a voxel of"):
            LabelMap.of(volume)


def test_a_phantom_is_read_with_a_table_or_with_names(tmp_path):
    with pytest.raises(ValueError, match=r"needs table \(acoustic properties\) or names \(organ names\), one of them"):
        read_phantom(tmp_path / "organs.nrrd")
