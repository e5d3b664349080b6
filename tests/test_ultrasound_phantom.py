"""Scenes: labels and their tissues, the kidney phantom, CT, and what the picture of a kidney shows."""

import numpy as np
import pytest

import sonospline as ss
from builds import needs_core
from sonospline import _core
from sonospline.geometry import facing
from sonospline.geometry.volume import Volume
from sonospline.io.tables import read_names
from sonospline.phantoms import kidney_phantom
from sonospline.phantoms.kidney import LABELS
from sonospline.ultrasound import Phantom, Probe, Scanner
from sonospline.ultrasound.acoustics import TISSUES, known, read_table
from sonospline.ultrasound.cine import write_gif, write_sequence
from sonospline.ultrasound.organs import phantom_from_organs, tissue_of


@pytest.fixture(scope="module")
def kidney():
    return kidney_phantom(spacing_mm=1.0)


@pytest.fixture(scope="module")
def kidney_image(kidney):
    return Scanner(kidney.phantom, Probe.curvilinear(lines=128, samples=1024), kidney.probe_to_reference).render()


# --- labels and tissues ---


def test_every_default_tissue_is_plausible_and_names_its_source():
    for tissue in TISSUES.values():
        assert 300 < tissue.speed_m_s < 4500
        assert tissue.source
    assert known("liver").backscatter_db == 0
    with pytest.raises(ValueError, match=r"'jelly' has no acoustic properties; use one of .*liver"):
        known("jelly")


@pytest.mark.parametrize(
    ("voxels", "tissues", "message"),
    [
        (np.array([0, 7]), {0: "liver"}, r"label 7 has no acoustic properties.*liver"),
        (np.array([0, 1]), {0: "liver", 1: "jelly"}, r"label 1 is 'jelly'.*liver"),
        (np.array([0, 1]), {1: "liver"}, r"label 0 has no"),
        (np.array([0, 300]), {0: "liver"}, "0 to 255"),
        (np.array([0.0, 0.9]), {0: "liver", 1: "fat"}, "whole numbers"),
    ],
)
def test_a_label_without_properties_is_named_with_the_known_ones(voxels, tissues, message):
    labels = Volume(voxels=np.broadcast_to(voxels, (2, 2, 2)).copy(), spacing=(1, 1, 1))
    with pytest.raises(ValueError, match=message):
        Phantom(labels, tissues)


def test_labels_must_be_a_volume():
    with pytest.raises(ValueError, match="not a Volume"):
        Phantom(np.zeros((3, 3, 3), np.uint8), {0: "liver"})


def test_interfaces_lie_on_the_step_and_point_across_it():
    """A ball: points on its surface, normals along the radius, area in sum."""
    x, y, z = np.indices((48, 48, 48)) - 23.5
    ball = (x**2 + y**2 + z**2 < 15**2).astype(np.uint8)
    phantom = Phantom(Volume(voxels=ball, spacing=(0.8,) * 3), {0: "liver", 1: "fat"})
    found = phantom.interfaces
    from_centre = found.points - 23.5 * 0.8
    radius = np.linalg.norm(from_centre, axis=1)
    assert radius.mean() == pytest.approx(12, abs=0.1)
    assert radius.std() < 0.2
    assert np.abs((from_centre / radius[:, None] * found.normals).sum(axis=1)).mean() > 0.97
    assert found.area.sum() == pytest.approx(4 * np.pi * 12**2, rel=0.08)
    fat, liver = TISSUES["fat"].impedance, TISSUES["liver"].impedance
    assert np.allclose(found.reflection, (liver - fat) / (liver + fat))


def sorted_rows(*columns):
    """Rows of some arrays side by side, sorted."""
    table = np.column_stack(columns)
    return table[np.lexsort(np.round(table, 3).T)]


@needs_core
@pytest.mark.parametrize("spacing", [(0.8, 0.8, 0.8), (1.0, 0.7, 2.0)])
def test_the_core_and_its_twin_find_the_same_interfaces(spacing, monkeypatch):
    """Larger than a block of the core, and a slab of the twin, along one axis each."""
    x, y, z = np.indices((60, 36, 34)) - np.array([29.5, 17.5, 16.5])[:, None, None, None]
    labels = (x**2 / 4 + y**2 + z**2 < 200).astype(np.uint8) + 2 * (z > 10)
    phantom = Phantom(
        Volume(voxels=labels.astype(np.uint8), spacing=spacing), {0: "liver", 1: "fat", 2: "bone", 3: "urine"}
    )
    found = {}
    for name in ("native", "twin"):
        monkeypatch.setattr(_core, "active", getattr(_core, name))
        found[name] = sorted_rows(*phantom.echoes.interfaces())
    assert len(found["twin"]) > 2000
    np.testing.assert_allclose(found["native"], found["twin"], atol=1e-4)


