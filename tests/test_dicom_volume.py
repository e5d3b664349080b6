"""Volumes and segments in DICOM, written here by pydicom; SimpleITK's own reader is the oracle of places."""

import json
import logging

import numpy as np
import pytest

pytest.importorskip("pydicom", reason="needs the extra 'dicom'")
from dicom_files import places, save, write_enhanced, write_segments, write_series
from link_poses import turned
from sonospline.cli import main
from sonospline.io.labels import names_for, read_labels
from sonospline.io.volumes import from_sitk, read_volume

SimpleITK = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

COUNT, ROWS, COLUMNS = 9, 14, 11
OBLIQUE = turned(3)[:3, :2].T
AXIAL = np.eye(3)[:2]


def stored(seed=0):
    return np.random.default_rng(seed).integers(0, 3000, (COUNT, ROWS, COLUMNS))


def by_simpleitk(folder):
    """Its series reader, which knows the order of slices by itself."""
    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(str(folder)))
    return from_sitk(reader.Execute())


@pytest.mark.parametrize("axes", [AXIAL, OBLIQUE, -OBLIQUE[::-1]], ids=["axial", "oblique", "flipped"])
@pytest.mark.parametrize("step", [2.5, -2.5])
def test_a_folder_of_slices_is_a_volume(tmp_path, axes, step):
    """Every voxel is where its file says it is, and where SimpleITK has it."""
    pixels, positions = stored(), places(COUNT, axes, step=step)
    write_series(tmp_path / "case", pixels, positions, axes)
    (tmp_path / "case" / "README").write_text("no image")
    found = read_volume(tmp_path / "case")
    assert found.voxels.dtype == np.int16
    lps, (down, right) = np.array([-1, -1, 1.0]), (0.8, 1.4)
    for k, row, column in ((0, 0, 0), (3, 13, 2), (8, 5, 10)):
        place = lps * (positions[k] + axes[0] * right * column + axes[1] * down * row)
        index = found.index(place[None])[0]
        np.testing.assert_allclose(index, np.rint(index), atol=1e-6)
        assert found.voxels[tuple(np.rint(index).astype(int))] == pixels[k, row, column] - 1024
    theirs = by_simpleitk(tmp_path / "case")
    inner = found.lattice.world(np.random.default_rng(1).uniform(0.1, 0.9, (50, 3)) * found.lattice.extent)
    np.testing.assert_allclose(found.sample(inner), theirs.sample(inner), atol=0.01)


def test_many_slices_in_a_file_are_those_of_a_folder(tmp_path):
    pixels, positions = stored(), places(COUNT, OBLIQUE)
    write_series(tmp_path / "case", pixels, positions, OBLIQUE)
    write_enhanced(tmp_path / "one", pixels, positions, OBLIQUE, order=np.random.default_rng(2).permutation(COUNT))
    folder, file = read_volume(tmp_path / "case"), read_volume(tmp_path / "one")  # without a suffix: by its beginning
    np.testing.assert_array_equal(file.voxels, folder.voxels)
    np.testing.assert_allclose(file.lattice.origin, folder.lattice.origin)
    np.testing.assert_allclose(file.lattice.direction, folder.lattice.direction)
    np.testing.assert_allclose(file.spacing, folder.spacing)


def test_of_several_series_that_with_most_slices_is_taken_and_said(tmp_path, caplog):
    write_series(tmp_path / "case", stored(), places(COUNT, AXIAL), AXIAL)
    small = stored(5)[:4] % 100
    write_series(tmp_path / "case", small, places(4, OBLIQUE), OBLIQUE, description="scout", first=1)
    with caplog.at_level(logging.WARNING):
        found = read_volume(tmp_path / "case")
    assert found.voxels.shape == (COLUMNS, ROWS, COUNT)
    [line] = caplog.messages
    assert "holds 2 series: CT 'thorax' (9 slices) is taken, not CT 'scout' (4 slices); name a file" in line
    caplog.clear()
    with pytest.raises(ValueError, match="a voxel of -1024"):
        read_labels(tmp_path / "case")
    assert len(caplog.records) == 1, "labels are read once, too"
    caplog.clear()
    scout = read_volume(tmp_path / "case" / "IM00207.dcm")
    assert scout.voxels.shape == (COLUMNS, ROWS, 4)
    assert scout.voxels.max() == small.max() - 1024
    assert not caplog.messages


