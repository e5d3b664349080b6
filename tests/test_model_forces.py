"""Forces on needles: in newtons, of each needle, and balanced by what the pinned faces hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonospline as ss
from sonospline import models
from sonospline.mechanics import LineForce, Material, ShaftDisplacement, TissueForce, TissueMap, labelled_cube
from sonospline.mechanics.nodal_load import nodal_load
from sonospline.models.elastic import ElasticModel
from sonospline.simulator import SceneFile, make_scene
from sonospline.simulator.scene_model import scene_model

SIDE = 100.0
GRIDS = {
    "upright": ss.Grid(shape=(13,) * 3, spacing=SIDE / 12),
    "tilted": ss.Grid(
        shape=(13, 11, 12),
        spacing=(SIDE / 12, SIDE / 10, SIDE / 11),
        origin=(-30, 12, 7),
        direction=Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix(),
    ),
}
POSES = [  # entry and tip, in sides of the box from node 0
    ((0.0, 0.5, 0.5), (0.6, 0.5, 0.5)),
    ((0.0, 0.3, 0.45), (0.7, 0.6, 0.5)),
    ((0.0, 0.12, 0.5), (0.2, 0.1, 0.55)),
]


def labelled(grid):
    """The generated body, with bone and fluid, lying as the grid does."""
    tissues = labelled_cube("body", side=SIDE, stiffness_kpa=10, voxels=24)
    voxels = tissues.labels
    turned = ss.geometry.Volume(
        voxels=voxels.voxels,
        spacing=voxels.spacing,
        origin=grid.world(np.array(voxels.origin)),
        direction=grid.direction,
    )
    return TissueMap(turned, tissues.materials)


def needle(grid, pose):
    return ss.Needle(*(grid.world(np.multiply(point, grid.extent)) for point in pose))


@pytest.mark.parametrize("where", GRIDS)
@pytest.mark.parametrize("what", ["homogeneous", "labelled"])
@pytest.mark.parametrize("pose", POSES)
def test_the_pinned_faces_hold_what_the_needle_pushes(where, what, pose):
    grid = GRIDS[where]
    tissue = ss.Tissue(grid)
    made_of = Material(10.0) if what == "homogeneous" else labelled(grid)
    model = models.make("elastic", tissue, made_of, solver_nodes=11**3)
    pushed = model.step(model.rest, {"needle": needle(grid, pose)})
    assert not pushed.settled
    at_rest = model.settle(pushed, tolerance=2e-5)
    force = at_rest.forces["needle"]
    held = model.solver.reaction(at_rest.state.solution) / 1000.0
    assert np.linalg.norm(force.force_n + held) < 1e-3 * np.linalg.norm(force.force_n)
    assert force.axial_n == pytest.approx(np.linalg.norm(force.force_n), rel=1e-4)  # these loads act along the shaft


def test_two_needles_push_as_much_as_each_alone_and_the_faces_hold_both():
    grid = GRIDS["tilted"]
    model = models.make("elastic", ss.Tissue(grid), labelled(grid), solver_nodes=11**3)
    needles = {"left": needle(grid, POSES[0]), "right": needle(grid, POSES[1])}
    both = model.settle(model.step(model.rest, needles), tolerance=2e-5)
    alone = {name: model.step(model.rest, {name: one}).forces[name] for name, one in needles.items()}
    for name, force in both.forces.items():
        np.testing.assert_allclose(
            force.force_n, alone[name].force_n, rtol=1e-3
        )  # each moves the tissue the other is in
    pushed = sum(force.force_n for force in both.forces.values())
    held = model.solver.reaction(both.state.solution) / 1000.0
    assert np.linalg.norm(pushed + held) < 1e-3 * np.linalg.norm(pushed)


def test_displacements_of_two_needles_add_up():
    grid = GRIDS["upright"]
    model = models.make("elastic", ss.Tissue(grid), Material(10.0), solver_nodes=11**3, load_at="undeformed")
    needles = {"left": needle(grid, POSES[0]), "right": needle(grid, POSES[1])}
    asked = (needles, *({name: one} for name, one in needles.items()))
    both, left, right = (
        model.settle(model.step(model.rest, which), tolerance=1e-5).state.solution.displacement for which in asked
    )
    assert np.abs(both - left - right).max() < 1e-4 * np.abs(both).max()


def test_the_width_of_a_load_is_the_needle_s_and_the_tissue_s_not_the_box_s():
    boxes = [ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=side / 8)) for side in (60.0, 100.0, 200.0)]
    widths = {models.make("elastic", box, Material(10.0)).load.width for box in boxes[:2]}
    assert widths == {0.635 + 3.0}
    coarse = models.make("elastic", boxes[2], Material(10.0))
    assert coarse.force.width == 3.635 and coarse.load.width == 0.8 * max(coarse.solver.grid.spacing)
    thick = models.make("elastic", boxes[0], Material(10.0), needle_radius_mm=1.0, process_zone_mm=2.0)
    assert thick.force.width == 3.0
    labelled_too = models.make("elastic", boxes[0], labelled_cube("layers", side=60), needle_radius_mm=1.0)
    assert labelled_too.load.width == 4.0


def test_a_scene_s_needle_is_as_thick_as_it_looks():
    text = 'name = "block"\n[tissue]\nsource = "cube"\nnodes = 2000\n[needle]\nlook = "echogenic-2mm"\n'
    assert scene_model(make_scene(SceneFile.parse(text)), "elastic").load.width == 4.0
    given = SceneFile.parse(text + "[model]\nneedle_radius_mm = 0.4\nprocess_zone_mm = 2\n")
    assert scene_model(make_scene(given), "elastic").force.width == 2.4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"needle_radius_mm": 0.0}, "needle_radius_mm = 0 is out of range; give a number from 0.05 to 10 mm"),
        ({"process_zone_mm": -1.0}, "process_zone_mm = -1 is out of range; give a number from 0 to 50 mm"),
    ],
)
def test_a_needle_without_thickness_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        models.make("elastic", ss.Tissue(GRIDS["upright"]), Material(10.0), **options)
    with pytest.raises(ValueError, match=r"needle_radius_mm = 0\.0 is out of range; give a finite number above zero"):
        ElasticModel(ss.Tissue(GRIDS["upright"]), Material(10.0), needle_radius_mm=0.0)


@pytest.mark.parametrize("where", GRIDS)
@pytest.mark.parametrize("face", ["x-", "z+"])
@pytest.mark.parametrize("width", [2.0, 5.0, 12.0])
def test_a_needle_from_the_free_face_pushes_with_the_whole_of_its_load(where, face, width):
    """What the Gaussian has ahead of the entry is brought back."""
    grid, load = GRIDS[where], LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=width)
    axis, end = divmod(ss.FACES.index(face), 2)
    entry, tip = np.full(3, 0.5), np.full(3, 0.5)
    entry[axis], tip[axis] = end, 0.45
    model = ElasticModel(ss.Tissue(grid, entry_face=face), Material(10.0), load, nodes=13**3)
    pushed = needle(grid, (entry, tip))
    force = model.step(model.rest, {"needle": pushed}).forces["needle"]
    beside = 1e-5 if width < 10 else 1e-3  # of twelve mm beside walls at fifty
    assert force.axial_n == pytest.approx(load.total_force(pushed) / 1000, rel=beside)


@pytest.mark.parametrize("where", GRIDS)
@pytest.mark.parametrize(("beside", "share"), [(0.0, 0.5), (0.03, 0.0505), (0.2, 0.0)])
def test_what_lies_beyond_a_pinned_wall_is_lost(where, beside, share):
    """Of a needle along a wall, half a Gaussian where it is on it."""
    grid = GRIDS[where]
    load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=0.03 / 1.64 * SIDE)
    along = needle(grid, ((0.2, beside, 0.5), (0.6, beside, 0.5)))
    forces, whole = nodal_load(load, along, ss.Tissue(grid))
    kept = along.direction @ grid.direction @ forces.reshape(3, -1).sum(axis=1, dtype=float)
    assert whole == pytest.approx(load.total_force(along))
    assert whole - kept == pytest.approx(share * whole, rel=2e-3, abs=1e-6 * whole)


@pytest.mark.parametrize("where", GRIDS)
@pytest.mark.parametrize("beside", [0.02, 0.1, 0.4])
def test_the_force_and_what_is_lost_to_walls_and_bone_are_the_whole_load(where, beside):
    grid = GRIDS[where]
    model = models.make("elastic", ss.Tissue(grid), labelled(grid), solver_nodes=13**3)
    along = needle(grid, ((0.0, beside, 0.5), (0.6, beside, 0.5)))
    at_rest = model.settle(model.step(model.rest, {"needle": along}), tolerance=2e-5)
    force, solution = at_rest.forces["needle"], at_rest.state.solution
    assert force.lost_n > (0.1 if beside == 0.02 else -1e-6)
    assert force.axial_n + force.lost_n == pytest.approx(model.load.total_force(along) / 1000, rel=0.02)
    held = model.solver.reaction(solution) / 1000
    assert np.linalg.norm(force.force_n + held) < 1e-3 * np.linalg.norm(force.force_n)


@pytest.mark.parametrize(
    ("load", "total"),
    [
        (LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5), 0.03 * 60 + 0.7),
        (TissueForce(labelled_cube("layers", side=SIDE), width=5.0), 0.03 * 60 + 0.7),
    ],
)
def test_the_total_of_a_load_is_the_integral_of_its_body_force(load, total):
    pushed, h = ss.Needle((20, 50, 50), (80, 50, 50)), 2.0
    assert load.total_force(pushed) == pytest.approx(1000 * total)
    points = np.stack(np.meshgrid(*[np.arange(-20, 121, h)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    assert h**3 * load.body_force(points, pushed).sum(axis=0) == pytest.approx([1000 * total, 0, 0], rel=1e-3)


def test_a_load_of_displacements_states_no_force():
    with pytest.raises(ValueError, match="states no force; solve for it, or give a LineForce"):
        ShaftDisplacement().total_force(ss.Needle((0, 0.5, 0.5), (0.5, 0.5, 0.5)))
    assert not isinstance(TissueForce(labelled_cube("layers")), LineForce)