def test_a_look_does_not_depend_on_the_looks_before_it(kidney):
    """Interfaces are found where a probe looks; one that saw all of the phantom before sees the same."""

    def look(phantom, across):
        pose = facing((58, 50 + across, 8), depth=(0, 0, 1), right=(1, 0, 0))
        return Scanner(phantom, Probe.curvilinear(lines=64, samples=1024), pose).render().iq

    fresh, prepared = (Phantom(kidney.phantom.labels, kidney.phantom.tissues) for _ in range(2))
    prepared.prepare()
    for across in (0, 30, -10):
        np.testing.assert_array_equal(look(fresh, across), look(prepared, across))


# --- the phantom ---


def test_the_kidney_has_the_size_and_the_parts_of_one(kidney):
    ml = np.bincount(kidney.phantom.bytes.ravel(), minlength=13) * 1e-3
    by_name = {name: ml[label] for label, name in LABELS.items()}
    assert set(np.flatnonzero(ml)) == set(LABELS)
    size = sum(by_name[name] for name in ("kidney cortex", "kidney medulla", "sinus fat", "urine"))
    assert 105 < size < 150
    assert 4.5 < by_name["kidney medulla"] < 40
    along = np.flatnonzero((kidney.phantom.bytes == 7).any(axis=(1, 2)))
    assert 95 < np.ptp(along) < 115


