"""Poses, planes, probes, and slices of a field."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.fields import NodeSlice, PlaneSlice
from sonospline.geometry import ImagePlane, facing, rigid, to_image, to_reference
from sonospline.ultrasound import Phantom, Probe, Scanner

POSE = facing((10, 20, 30), depth=(0.2, 0.1, 1), right=(1, 0.3, 0))


def test_a_pose_is_rigid_and_right_handed():
    assert np.allclose(POSE[:3, :3].T @ POSE[:3, :3], np.eye(3))
    assert np.linalg.det(POSE[:3, :3]) == pytest.approx(1)
    points = np.random.default_rng(0).normal(0, 50, (20, 3))
    assert np.allclose(to_image(POSE, to_reference(POSE, points)), points)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.zeros((4, 4)), "not rigid"),
        (np.diag([1, 1, 1.2, 1]), "not rigid"),
        (np.diag([-1, 1, 1, 1]), "right-handed"),
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "NaN"),
        ("a", "not numeric"),
    ],
)
def test_a_pose_that_is_none_is_refused(matrix, message):
    with pytest.raises(ValueError, match=message):
        rigid("image_to_reference", matrix)


def test_directions_without_a_plane_are_refused():
    with pytest.raises(ValueError, match="no direction"):
        facing((0, 0, 0), depth=(0, 0, 0), right=(1, 0, 0))
    with pytest.raises(ValueError, match="parallel"):
        facing((0, 0, 0), depth=(0, 0, 1), right=(0, 0, 2))


def test_pixels_lie_where_the_plane_says():
    plane = ImagePlane(image_to_reference=POSE, shape=(30, 20), spacing_mm=(0.5, 0.25), corner_mm=(-5, 1))
    assert np.allclose(plane.points[0], POSE[:3, 3])  # ImageToReference is of pixel (0, 0)
    flat = plane.project(plane.points)
    assert np.allclose(flat[:, 2], 0, atol=1e-12)
    assert np.allclose(flat[[0, 1, 20]], [[-5, 1, 0], [-4.5, 1, 0], [-5, 1.25, 0]])
    row, column = 7, 11
    assert np.allclose(plane.pixels(plane.points)[row * 20 + column], (column, row))
    assert np.allclose(plane.affine @ [column, row, 1], plane.points[row * 20 + column])


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.1, 0.2, 1), (1, -2, 0.5)])
@pytest.mark.parametrize("right", [None, (1, 0.3, 0.2)])
def test_a_crossing_plane_is_seen_along_its_normal(normal, right):
    plane = ImagePlane.crossing(ss.Grid.unit_cube(5), normal=normal, through=(0.5, 0.4, 0.3), right=right)
    assert np.allclose(np.cross(plane.image_to_reference[:3, 2], normal), 0, atol=1e-12)
    assert plane.project([(0.5, 0.4, 0.3)])[0] == pytest.approx([0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("probe", [Probe.linear(lines=32), Probe.curvilinear(lines=32)], ids=lambda p: p.kind)
def test_the_image_and_the_probe_have_poses_of_their_own(probe):
    scanner = Scanner(Phantom.uniform("liver", size_mm=(60, 60, 90)), probe, POSE)
    image = scanner.render().frame
    assert np.allclose(scanner.probe_to_reference, POSE, atol=1e-12)
    assert np.allclose(image.plane.image_to_reference[:3, 3], image.plane.points[0])
    assert np.allclose(image.plane.axes_to_reference, POSE)
    face = image.plane.project(POSE[:3, 3][None])[0]
    assert face == pytest.approx([0, 0, 0], abs=1e-9)
    pixel = (face[:2] - image.plane.corner_mm) / image.plane.spacing_mm
    assert pixel[0] == pytest.approx((image.plane.shape[1] - 1) / 2, abs=0.51)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"shape": (0, 5)}, "shape"), ({"shape": 5}, "two whole"), ({"spacing_mm": 0}, "spacing_mm"),
     ({"spacing_mm": (1, 2, 3)}, "one or two"), ({"image_to_reference": np.eye(4) * 2}, "not rigid")],
)  # fmt: skip
def test_a_plane_that_is_none_is_refused(change, message):
    settings = {"image_to_reference": np.eye(4), "shape": (5, 5), "spacing_mm": 1.0} | change
    with pytest.raises(ValueError, match=message):
        ImagePlane(**settings)


@pytest.mark.parametrize("probe", [Probe.linear(), Probe.curvilinear(), Probe.phased()], ids=lambda p: p.kind)
def test_beams_and_points_are_inverse(probe):
    beam = np.random.default_rng(0).uniform([1, 0, -5], [probe.depth_mm, probe.lines - 1, 5], (50, 3))
    assert np.allclose(probe.beam_coordinates(probe.image_points(beam)), beam)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"depth_mm": 0.0}, "depth_mm"), ({"frequency_mhz": -1.0}, "frequency_mhz"), ({"lines": 2}, "lines"),
     ({"samples": 1000}, "multiple of 16"), ({"bandwidth": 3.0}, "bandwidth"),
     ({"depth_mm": 400.0, "samples": 1024}, r"depth_mm = 400.0 over samples = 1024 is too coarse .* take more samples"),
     ({"frequency_mhz": 1.0, "depth_mm": 20.0, "samples": 1024}, r"samples = 1024 is too fine .* take fewer samples")],
)  # fmt: skip
def test_a_probe_that_is_none_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Probe.linear(**settings)


def test_the_papers_slice_is_the_nodes_of_a_layer(a_deformed_field):
    layer = NodeSlice.of(a_deformed_field, axis="z", at=0.5)
    grid = a_deformed_field.grid
    expected = a_deformed_field.on_grid()[:, :, 6].swapaxes(0, 1)
    assert np.allclose(layer.displacement @ layer.plane.image_to_reference[:3, :3].T, expected)
    assert np.allclose(layer.nodes[..., 2], 0)
    assert layer.nodes.shape == (grid.shape[1], grid.shape[0], 3)
    with pytest.raises(ValueError, match="outside the grid"):
        NodeSlice.of(a_deformed_field, axis="z", at=2.0)
    with pytest.raises(ValueError, match="axis"):
        NodeSlice.of(a_deformed_field, axis="w", at=0.5)


def test_the_continuous_slice_agrees_with_the_inverse_map(a_deformed_field):
    plane = ImagePlane.crossing(a_deformed_field.grid, normal=(0.2, 0.1, 1), through=(0.5, 0.5, 0.5), pixels=40)
    slice_ = PlaneSlice.of(a_deformed_field, plane)
    inside = a_deformed_field.grid.contains(plane.points)
    assert np.array_equal(np.isfinite(slice_.magnitude).ravel(), inside)
    points = plane.points[inside]
    sampled = ss.GridField.of(a_deformed_field)
    assert np.allclose(slice_.magnitude.ravel()[inside], np.linalg.norm(points - sampled.inverse(points), axis=1))


def test_grid_lines_move_with_the_tissue(a_deformed_field):
    plane = ImagePlane.crossing(a_deformed_field.grid, normal=(0, 0, 1), through=(0.5, 0.5, 0.5), pixels=40)
    lines = PlaneSlice.of(a_deformed_field, plane).grid_lines(0.1)
    still = ss.GridField(a_deformed_field.grid, np.zeros((*a_deformed_field.grid.shape, 3)))
    straight = PlaneSlice.of(still, plane).grid_lines(0.1)
    assert len(lines) == len(straight) >= 20
    assert max(np.ptp(line, axis=0).min() for line in straight) < 1e-9
    assert max(np.abs(a - b).max() for a, b in zip(lines, straight, strict=True)) > 0.005


def test_slices_draw_themselves(a_deformed_field, an_oblique_needle):
    pytest.importorskip("matplotlib", reason="needs the extra 'plot'")
    plane = ImagePlane.crossing(a_deformed_field.grid, normal=(0, 0, 1), through=(0.5, 0.5, 0.5), pixels=40)
    axes = PlaneSlice.of(a_deformed_field, plane).plot(needle=an_oblique_needle, lines_mm=0.2)
    assert PlaneSlice.of(a_deformed_field, plane).plot(axes, colour_bar=False) is axes
    assert NodeSlice.of(a_deformed_field, at=0.5).plot(needle=an_oblique_needle).get_xlabel() == "mm"
    axes.figure.canvas.draw()


@pytest.mark.slow
def test_slices_become_pyvista_surfaces(a_deformed_field):
    pytest.importorskip("pyvista", reason="needs the extra 'view'")
    plane = ImagePlane.crossing(a_deformed_field.grid, normal=(0, 0, 1), through=(0.5, 0.5, 0.5), pixels=40)
    slice_ = PlaneSlice.of(a_deformed_field, plane)
    surface = slice_.to_pyvista()
    assert np.allclose(np.sort(surface["magnitude"]), np.sort(slice_.magnitude.ravel()))
    at = surface.find_closest_point(plane.points[500])
    assert surface["magnitude"][at] == pytest.approx(slice_.magnitude.ravel()[500])
    layer = NodeSlice.of(a_deformed_field, at=0.5).to_pyvista()
    assert layer.n_points == 13 * 13
