"""Volumes, transforms and VTK files: round trips, frames, and refusals."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.fields import ImageWarp
from sonospline.geometry.volume import Volume
from sonospline.io.volumes import RAS_TO_LPS, read_volume, to_sitk, write_volume
from sonospline.io.vtk import write_vti

sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

TILT = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]


@pytest.fixture
def tilted_volume():
    voxels = np.random.default_rng(0).integers(0, 4000, (24, 20, 18)).astype(np.int16)
    return Volume(voxels=voxels, spacing=(1.0, 1.5, 2.0), origin=np.array([5.0, -7, 11]), direction=TILT)


@pytest.fixture
def smooth_volume():
    """A volume linear interpolation represents well, so that geometry errors stand out."""
    x, y, z = np.indices((40, 36, 32))
    return Volume(voxels=(x + 2.0 * y - z).astype(np.float32), spacing=(1.0,) * 3, direction=TILT)


@pytest.fixture
def field_in():
    def make(volume):
        grid = volume.grid(nodes=4000)
        entry, target = grid.world(grid.extent * np.array([[0, 0.45, 0.5], [0.6, 0.5, 0.5]]))
        return ss.Insertion(ss.Tissue(grid, entry_face="x-")).advance(ss.Needle(entry, target))

    return make


@pytest.mark.parametrize("suffix", [".nrrd", ".mha", ".nii.gz"])
def test_a_volume_survives_a_round_trip(tilted_volume, tmp_path, suffix):
    write_volume(tilted_volume, tmp_path / f"v{suffix}")
    back = read_volume(tmp_path / f"v{suffix}")
    assert back.voxels.dtype == np.int16
    assert np.array_equal(back.voxels, tilted_volume.voxels)
    # NIfTI keeps its geometry in float32
    assert np.allclose(back.lattice.points, tilted_volume.lattice.points, atol=1e-4)


def test_voxels_lie_where_simpleitk_says_in_lps(tilted_volume):
    image = to_sitk(tilted_volume)
    index = np.array([3, 7, 11])
    world = tilted_volume.position(index[None])[0]
    assert np.allclose(RAS_TO_LPS @ world, image.TransformIndexToPhysicalPoint(index.tolist()))
    assert image[index.tolist()] == tilted_volume.voxels[tuple(index)]
    assert np.allclose(tilted_volume.index(world[None]), index)


def test_the_transform_gives_the_inverse_of_the_field_in_lps(smooth_volume, field_in):
    field = field_in(smooth_volume)
    warp = ImageWarp.of(field)
    assert warp.report.converged.all()
    transform = warp.to_sitk()
    node = field.grid.points[np.linalg.norm(field.on_grid("direct"), axis=-1).argmax()]
    expected = field.inverse(node[None])[0]
    assert np.linalg.norm(expected - node) > 0.1
    assert np.allclose(RAS_TO_LPS @ transform.TransformPoint((RAS_TO_LPS @ node).tolist()), expected, atol=1e-9)


def test_the_image_is_warped_backward_through_the_inverse_map(smooth_volume, field_in):
    """A linear ramp is interpolated exactly, so each voxel must read the ramp at its inverse position."""
    field = field_in(smooth_volume)
    warped = ImageWarp.of(field).apply(smooth_volume)
    inner = np.zeros(smooth_volume.voxels.shape, bool)
    inner[5:-5, 5:-5, 5:-5] = True
    source = field.inverse(smooth_volume.lattice.points)
    expected = (smooth_volume.index(source) @ [1.0, 2.0, -1.0]).reshape(smooth_volume.voxels.shape)
    moved = np.abs(expected - smooth_volume.voxels)[inner].max()
    error = np.abs(expected - warped.voxels)[inner].max()
    # what is left is the linear interpolation of the inverse between the nodes of its grid
    assert moved > 1.0
    assert error < 0.15 * moved


def test_the_written_transform_warps_as_resample_does(smooth_volume, field_in, tmp_path):
    warp = ImageWarp.of(field_in(smooth_volume))
    warp.save(tmp_path / "displacement.h5")
    image = to_sitk(smooth_volume)
    resampled = sitk.Resample(image, image, sitk.ReadTransform(str(tmp_path / "displacement.h5")), sitk.sitkLinear)
    ours = warp.apply(smooth_volume).voxels[3:-3, 3:-3, 3:-3]
    assert np.abs(sitk.GetArrayFromImage(resampled).transpose(2, 1, 0)[3:-3, 3:-3, 3:-3] - ours).max() < 1e-4


def test_a_vti_file_holds_the_vectors_where_the_nodes_are(tmp_path):
    vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="needs the extra 'io'")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    grid = ss.Grid(shape=(4, 5, 6), spacing=(1.0, 2.0, 3.0), origin=(1.0, 2.0, 3.0), direction=TILT)
    vectors = np.random.default_rng(0).standard_normal((*grid.shape, 3))
    write_vti(tmp_path / "f.vti", grid, {"displacement": vectors, "det": vectors[..., 0]})
    reader = vtk_xml.vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "f.vti"))
    reader.Update()
    image = reader.GetOutput()
    read = vtk_to_numpy(image.GetPointData().GetArray("displacement"))
    scalars = vtk_to_numpy(image.GetPointData().GetArray("det"))
    for index in ((0, 0, 0), (3, 0, 5), (1, 4, 2)):
        point = image.ComputePointId(index)
        assert np.allclose(image.GetPoint(point), RAS_TO_LPS @ grid.node([index])[0])
        assert np.allclose(read[point], RAS_TO_LPS @ vectors[index])
        assert scalars[point] == vectors[index][0]


def test_a_vti_file_lies_over_the_image_it_belongs_to_and_says_its_frame(tilted_volume, tmp_path):
    """ParaView shows a file as it is stored: grid and image must be stored in one frame."""
    vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="needs the extra 'io'")
    write_vti(tmp_path / "f.vti", tilted_volume.lattice, {"values": tilted_volume.voxels.astype(float)})
    write_volume(tilted_volume, tmp_path / "v.nrrd")
    reader = vtk_xml.vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "f.vti"))
    reader.Update()
    grid, image = reader.GetOutput(), sitk.ReadImage(str(tmp_path / "v.nrrd"))
    assert grid.GetFieldData().GetAbstractArray("SPACE").GetValue(0) == "LPS"
    for index in ((0, 0, 0), (23, 0, 17), (11, 19, 4)):
        point = grid.ComputePointId(index)
        assert np.allclose(grid.GetPoint(point), image.TransformIndexToPhysicalPoint(index))
        assert grid.GetPointData().GetArray("values").GetValue(point) == image[index]


@pytest.mark.parametrize("suffix", [".nrrd", ".mha", ".mhd", ".nii.gz", ".nii"])
@pytest.mark.parametrize("compress", [True, False])
def test_a_truncated_file_is_refused(tilted_volume, tmp_path, suffix, compress):
    path = tmp_path / f"v{suffix}"
    sitk.WriteImage(to_sitk(tilted_volume), str(path), useCompression=compress)
    data = path if suffix != ".mhd" else path.with_suffix(".zraw" if compress else ".raw")
    data.write_bytes(data.read_bytes()[: data.stat().st_size * 6 // 10])
    with pytest.raises(ValueError, match=r"volume = .*cannot be read"):
        read_volume(path)


def test_unfit_images_are_refused_by_name(tmp_path):
    cases = {
        "flat.nrrd": (sitk.Image([8, 8], sitk.sitkUInt8), "3-D"),
        "thin.nrrd": (sitk.Image([8, 8, 1], sitk.sitkUInt8), "3-D"),
        "film.nrrd": (sitk.Image([8, 8, 8, 2], sitk.sitkUInt8), "3-D"),
        "colour.nrrd": (sitk.Image([8, 8, 8], sitk.sitkVectorUInt8, 3), "grey"),
    }
    for name, (image, remedy) in cases.items():
        sitk.WriteImage(image, str(tmp_path / name))
        with pytest.raises(ValueError, match=f"volume = .*{name}.*{remedy}"):
            read_volume(tmp_path / name)
    for name in ("empty.nrrd", "empty.mha", "empty.nii.gz"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(ValueError, match=f"{name}.*cannot be read"):
            read_volume(tmp_path / name)
    with pytest.raises(ValueError, match="unknown file type"):
        read_volume(tmp_path / "x.jpg")
    with pytest.raises(ValueError, match="does not exist"):
        read_volume(tmp_path / "nowhere.mha")