def without_the_sixth(folder):
    positions = places(COUNT, AXIAL)
    write_series(folder, np.delete(stored(), 5, 0), np.delete(positions, 5, 0), AXIAL)


def a_tilted_gantry(folder):
    write_series(folder, stored(), places(COUNT, AXIAL, tilt=0.5), AXIAL)


def two_phases(folder):
    uid = write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    write_series(folder, stored(1), places(COUNT, AXIAL), AXIAL, uid=uid, first=1)


def uneven(folder):
    positions = places(COUNT, AXIAL)
    positions[4] = positions[4] + [0, 0, 0.6]
    write_series(folder, stored(), positions, AXIAL)


def no_lattice(folder):
    write_series(folder, stored(), places(COUNT, AXIAL), [[1, 0, 0], [0.5, 0.75**0.5, 0]])


def one_slice(folder):
    write_series(folder, stored()[:1], places(1, AXIAL), AXIAL)


def nothing(folder):
    folder.mkdir()
    (folder / "notes.txt").write_text("no image")


def cut(folder):
    without_pixels(folder, 400)


def without_pixels(folder, left):
    import pydicom

    write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    made = pydicom.dcmread(file := folder / "IM00014.dcm")
    made.PixelData = made.PixelData[: len(made.PixelData) - left]
    save(made, file)


def cut_in_its_header(folder):
    write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    (first := folder / "IM00000.dcm").write_bytes(first.read_bytes()[:700])


def cut_at_once(folder):
    write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    (first := folder / "IM00000.dcm").write_bytes(first.read_bytes()[:150])


def white_at_zero(folder):
    each(folder, PhotometricInterpretation="MONOCHROME1")


def each(folder, **fields):
    """Slices that say something more each."""
    import pydicom

    write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    for file in folder.iterdir():
        made = pydicom.dcmread(file)
        for name, value in fields.items():
            setattr(made, name, value)
        save(made, file)


def no_places(folder):
    import pydicom

    write_series(folder, stored(), places(COUNT, AXIAL), AXIAL)
    for file in folder.iterdir():
        made = pydicom.dcmread(file)
        made.ImagePositionPatient = ["1e999", 0, 0]
        save(made, file)


@pytest.mark.parametrize(
    ("write", "line"),
    [
        (without_the_sixth, r"lacks 1 slice: after slice 5 of 8 the next is 5 mm away, others 2\.5 mm; add"),
        (a_tilted_gantry, r"shifted against each other by 11\.3 degrees \(a tilted gantry\); load it in 3D Slicer"),
        (two_phases, r"2 slices at one place \(phases, echoes or repeats\); give a folder of one"),
        (uneven, r"slices unevenly apart, 1\.9 to 3\.1 mm; resample"),
        (no_lattice, r"rows and columns that are not at right angles"),
        (one_slice, r"is a folder; give one with a DICOM series of two slices or more"),
        (nothing, r"is a folder; give one with a DICOM series of two slices or more"),
        (no_places, r"is a folder; give one with a DICOM series of two slices or more"),
        (cut_in_its_header, r": IM00000\.dcm is cut or damaged; copy it anew"),
        (cut_at_once, r": IM00000\.dcm is cut or damaged; copy it anew"),
        (white_at_zero, r"has its white at the least value \(MONOCHROME1\)"),
        (cut, r"the pixels of IM00014\.dcm cannot be decoded"),
    ],
)
def test_what_is_no_volume_is_refused_in_one_line(tmp_path, write, line):
    write(tmp_path / "case")
    with pytest.raises(ValueError, match=line) as refused:
        read_volume(tmp_path / "case", name="volume")
    assert str(refused.value).startswith(f"volume = '{tmp_path / 'case'}'")
    assert "\n" not in str(refused.value)


def test_what_is_named_dicom_and_is_none_is_refused(tmp_path):
    (tmp_path / "a.dcm").write_bytes(b"\0" * 128 + b"DICM" + bytes(range(256)))
    with pytest.raises(
        ValueError, match=r"labels = '.*a\.dcm' is n(o DICOM file that can be read|ot of a DICOM series)"
    ):
        read_labels(tmp_path / "a.dcm")
    with pytest.raises(ValueError, match=r"labels = '.*b\.dcm' does not exist; give an image in DICOM"):
        read_labels(tmp_path / "b.dcm")


