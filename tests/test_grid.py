"""The lattice: where nodes are, which faces they lie on, what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonospline as ss
from sonospline.geometry.grid import face_slice


def test_unit_cube_has_the_papers_size():
    grid = ss.Grid.unit_cube(25)
    assert (grid.shape, grid.node_count, grid.side) == ((25, 25, 25), 15_625, 1.0)
    assert grid.spacing == (1 / 24, 1 / 24, 1 / 24)
    assert ss.Grid.unit_cube(48).node_count == 110_592
    assert ss.Grid.unit_cube(53).node_count == 148_877


def test_nodes_run_z_fastest():
    points = ss.Grid(shape=(2, 3, 4), spacing=(1, 10, 100), origin=(5, 6, 7)).points
    assert points.shape == (24, 3)
    assert points[[0, 1, 4, 12]].tolist() == [[5, 6, 7], [5, 6, 107], [5, 16, 7], [6, 6, 7]]


def test_columns_of_the_direction_are_the_lattice_axes():
    """A quarter turn about z: the first lattice axis points along world y."""
    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    grid = ss.Grid(shape=(3, 3, 3), spacing=2, origin=(1, 1, 1), direction=turned)
    np.testing.assert_allclose(grid.node([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), [[1, 3, 1], [-1, 1, 1], [1, 1, 3]])
    np.testing.assert_allclose(grid.local([[1, 3, 1]]), [[2, 0, 0]])


def test_extent_and_side_of_a_box(a_tilted_grid):
    np.testing.assert_allclose(a_tilted_grid.extent, [12, 12, 9])
    assert a_tilted_grid.side == pytest.approx(9)
    assert a_tilted_grid.node_count == 9 * 7 * 11


def test_node_of_an_index_is_the_point_in_the_list(a_tilted_grid):
    index = np.array([[0, 0, 0], [8, 6, 10], [3, 5, 2]])
    flat = np.ravel_multi_index(tuple(index.T), a_tilted_grid.shape)
    np.testing.assert_allclose(a_tilted_grid.node(index), a_tilted_grid.points[flat], atol=1e-12)


@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), origin=st.tuples(*[st.floats(-1e3, 1e3)] * 3))
def test_local_undoes_world_and_distances_stay(angles, origin):
    grid = ss.Grid(
        shape=(3, 4, 5), spacing=(1, 2, 3), origin=origin, direction=Rotation.from_rotvec(angles).as_matrix()
    )
    places = np.random.default_rng(3).uniform(-5, 15, (20, 3))
    world = grid.world(places)
    np.testing.assert_allclose(grid.local(world), places, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        np.linalg.norm(world[1:] - world[:-1], axis=1), np.linalg.norm(places[1:] - places[:-1], axis=1), rtol=1e-9
    )


@pytest.mark.parametrize(
    ("local", "inside"),
    [((0, 0, 0), True), ((12, 12, 9), True), ((6, 6, 4), True), ((-1e-6, 6, 4), False), ((6, 6, 9.001), False)],
)
def test_contains_is_the_closed_box(a_tilted_grid, local, inside):
    assert a_tilted_grid.contains(a_tilted_grid.world([local])).tolist() == [inside]


def test_contains_takes_many_points_and_a_tolerance():
    grid = ss.Grid.unit_cube(3)
    outside = [[1.01, 0.5, 0.5], [0.5, -0.2, 0.5]]
    assert grid.contains(outside).tolist() == [False, False]
    assert grid.contains(outside, tolerance=0.1).tolist() == [True, False]


FACE_POINTS = {
    "x-": (0.5, 6, 4),
    "x+": (11.5, 6, 4),
    "y-": (6, 0.5, 4),
    "y+": (6, 11.5, 4),
    "z-": (6, 6, 0.5),
    "z+": (6, 6, 8.5),
}


@pytest.mark.parametrize(("face", "local"), FACE_POINTS.items())
def test_nearest_face_follows_the_lattice_not_the_world(a_tilted_grid, face, local):
    assert a_tilted_grid.nearest_face(a_tilted_grid.world([local])[0]) == face


@pytest.mark.parametrize("face", ss.FACES)
def test_face_slice_and_mask_select_the_same_nodes(a_tilted_grid, face):
    axis, end = "xyz".index(face[0]), {"-": 0.0, "+": 1.0}[face[1]]
    mask = a_tilted_grid.on_faces((face,))
    local = a_tilted_grid.local(a_tilted_grid.points).reshape(*a_tilted_grid.shape, 3)
    wanted = end * a_tilted_grid.extent[axis]
    np.testing.assert_allclose(local[mask][:, axis], wanted, atol=1e-12)
    np.testing.assert_allclose(local[face_slice(face)][..., axis], wanted, atol=1e-12)
    assert mask.sum() == a_tilted_grid.node_count // a_tilted_grid.shape[axis]


def test_mask_of_all_faces_leaves_the_interior(a_tilted_grid):
    assert (~a_tilted_grid.on_faces(ss.FACES)).sum() == 7 * 5 * 9
    assert not a_tilted_grid.on_faces(()).any()


@pytest.mark.parametrize("extent", [(100, 100, 100), (100, 50, 25), (180, 240, 90), (1, 2, 3)])
@pytest.mark.parametrize("nodes", [5_000, 150_000])
def test_covering_fills_the_box_with_nearly_cubic_cells(extent, nodes):
    grid = ss.Grid.covering(extent, nodes=nodes, origin=(1, 2, 3))
    np.testing.assert_allclose(grid.extent, extent, rtol=1e-12)
    assert grid.origin.tolist() == [1, 2, 3]
    assert abs(grid.node_count / nodes - 1) < 0.1
    assert max(grid.spacing) / min(grid.spacing) < 1.1


def test_covering_a_cube_is_the_papers_grid():
    assert ss.Grid.covering((100, 100, 100)).shape == (53, 53, 53)


def test_covering_keeps_two_nodes_along_a_thin_side():
    assert ss.Grid.covering((100, 100, 0.1), nodes=1000).shape[2] == 2


BAD_GRIDS = {
    "two sizes": ({"shape": (3, 3), "spacing": 1}, r"shape = \(3, 3\) is not three whole numbers; give nodes along"),
    "size one": ({"shape": (3, 1, 3), "spacing": 1}, r"shape = 1 is too small; give at least 2"),
    "broken size": ({"shape": (3, 3.5, 3), "spacing": 1}, r"shape = 3.5 is not a whole number; give an int"),
    "zero spacing": ({"shape": (3, 3, 3), "spacing": (1, 0, 1)}, r"spacing = 0 .* finite number above zero"),
    "negative spacing": ({"shape": (3, 3, 3), "spacing": -2}, r"spacing = -2 .* finite number above zero"),
    "NaN spacing": ({"shape": (3, 3, 3), "spacing": np.nan}, r"spacing = .*nan.* finite number above zero"),
    "short origin": ({"shape": (3, 3, 3), "spacing": 1, "origin": (0, 0)}, r"origin = \(0, 0\) has shape .*give"),
    "NaN origin": ({"shape": (3, 3, 3), "spacing": 1, "origin": (0, np.nan, 0)}, r"origin contains NaN.*give"),
    "sheared": (
        {"shape": (3, 3, 3), "spacing": 1, "direction": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]},
        r"direction = .*0.1.* is not orthonormal; give unit axes",
    ),
    "scaled": ({"shape": (3, 3, 3), "spacing": 1, "direction": 2 * np.eye(3)}, r"direction = .*not orthonormal"),
    "small direction": ({"shape": (3, 3, 3), "spacing": 1, "direction": np.eye(2)}, r"direction = .*orthonormal"),
    "NaN direction": (
        {"shape": (3, 3, 3), "spacing": 1, "direction": np.full((3, 3), np.nan)},
        r"direction = .*nan.*not orthonormal",
    ),
}


@pytest.mark.parametrize(("arguments", "message"), BAD_GRIDS.values(), ids=BAD_GRIDS.keys())
def test_bad_grid_is_refused_with_name_value_and_remedy(arguments, message):
    with pytest.raises(ValueError, match=message):
        ss.Grid(**arguments)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("shape", 5),
        ("spacing", (1, 2)),
        ("spacing", "wide"),
        ("direction", "north"),
        ("direction", [[1, 0], [0, 1, 0], [0, 0, 1]]),
    ],
    ids=str,
)
def test_argument_of_a_wrong_kind_is_named(name, value):
    arguments = {"shape": (3, 3, 3), "spacing": 1.0, name: value}
    with pytest.raises(ValueError, match=f"{name} = "):
        ss.Grid(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"extent": (1, 0, 1)}, r"extent = \[1.0, 0.0, 1.0\] is not above zero"),
        ({"extent": (1, 1)}, r"extent = \(1, 1\) has shape"),
        ({"extent": (1, 1, 1), "nodes": 7}, r"nodes = 7 is too small; give at least 8"),
    ],
)
def test_bad_covering_is_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        ss.Grid.covering(**arguments)


@pytest.mark.parametrize("nodes", [1, 0, -3, True, 2.0])
def test_bad_cube_is_refused_by_name(nodes):
    with pytest.raises(ValueError, match=f"nodes = {nodes}"):
        ss.Grid.unit_cube(nodes)


def test_unknown_face_is_refused_with_the_choices():
    with pytest.raises(ValueError, match=r"face = 'top' is not known; choose one of x-, x\+, y-"):
        ss.Grid.unit_cube(3).on_faces(("top",))


def test_rounding_of_an_image_header_is_cleared_from_the_direction(a_rotation):
    grid = ss.Grid(shape=(3, 3, 3), spacing=1, direction=np.round(a_rotation, 5))
    np.testing.assert_allclose(grid.direction.T @ grid.direction, np.eye(3), rtol=0, atol=1e-15)
    np.testing.assert_allclose(grid.direction, a_rotation, rtol=0, atol=1e-5)


def test_grid_is_frozen():
    with pytest.raises(AttributeError):
        ss.Grid.unit_cube(3).shape = (4, 4, 4)


def test_grid_survives_reuse_of_the_callers_array():
    origin = np.zeros(3)
    grid = ss.Grid(shape=(2, 2, 2), spacing=1, origin=origin)
    origin += 5
    assert grid.node([[0, 0, 0]]).tolist() == [[0, 0, 0]]