def test_a_kept_phantom_is_the_one_that_is_made(kidney, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    for _ in range(2):  # made, then read
        assert np.array_equal(kidney_phantom(spacing_mm=1.0, kept=True).phantom.bytes, kidney.phantom.bytes)
    (file,) = tmp_path.glob("kidney-*.npy")
    file.write_bytes(b"spoilt")
    assert np.array_equal(kidney_phantom(spacing_mm=1.0, kept=True).phantom.bytes, kidney.phantom.bytes)
    assert "cannot be used and will be made anew" in caplog.text


def test_targets_lie_in_calyces_and_the_needle_reaches_one(kidney):
    lattice = kidney.phantom.labels.lattice
    for target in kidney.targets.values():
        index = tuple(np.rint(lattice.local(target[None])[0]).astype(int))
        assert LABELS[kidney.phantom.bytes[index]] == "urine"
    assert np.array_equal(kidney.needle.tip, kidney.targets["lower calyx"])
    assert 90 < kidney.needle.depth < 130
    assert kidney.grid(5000).contains(kidney.needle.entry[None]).all()
    with pytest.raises(ValueError, match="too coarse"):
        kidney_phantom(spacing_mm=9.0)


def grey_of(image, kidney, name, *, inside_by=2):
    """Mean grey level of the picture's pixels that show a tissue, so many pixels away from its edges."""
    from scipy.ndimage import binary_erosion

    lattice = kidney.phantom.labels.lattice
    index = np.rint(lattice.local(image.frame.plane.points) / lattice.spacing).astype(int)
    inside = ((index >= 0) & (index < lattice.shape)).all(axis=1)
    label = np.where(inside, kidney.phantom.bytes[tuple(np.clip(index, 0, np.array(lattice.shape) - 1).T)], 255)
    shown = (label == next(n for n, tissue in LABELS.items() if tissue == name)).reshape(image.frame.plane.shape)
    return image.frame.pixels[binary_erosion(shown, iterations=inside_by) & image.frame.mask].mean()


def test_a_sonographer_finds_the_kidneys_parts_by_their_brightness(kidney_image, kidney):
    grey = {name: grey_of(kidney_image, kidney, name) for name in ("sinus fat", "kidney cortex", "kidney medulla")}
    grey["urine"] = grey_of(kidney_image, kidney, "urine", inside_by=7)  # the pelvis: ducts are narrower than the beam
    assert grey["sinus fat"] > grey["kidney cortex"] + 25
    assert grey["kidney cortex"] > grey["kidney medulla"] + 10
    assert grey["kidney medulla"] > grey["urine"] + 15


@pytest.mark.slow
def test_the_rib_casts_a_shadow_and_the_needle_is_seen(kidney_image, kidney):
    probe = kidney_image.optics.probe
    rib = probe.beam_coordinates(np.array([[27.0 - 58, 23 - 8 + 6, 0]]))[0]
    line, sample = int(rib[1]), int(rib[0] / probe.sample_mm)
    assert kidney_image.beams[line - 3 : line + 4, sample + 150 : sample + 500].mean() < 12
    assert kidney_image.beams[60:90, sample + 150 : sample + 500].mean() > 40
    grid = kidney.grid(20_000)
    field = ss.GridField.of(ss.Insertion(ss.Tissue(grid, entry_face="z-")).advance(kidney.needle))
    scanner = Scanner(kidney.phantom, probe, kidney.probe_to_reference)
    without, with_needle = scanner.render(field).frame, scanner.render(field, kidney.needle).frame
    x, y, _ = without.plane.project(kidney.needle.at(np.linspace(0.5, 0.97, 200))).T
    column, row = (
        np.rint((v - c) / without.plane.spacing_mm[0]).astype(int)
        for v, c in zip((x, y), without.plane.corner_mm, strict=True)
    )
    assert with_needle.pixels[row, column].mean() > without.pixels[row, column].mean() + 20


def test_the_scene_is_exported_for_slicer(kidney, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    kidney.phantom.save(tmp_path / "kidney.seg.nrrd", tmp_path / "tissues.csv")
    image = sitk.ReadImage(str(tmp_path / "kidney.seg.nrrd"))
    assert np.array_equal(sitk.GetArrayFromImage(image).transpose(2, 1, 0), kidney.phantom.bytes)
    names = {image.GetMetaData(k) for k in image.GetMetaDataKeys() if k.endswith("_Name")}
    assert names == {name for label, name in LABELS.items() if label}
    table = read_table(tmp_path / "tissues.csv")
    assert table[7].impedance == pytest.approx(TISSUES["kidney cortex"].impedance)
    with pytest.raises(ValueError, match="does not exist; give a CSV"):
        read_table(tmp_path / "none.csv")


# --- scenes from CT ---


def test_organ_names_find_their_tissue():
    wanted = {"costal_cartilages": "cartilage", "vertebrae_L2": "bone", "urinary_bladder": "urine", "aorta": "blood",
              "kidney_left": "kidney cortex", "lung_upper_lobe_left": "gas", "autochthon_right": "muscle"}  # fmt: skip
    assert {organ: tissue_of(organ) for organ in wanted} == wanted
    with pytest.raises(ValueError, match="'nose' has no acoustic properties"):
        tissue_of("nose")


def test_refining_keeps_shapes_and_rounds_them():
    x, y, z = np.indices((20, 20, 20)) - 9.5
    ball = (x**2 + y**2 + z**2 < 49).astype(np.uint8)
    coarse = Phantom(Volume(voxels=ball, spacing=(3.0,) * 3), {0: "liver", 1: "fat"})
    fine = coarse.refined(1.0)
    volumes = [np.count_nonzero(s.bytes) * np.prod(s.labels.lattice.spacing) for s in (coarse, fine)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.1)
    assert max(fine.labels.lattice.spacing) <= 1.05
    assert np.allclose(fine.labels.lattice.extent, coarse.labels.lattice.extent)


@pytest.mark.slow
def test_labelled_ct_is_a_scene_too(shared_data):
    from sonospline.io.volumes import read_volume

    labels, ct = (read_volume(shared_data / name) for name in ("abdomen_labels.nii.gz", "abdomen_ct.nii.gz"))
    names = read_names(shared_data / "abdomen_labels.csv")
    phantom = phantom_from_organs(labels, names, ct=ct, spacing_mm=2.0)
    assert {"liver", "kidney cortex", "bone", "fat", "gel"} <= {tissue.name for tissue in phantom.tissues.values()}
    right_kidney = labels.position(np.argwhere(labels.voxels == 2).mean(axis=0)[None])[0]
    pose = facing(right_kidney - [-60, 0, 0], depth=(-1, 0, 0), right=(0, 1, 0))
    image = Scanner(phantom, Probe.curvilinear(depth_mm=100, lines=96), pose).render()
    assert 10 < image.frame.pixels[image.frame.mask].mean() < 140
    with pytest.raises(ValueError, match="label 2 has no name"):
        phantom_from_organs(labels, {k: v for k, v in names.items() if k != 2}, ct=ct)


# --- series ---


def test_a_series_is_written_as_a_sequence_and_a_gif(kidney_image, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    frames = [kidney_image.frame] * 3
    write_sequence(frames, tmp_path / "cine.igs.mha")
    image = sitk.ReadImage(str(tmp_path / "cine.igs.mha"))
    stack = sitk.GetArrayFromImage(image)
    assert np.array_equal(stack[1], kidney_image.frame.pixels)
    assert image.GetSpacing() == (1, 1, 1)  # the image frame of PLUS counts pixels
    matrix = np.array([float(x) for x in image.GetMetaData("Seq_Frame0002_ImageToReferenceTransform").split()]).reshape(
        4, 4
    )
    plane = kidney_image.frame.plane
    assert np.allclose((matrix @ [30, 40, 0, 1])[:3] * [-1, -1, 1], plane.points[40 * plane.shape[1] + 30], atol=1e-5)
    pillow = pytest.importorskip("PIL.Image", reason="needs the extra 'plot'")
    write_gif([kidney_image.frame, *frames], tmp_path / "cine.gif")
    with pillow.open(tmp_path / "cine.gif") as gif:
        assert gif.size == plane.shape[::-1]
    with pytest.raises(ValueError, match="empty"):
        write_sequence([], tmp_path / "none.mha")