def test_segments_are_labels_with_names(tmp_path):
    """Slices that were left out are empty; where two segments overlap, the later one is there."""
    draw = np.random.default_rng(4)
    masks = draw.random((2, COUNT, ROWS, COLUMNS)) < 0.3
    masks[0, [0, 4]] = False
    masks[1, 4:6] = False
    positions = places(COUNT, OBLIQUE)
    write_segments(tmp_path / "organs.dcm", masks, positions, OBLIQUE, ["liver", "tumour"])
    labels = read_labels(tmp_path / "organs.dcm")
    assert labels.names == {1: "liver", 2: "tumour"}
    assert names_for(labels, tmp_path / "organs.dcm", None) == labels.names
    wanted = np.where(masks[1], 2, np.where(masks[0], 1, 0))
    np.testing.assert_array_equal(labels.voxels, wanted.transpose(2, 1, 0))
    write_series(tmp_path / "case", stored(), positions, OBLIQUE)
    assert labels.lattice == read_volume(tmp_path / "case").lattice
    (tmp_path / "organs.csv").write_text("label,name\n1,left\n2,right\n")
    assert read_labels(tmp_path / "organs.dcm").names == {1: "left", 2: "right"}


@pytest.mark.parametrize("there", [(2, 8), (0, 2, 5)])
def test_slices_that_segments_leave_out_are_as_high_as_others(tmp_path, there):
    masks = np.zeros((1, COUNT, ROWS, COLUMNS), bool)
    masks[0, list(there)] = np.random.default_rng(5).random((len(there), ROWS, COLUMNS)) < 0.5
    positions = places(COUNT, OBLIQUE)
    write_segments(tmp_path / "a.dcm", masks, positions, OBLIQUE, ["liver"], SpacingBetweenSlices=2.5)
    labels = read_labels(tmp_path / "a.dcm")
    assert labels.lattice.spacing[2] == pytest.approx(2.5)
    np.testing.assert_array_equal(labels.voxels, masks[0, there[0] : there[-1] + 1].transpose(2, 1, 0))
    write_segments(tmp_path / "b.dcm", masks, positions, OBLIQUE, ["liver"])
    with pytest.raises(ValueError, match=r"2\.5 mm thick and \S+ mm apart, and does not say which lack"):
        read_labels(tmp_path / "b.dcm")


def test_slices_that_say_they_are_one_frame_are_a_series(tmp_path):
    each(tmp_path / "case", NumberOfFrames=1)
    assert read_volume(tmp_path / "case" / "IM00000.dcm").voxels.shape == (COLUMNS, ROWS, COUNT)


def test_scales_of_each_slice_are_applied(tmp_path):
    """As in PET: numbers that are not whole are kept as such."""
    import pydicom

    pixels = stored()
    write_series(tmp_path / "case", pixels, places(COUNT, AXIAL), AXIAL)
    for number, file in enumerate(sorted((tmp_path / "case").iterdir(), key=lambda f: int(f.stem[2:]))):
        made = pydicom.dcmread(file)
        made.RescaleSlope, made.RescaleIntercept = 0.5 + number, 0.25
        save(made, file)
    found = read_volume(tmp_path / "case")
    wanted = pixels * (0.5 + np.arange(COUNT))[:, None, None] + 0.25
    np.testing.assert_allclose(found.voxels, wanted.transpose(2, 1, 0), rtol=1e-6)


@pytest.mark.slow
def test_insert_takes_a_folder(tmp_path, capsys):
    pixels = 100 + stored() // 100
    write_series(tmp_path / "case", pixels, places(COUNT, AXIAL), AXIAL)
    options = "--frame IJK --entry 1,7,0 --target 6,7,5 --nodes 500 --steps 2 --model kelvinlet --quiet --json"
    assert main(["insert", "--volume", str(tmp_path / "case"), *options.split(), "--out", str(tmp_path / "out")]) == 0
    assert "warped.nrrd" in json.loads(capsys.readouterr().out)["files"]
