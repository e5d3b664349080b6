"""Forces on needles: in newtons, of each needle, and balanced by what the pinned faces hold."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonospline as ss
from sonospline import models
from sonospline.mechanics import LineForce, Material, ShaftDisplacement, TissueForce, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticModel

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
    assert dict(both.forces) == alone
    pushed = sum(force.force_n for force in both.forces.values())
    held = model.solver.reaction(both.state.solution) / 1000.0
    assert np.linalg.norm(pushed + held) < 1e-3 * np.linalg.norm(pushed)


def test_displacements_of_two_needles_add_up():
    grid = GRIDS["upright"]
    model = models.make("elastic", ss.Tissue(grid), Material(10.0), solver_nodes=11**3)
    needles = {"left": needle(grid, POSES[0]), "right": needle(grid, POSES[1])}
    asked = (needles, *({name: one} for name, one in needles.items()))
    both, left, right = (
        model.settle(model.step(model.rest, which), tolerance=1e-5).state.solution.displacement for which in asked
    )
    assert np.abs(both - left - right).max() < 1e-4 * np.abs(both).max()


def test_the_force_is_the_total_of_the_load_but_for_what_lies_beyond_the_faces():
    """A needle from face to middle loses the half Gaussian ahead of its entry; one within the tissue nothing."""
    grid = ss.Grid(shape=(25,) * 3, spacing=SIDE / 24)
    load = LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5.0)
    model = ElasticModel(ss.Tissue(grid), Material(10.0), load, nodes=33**3)
    within, from_face = ss.Needle((30, 50, 50), (60, 50, 50)), ss.Needle((0, 50, 50), (60, 50, 50))
    for needle_, lost in ((within, 0.0), (from_face, load.friction * load.width / np.sqrt(2 * np.pi))):
        found = model.step(model.rest, {"needle": needle_}).forces["needle"].axial_n
        assert found == pytest.approx((load.total_force(needle_) - lost) / 1000, rel=2e-3)


@pytest.mark.parametrize(
    ("load", "total"),
    [
        (LineForce.physical(friction_n_per_mm=0.03, tip_force_n=0.7, width_mm=5), 0.03 * 60 + 0.7),
        (TissueForce(labelled_cube("layers", side=SIDE)), 0.03 * 60 + 0.7),
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
