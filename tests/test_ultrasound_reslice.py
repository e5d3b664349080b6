"""Real images that deform: volumes cut by a plane, and single frames."""

import logging

import numpy as np
import pytest

import sonospline as ss
from builds import needs_core
from sonospline import _core
from sonospline.geometry import ImagePlane, facing
from sonospline.geometry.layered_block import default_needle, layered_block
from sonospline.ultrasound import Frame, Reslicer, swept

BACK_ENDS = [_core.twin] + ([_core.native] if _core.native else [])


@pytest.fixture(scope="module")
def block():
    return layered_block()


@pytest.fixture(scope="module")
def block_field(block):
    """A field of some millimetres in the generated block."""
    path = default_needle()
    grid = block.grid(30_000)
    return ss.GridField.of(ss.Insertion(ss.Tissue(grid, entry_face=grid.nearest_face(path.entry))).advance(path))


@pytest.fixture
def block_plane(block):
    return ImagePlane.crossing(block.lattice, normal=(0, 0.3, 1), through=(48, 42, 42), pixels=160)


def test_an_undeformed_cut_is_linear_interpolation(backend, block, block_plane):
    frame = Reslicer(block).cut(block_plane)
    expected = block.sample(block_plane.points).reshape(block_plane.shape)
    inside = np.isfinite(expected)
    assert frame.mask[inside].all()
    assert np.abs(frame.pixels[inside] - expected[inside]).max() <= 0.5 + 1e-3
    assert not frame.pixels[~frame.mask].any()


def test_a_cut_agrees_with_itk_through_the_exported_transform(block, block_field, block_plane):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    from sonospline.fields import ImageWarp
    from sonospline.io.volumes import RAS_TO_LPS, to_sitk

    # Linear between nodes is not its own inverse's: on a finer lattice the two agree.
    grid = block.grid(300_000)
    exact = ss.GridField(grid, block_field.displacement(grid.points).reshape(*grid.shape, 3))
    frame = Reslicer(block).cut(block_plane, exact)
    like = sitk.Image([block_plane.shape[1], block_plane.shape[0], 1], sitk.sitkUInt8)
    like.SetSpacing((*block_plane.spacing_mm, 1.0))
    like.SetOrigin((RAS_TO_LPS @ block_plane.affine[:, 2]).tolist())
    like.SetDirection((RAS_TO_LPS @ block_plane.image_to_reference[:3, :3]).ravel().tolist())
    warped = sitk.Resample(to_sitk(block), like, ImageWarp.of(exact).to_sitk(), sitk.sitkLinear, 0.0)
    expected = sitk.GetArrayFromImage(warped)[0]
    inside = frame.mask & block.lattice.contains(block_plane.points, tolerance=-0.01).reshape(frame.mask.shape)
    off = np.abs(frame.pixels[inside].astype(int) - expected[inside])
    assert inside.mean() > 0.4
    assert (off <= 1).mean() >= 0.99
    still = Reslicer(block).cut(block_plane)
    assert (
        np.abs(frame.pixels[inside].astype(int) - still.pixels[inside]) > 1
    ).mean() > 0.2  # there was something to agree on


@needs_core
def test_core_and_twin_cut_alike(block, block_field, block_plane, monkeypatch):
    frames = []
    for back_end in BACK_ENDS:
        monkeypatch.setattr(_core, "active", back_end)
        frames.append(Reslicer(block).cut(block_plane, block_field))
    assert (frames[0].mask != frames[1].mask).mean() < 1e-3
    both = frames[0].mask & frames[1].mask
    assert np.abs(frames[0].pixels[both].astype(int) - frames[1].pixels[both]).max() <= 2
    assert (frames[0].pixels[both] != frames[1].pixels[both]).mean() < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("back_end", BACK_ENDS, ids=lambda b: b.__name__.rpartition(".")[2])
@pytest.mark.parametrize("pixel_mm", [0.15, 0.7])
def test_pixels_show_the_voxel_that_the_inverse_map_brings_there(block, block_field, back_end, pixel_mm, monkeypatch):
    """Images whose grey is the voxel's own index say where a pixel came from: to 0.02 of a voxel."""
    from sonospline.geometry.volume import Volume

    monkeypatch.setattr(_core, "active", back_end)
    lattice = block.lattice
    shape = (int(40 / pixel_mm), int(50 / pixel_mm))
    plane = ImagePlane(
        image_to_reference=facing((6, 20, 42), depth=(0, 1, 0), right=(1, 0, 0.2)), shape=shape, spacing_mm=pixel_mm
    )
    expected = lattice.local(block_field.inverse(plane.points)) / np.array(lattice.spacing)
    for axis in range(3):
        index = np.indices(block.voxels.shape, dtype=np.float32)[axis]
        frame = Reslicer(Volume(voxels=index, spacing=lattice.spacing, origin=lattice.origin)).cut(plane, block_field)
        wanted = np.clip(expected[:, axis], 0, block.voxels.shape[axis] - 1).reshape(shape)
        error = np.abs(frame.pixels - wanted)[frame.mask]
        assert frame.mask.mean() > 0.9
        assert error.max() < 0.02
        assert error.mean() < 0.002


