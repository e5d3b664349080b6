"""A field drawn, and handed to SimpleITK, PyVista and files."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry import facing
from sonospline.io.volumes import RAS_TO_LPS

NEEDLE = ss.Needle((12, 22, 31), (24, 26, 33))
TILT = facing((0, 0, 0), depth=(0.1, 1, 0.2), right=(1, 0.2, 0.1))[:3, :3]


def field_on(direction):
    grid = ss.Grid(shape=(11, 9, 10), spacing=(2, 3, 2.5), origin=(10, 14, 20), direction=direction)
    needle = ss.Needle(grid.world((0, 12, 11)), grid.world((11, 13, 12)))
    return ss.Insertion(ss.Tissue(grid), ss.NeedleTissueModel.paper(20.0)).advance(needle), needle


@pytest.fixture(params=[np.eye(3), TILT], ids=["upright", "tilted"])
def a_field(request):
    return field_on(request.param)[0]


# --- pictures ---


@pytest.mark.parametrize("normal", [None, (0, 1, 0.3)])
def test_a_slice_contains_the_whole_needle(normal):
    pytest.importorskip("matplotlib", reason="needs the extra 'plot'")
    for direction in (np.eye(3), TILT):
        field, needle = field_on(direction)
        axes = field.plot(through=needle, normal=normal, colour_bar=False)
        shaft = np.array(axes.lines[0].get_xydata())
        assert np.linalg.norm(shaft[1] - shaft[0]) == pytest.approx(needle.depth)  # nothing of it is out of plane
        assert shaft[1][1] == pytest.approx(shaft[0][1])  # along the picture's x
        assert axes.get_xlabel() == "mm"
        assert len(axes.images) == 1
        assert np.nanmax(axes.images[0].get_array()) > 0.3 * np.linalg.norm(field.on_grid(), axis=-1).max()


def test_a_field_is_drawn_where_it_is_asked_to_be():
    pytest.importorskip("matplotlib", reason="needs the extra 'plot'")
    from matplotlib.figure import Figure

    field, needle = field_on(np.eye(3))
    ax = Figure().add_subplot()
    assert field.plot(ax, through=needle, arrows=0) is ax
    by_itself = field.plot()  # through the place that moves most
    shown = by_itself.images[0].get_array()
    assert np.nanmax(shown) > 0.5 * np.linalg.norm(field.on_grid(), axis=-1).max()
    with pytest.raises(ValueError, match=r"normal = .* is zero or along the needle"):
        field.plot(through=needle, normal=needle.direction)
    with pytest.raises(ValueError, match="through"):
        field.plot(through=(1, 2))


# --- SimpleITK ---


def test_the_transform_is_the_inverse_and_the_image_the_displacement(a_field):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    transform, image = a_field.to_sitk(), a_field.to_sitk_image()
    assert isinstance(transform, sitk.DisplacementFieldTransform)
    u = a_field.on_grid()
    index = tuple(int(n) for n in np.unravel_index(np.linalg.norm(u, axis=-1).argmax(), u.shape[:3]))
    node = a_field.grid.node(index)
    lps = (RAS_TO_LPS @ node).tolist()
    assert np.allclose(image.TransformIndexToPhysicalPoint(index), lps)
    assert np.allclose(image[index], RAS_TO_LPS @ u[index], atol=1e-6)
    assert np.allclose(RAS_TO_LPS @ transform.TransformPoint(lps), a_field.inverse(node), atol=1e-6)
    assert np.linalg.norm(np.subtract(transform.TransformPoint(lps), lps)) > 0.1


def test_an_image_is_warped_forward_by_the_transform(a_field):
    """A bright spot at a node must be found where the forward map takes the node."""
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    grid = ss.Grid.covering(
        a_field.grid.extent, nodes=60_000, origin=a_field.grid.origin, direction=a_field.grid.direction
    )
    u = a_field.on_grid()
    at = a_field.grid.node(np.unravel_index(np.linalg.norm(u, axis=-1).argmax(), u.shape[:3]))
    spot = np.exp(-0.5 * np.sum((grid.points - at) ** 2, axis=1) / 1.5**2).reshape(grid.shape)
    from sonospline.io.volumes import place

    image = sitk.GetImageFromArray(spot.transpose(2, 1, 0))
    place(image, grid)
    warped = sitk.GetArrayFromImage(sitk.Resample(image, a_field.to_sitk())).transpose(2, 1, 0)
    middle = (grid.points * warped.reshape(-1, 1)).sum(axis=0) / warped.sum()
    still = (grid.points * spot.reshape(-1, 1)).sum(axis=0) / spot.sum()
    wanted = (a_field.displacement(grid.points) * spot.reshape(-1, 1)).sum(axis=0) / spot.sum()
    assert (middle - still) @ wanted / (wanted @ wanted) == pytest.approx(1, abs=0.2)
    assert np.linalg.norm(wanted) > 0.2


# --- PyVista ---


def test_the_mesh_has_the_nodes_where_they_are_and_what_happens_there(a_field):
    pyvista = pytest.importorskip("pyvista", reason="needs the extra 'view'")
    mesh = a_field.to_pyvista()
    upright = a_field.grid.upright
    assert isinstance(mesh, pyvista.ImageData if upright else pyvista.StructuredGrid)
    for index in ((0, 0, 0), (10, 0, 9), (3, 7, 2)):
        point = mesh.find_closest_point(a_field.grid.node(index))
        assert np.allclose(mesh.points[point], a_field.grid.node(index), atol=1e-5)
        assert np.allclose(mesh["displacement"][point], a_field.on_grid()[index], atol=1e-6)
        assert mesh["det J"][point] == pytest.approx(np.linalg.det(a_field.jacobian(a_field.grid.node(index))))
    moved = mesh.warp_by_vector("displacement")
    assert moved.n_points == a_field.grid.node_count


# --- files ---


@pytest.mark.parametrize("name", ["u.h5", "u.tfm"])
def test_a_saved_transform_warps_as_the_field_does(a_field, name, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    pytest.importorskip("h5py", reason="needs the extra 'io'")
    a_field.save(tmp_path / name)
    read = sitk.ReadTransform(str(tmp_path / name))
    for point in a_field.grid.points[::97]:
        lps = (RAS_TO_LPS @ point).tolist()
        assert np.allclose(read.TransformPoint(lps), a_field.to_sitk().TransformPoint(lps), atol=1e-9)


@pytest.mark.parametrize("name", ["u.nrrd", "u.mha"])
def test_a_saved_image_holds_the_forward_displacement(a_field, name, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    a_field.save(tmp_path / name)
    image = sitk.ReadImage(str(tmp_path / name))
    for index in ((0, 0, 0), (5, 4, 5), (10, 8, 9)):
        assert np.allclose(image.TransformIndexToPhysicalPoint(index), RAS_TO_LPS @ a_field.grid.node(index))
        assert np.allclose(image[index], RAS_TO_LPS @ a_field.on_grid()[index], atol=1e-6)


def test_saved_arrays_make_the_field_again(a_field, tmp_path):
    a_field.save(str(tmp_path / "u.npz"))
    with np.load(tmp_path / "u.npz") as kept:
        grid = ss.Grid(
            shape=kept["displacement"].shape[:3],
            spacing=kept["spacing"], origin=kept["origin"], direction=kept["direction"],
        )  # fmt: skip
        again = ss.GridField(grid, kept["displacement"])
    points = a_field.grid.world(np.random.default_rng(0).random((20, 3)) * a_field.grid.extent)
    assert np.allclose(again.displacement(points), ss.GridField.of(a_field).displacement(points), atol=1e-6)


def test_an_unknown_suffix_is_refused_and_nothing_written(a_field, tmp_path):
    for name in ("u", "u.nii.gz", "U.TFM"):  # ITK reads no transform by an upper-case suffix
        with pytest.raises(ValueError, match=r"unknown file type; use one of \.h5, \.tfm, .*\.npz"):
            a_field.save(tmp_path / name)
    with pytest.raises(OSError, match="could not be written whole"):
        a_field.save(tmp_path / "none" / "u.npz")
    assert not list(tmp_path.iterdir())


def test_a_field_without_a_grid_says_so(a_field):
    from dataclasses import replace

    loose = replace(a_field, grid=None)
    for ask in (loose.plot, loose.to_sitk, loose.to_sitk_image, loose.to_pyvista, lambda: loose.save("u.npz")):
        with pytest.raises(ValueError, match=r"grid = None"):
            ask()