def test_a_plane_that_misses_is_black_and_warned_of(block, caplog):
    away = ImagePlane(
        image_to_reference=facing((0, 0, 500), depth=(0, 1, 0), right=(1, 0, 0)), shape=(20, 20), spacing_mm=1
    )
    with caplog.at_level(logging.WARNING):
        frame = Reslicer(block).cut(away)
    assert not frame.pixels.any()
    assert not frame.mask.any()
    assert "misses" in caplog.text
    assert away.misses(block.lattice)


def test_what_the_sweep_never_saw_stays_masked_and_moves_with_the_tissue(block, block_field, block_plane):
    seen = np.ones(block.voxels.shape, bool)
    seen[:, :, : seen.shape[2] // 2] = False
    still, moved = (Reslicer(block, seen=seen).cut(block_plane, f) for f in (None, block_field))
    assert 0.1 < still.mask.mean() < 0.9
    assert not still.pixels[~still.mask].any()
    assert (still.mask != moved.mask).any()


@pytest.mark.parametrize(
    ("voxels", "message"),
    [(np.zeros((4, 4, 4), complex), "grey image"), (np.zeros((4, 4, 4), "U1"), "grey image")],
)
def test_a_volume_of_the_wrong_type_is_refused(voxels, message):
    from sonospline.geometry.volume import Volume

    with pytest.raises(ValueError, match=message):
        Reslicer(Volume(voxels=voxels, spacing=(1, 1, 1)))
    with pytest.raises(ValueError, match="not a Volume"):
        Reslicer(np.zeros((4, 4, 4)))


@pytest.mark.slow
def test_a_real_sweep_is_resliced_while_a_needle_moves(shared_data):
    from sonospline.io.volumes import read_volume

    volume = read_volume(shared_data / "spine_phantom_us.mha")
    seen = swept(volume)
    assert 0.25 < (volume.voxels > 0).mean() < seen.mean() < 0.35
    grid = volume.grid(60_000)
    entry, tip = grid.world(np.array([[36, 0, 25.0], [36, 30, 25]]))
    field = ss.GridField.of(ss.Insertion(ss.Tissue(grid, entry_face="y-")).advance(ss.Needle(entry, tip)))
    plane = ImagePlane.crossing(volume.lattice, normal=grid.direction[:, 2], through=tip, pixels=256)
    before, after = (Reslicer(volume, seen=seen).cut(plane, f) for f in (None, field))
    changed = np.abs(after.pixels.astype(int) - before.pixels)[before.mask & after.mask]
    assert (changed > 3).mean() > 0.02


@pytest.fixture
def a_frame():
    """A smooth picture on the plane y = 42 of the generated block."""
    x, y = np.meshgrid(np.arange(120), np.arange(90))
    grey = (120 + 60 * np.sin(x / 9) * np.cos(y / 7)).astype(np.uint8)
    return Frame.placed(grey, spacing_mm=0.7, probe_to_reference=facing((2, 42, 42), depth=(1, 0, 0), right=(0, 0, 1)))


def test_a_frame_deforms_as_its_pixels_inverse_says(a_frame, block_field):
    moved = a_frame.deform(block_field)
    row, column = 50, 60
    flat = a_frame.plane.project(block_field.inverse(a_frame.plane.points[[row * 120 + column]]))[0]
    index = (flat[:2] - a_frame.plane.corner_mm) / 0.7
    expected = 120 + 60 * np.sin(index[0] / 9) * np.cos(index[1] / 7)
    assert moved.pixels[row, column] == pytest.approx(expected, abs=3)
    assert (moved.pixels != a_frame.pixels).mean() > 0.2
    assert moved.pixels.dtype == np.uint8


def test_a_frame_is_written_with_its_geometry(a_frame, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    a_frame.save(tmp_path / "frame.mha")
    image = sitk.ReadImage(str(tmp_path / "frame.mha"))
    lps = np.array(image.TransformContinuousIndexToPhysicalPoint((30.0, 40.0, 0.0)))
    assert np.allclose(lps * [-1, -1, 1], a_frame.plane.points[40 * 120 + 30], atol=1e-6)
    a_frame.save(tmp_path / "frame.png")
    back = Frame.read(tmp_path / "frame.png", spacing_mm=0.7, image_to_reference=a_frame.plane.image_to_reference)
    assert np.array_equal(back.pixels, a_frame.pixels)
    with pytest.raises(ValueError, match="spacing_mm"):
        Frame.read(tmp_path / "frame.png", image_to_reference=np.eye(4))
    with pytest.raises(ValueError, match="does not exist"):
        Frame.read(tmp_path / "none.png", image_to_reference=np.eye(4))


def test_an_uncalibrated_frame_is_refused_unless_a_spacing_is_given(shared_data):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    with pytest.raises(ValueError, match="spacing_mm"):
        Frame.read(shared_data / "linear_bmode.igs.mha", image_to_reference=np.eye(4))
    frame = Frame.read(shared_data / "linear_bmode.igs.mha", image_to_reference=np.eye(4), spacing_mm=0.1)
    assert frame.pixels.shape in {(260, 400), (400, 260)}
