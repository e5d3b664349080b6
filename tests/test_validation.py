"""Errors have their exact properties, insertions lie where they should, baselines and readings are what they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline.geometry.needle_plane import NeedlePlane
from sonospline.study import readings
from sonospline.study.insertions import PlannedInsertion, held_out_insertions, tuning_insertions
from sonospline.study.metrics import displacement_errors, mean_errors
from sonospline.study.objective import errors_at_target
from sonospline.study.reference import Reference, errors_along
from sonospline.study.thin_plate import ThinPlate, plane_errors

ALL = (*tuning_insertions(), *held_out_insertions())
PAPER = ss.NeedleTissueModel.paper()


@pytest.fixture
def a_reference(unit_tissue, an_analytic_history):
    return Reference.solve(ALL[1], unit_tissue, steps=2, history=an_analytic_history)


@pytest.fixture
def some_fields(rng):
    """Two displacements of 100 nodes, the second one zero at the first ten."""
    ours, theirs = 0.01 * rng.standard_normal((2, 100, 3))
    theirs[:10] = 0
    return ours, theirs


def test_a_model_without_error_has_none(some_fields):
    errors = displacement_errors(some_fields[1], some_fields[1])
    assert (errors.mae, errors.rmse, errors.relative, errors.largest) == (0, 0, 0, 0)
    assert errors.nodes == 90


def test_doing_nothing_scores_the_baseline_exactly(some_fields):
    errors = displacement_errors(np.zeros((100, 3)), some_fields[1])
    assert errors.relative == 1
    assert errors.mae == errors.zero_mae
    assert errors.rmse == errors.zero_rmse


def test_a_constant_offset_is_the_error_everywhere(some_fields):
    errors = displacement_errors(some_fields[1] + [0.03, 0, 0.04], some_fields[1])
    assert [errors.mae, errors.rmse, errors.largest] == pytest.approx([0.05] * 3)


def test_errors_are_those_of_the_equations(some_fields):
    ours, theirs = some_fields
    each = np.linalg.norm(ours - theirs, axis=1)[10:]
    errors = displacement_errors(ours, theirs)
    assert errors.mae == pytest.approx(each.sum() / 90)
    assert errors.rmse == pytest.approx(np.sqrt((each**2).sum() / 90))
    assert errors.largest == each.max()


@given(scale=st.floats(1e-3, 1e3))
def test_relative_error_knows_no_unit_and_absolute_errors_scale(scale):
    ours, theirs = np.random.default_rng(1).standard_normal((2, 50, 3))
    plain, scaled = displacement_errors(ours, theirs), displacement_errors(scale * ours, scale * theirs)
    assert scaled.relative == pytest.approx(plain.relative)
    assert scaled.mae == pytest.approx(scale * plain.mae)
    assert plain.mae <= plain.rmse <= plain.largest


def test_errors_do_not_depend_on_the_frame(some_fields, a_rotation):
    ours, theirs = some_fields
    turned = displacement_errors(ours @ a_rotation.T, theirs @ a_rotation.T)
    assert turned.rmse == pytest.approx(displacement_errors(ours, theirs).rmse)


def test_the_threshold_leaves_quiet_nodes_out(some_fields):
    ours, theirs = some_fields
    size = np.linalg.norm(theirs, axis=1)
    errors = displacement_errors(ours, theirs, threshold=0.02)
    assert errors.nodes == (size > 0.02).sum()
    assert errors.threshold == 0.02
    assert errors.zero_mae == pytest.approx(size[size > 0.02].mean())


def test_the_tip_error_is_that_of_the_nearest_node(a_tilted_grid):
    theirs = np.ones((*a_tilted_grid.shape, 3))
    ours = theirs.copy()
    ours[3, 4, 5] += [0, 0, 2]
    tip = a_tilted_grid.node([[3, 4, 5]])[0] + 0.2
    assert displacement_errors(ours, theirs, grid=a_tilted_grid, tip=tip).at_tip == 2
    assert displacement_errors(ours, theirs).at_tip is None


def test_a_mean_weighs_each_insertion_the_same():
    still, moved = np.ones((4, 3)), np.ones((8, 3))
    mean = mean_errors([displacement_errors(still, still), displacement_errors(2 * moved, moved)])
    assert mean.relative == pytest.approx(0.5)
    assert mean.largest == pytest.approx(np.sqrt(3))
    assert mean.nodes == 12


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.zeros((3, 3)), np.ones((4, 3))), {}, "give one row a node each"),
        ((np.zeros((3, 2)), np.ones((3, 2))), {}, "give an"),
        ((np.full((3, 3), np.nan), np.ones((3, 3))), {}, "displacement contains NaN"),
        ((np.zeros((3, 3)), np.zeros((3, 3))), {}, "moves no node by more than threshold = 0"),
        ((np.zeros((3, 3)), np.ones((3, 3))), {"threshold": 5}, "moves no node by more than threshold = 5"),
        ((np.zeros((3, 3)), np.ones((3, 3))), {"threshold": -1}, "threshold = -1 is out of range"),
        ((np.zeros((3, 3)), np.ones((3, 3))), {"tip": (0, 0, 0)}, "give their grid= as well"),
    ],
)
def test_errors_refuse_what_cannot_be_compared(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        displacement_errors(*arguments, **options)


def test_no_errors_have_no_mean():
    with pytest.raises(ValueError, match="at least one insertion"):
        mean_errors([])


def test_insertions_are_three_and_at_least_eight_and_no_two_the_same():
    assert len(tuning_insertions()) == 3
    assert len(held_out_insertions()) >= 8
    assert sum(plan.angle > 15 for plan in held_out_insertions()) >= 4
    assert len({(plan.entry, plan.target) for plan in ALL}) == len({plan.name for plan in ALL}) == len(ALL)


@pytest.mark.parametrize("face", ss.FACES)
@pytest.mark.parametrize("plan", ALL, ids=lambda plan: plan.name)
def test_every_insertion_enters_its_face_and_stays_inside(plan, face, a_tilted_grid):
    tissue = ss.Tissue(a_tilted_grid, entry_face=face)
    needle = plan.on(tissue)
    assert a_tilted_grid.nearest_face(needle.entry) == face
    assert a_tilted_grid.contains([needle.entry, needle.tip]).all()
    assert not ss.Tissue(ss.Grid.unit_cube(3), face).pinned.all()


@pytest.mark.parametrize("bad", [(-0.1, 0.5, 0.5), (0.5, 1.1, 0.5), (0.5, 0.5), (0.5, 0.5, np.nan)])
def test_an_insertion_that_leaves_the_block_is_refused(bad):
    with pytest.raises(ValueError, match="target"):
        PlannedInsertion("bad", (0, 0.5, 0.5), bad)


def test_a_reference_knows_its_needles(a_reference):
    assert a_reference.depths == (0.5, 1.0)
    whole = ALL[1].on(a_reference.tissue)
    assert np.allclose(a_reference.needle(0).tip, whole.at(0.5))
    assert a_reference.last.needle(0).tip.tolist() == whole.tip.tolist()
    assert np.array_equal(a_reference.last.displacements[0], a_reference.displacements[1])


@pytest.mark.parametrize("depths", [(), (0.0, 1.0), (1.0, 0.5), (0.5, 0.5), (0.5, 1.5)])
def test_a_reference_refuses_depths_that_do_not_rise(depths, unit_tissue):
    with pytest.raises(ValueError, match="rising fractions"):
        Reference(ALL[0], unit_tissue, depths, np.zeros((len(depths), 13, 13, 13, 3)))


def test_a_reference_of_another_grid_is_refused(a_reference):
    with pytest.raises(ValueError, match="give \\(1, 13, 13, 13, 3\\)"):
        Reference(ALL[0], a_reference.tissue, (1.0,), np.zeros((1, 9, 9, 9, 3)))
    with pytest.raises(ValueError, match="give one of \\(13, 13, 13\\)"):
        errors_along(ss.Insertion(ss.Tissue(ss.Grid.unit_cube(9))), a_reference)


def test_a_model_compared_with_itself_has_no_error(unit_tissue):
    def itself(tissue, entry, target, steps):
        return np.array([field.on_grid("direct") for field in ss.Insertion(tissue).run(entry, target, steps)])

    reference = Reference.solve(ALL[2], unit_tissue, steps=3, history=itself)
    assert max(errors.largest for errors in errors_along(ss.Insertion(unit_tissue), reference)) < 1e-12


@pytest.mark.slow
def test_tuned_parameters_hold_on_insertions_they_were_not_tuned_on(tmp_path, monkeypatch):
    pytest.importorskip("skfem", reason="needs the extra 'fem'")
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    tissue, model = ss.Tissue(ss.Grid.unit_cube(25)), ss.NeedleTissueModel.tuned()
    tuned_on, held_out = (
        errors_at_target(tuple(Reference.solve(plan, tissue, steps=1) for plan in plans), model)["mean"]
        for plans in (tuning_insertions(), held_out_insertions())
    )
    assert held_out.mae <= 1.2e-3
    assert held_out.relative <= 0.37
    assert held_out.mae <= 1.1 * tuned_on.mae
    assert held_out.relative <= 1.1 * tuned_on.relative


def test_the_plane_of_a_straight_needle_is_the_slice_of_the_paper(unit_tissue):
    plane = NeedlePlane.through(ALL[0].on(unit_tissue), unit_tissue)
    assert plane.normal.tolist() == [0, 0, 1]
    assert plane.lengths == pytest.approx([1, 1])
    assert len(plane.nodes) == 13 * 13
    assert plane.on_pinned_edge.sum() == 13 + 12 + 12


@pytest.mark.parametrize("plan", ALL, ids=lambda plan: plan.name)
@pytest.mark.parametrize("face", ["x-", "y+", "z-"])
def test_the_plane_holds_the_needle_and_fills_the_tissue(plan, face, a_tilted_grid):
    tissue = ss.Tissue(a_tilted_grid, entry_face=face)
    needle = plan.on(tissue)
    plane = NeedlePlane.through(needle, tissue)
    places, distance = plane.seen(a_tilted_grid.local(needle.at(np.linspace(0, 1, 7))))
    assert distance.max() < 1e-9
    assert np.allclose(plane.local(places), a_tilted_grid.local(needle.at(np.linspace(0, 1, 7))))
    assert a_tilted_grid.contains(a_tilted_grid.world(plane.local(plane.nodes))).all()
    edge = a_tilted_grid.world(plane.local(plane.nodes[plane.on_pinned_edge]))
    local = a_tilted_grid.local(edge)
    assert np.minimum(local, a_tilted_grid.extent - local).min(axis=1).max() < 1e-9


def test_the_thin_plate_meets_its_targets_and_pins_its_edges(a_reference):
    plate = ThinPlate(a_reference, PAPER)
    assert np.abs(plate.at_plane_nodes[plate.plane.on_pinned_edge]).max() < 1e-9
    assert np.abs(plate.at_plane_nodes @ plate.plane.normal).max() < 1e-12
    assert np.linalg.norm(plate.at_plane_nodes, axis=1).max() == pytest.approx(0.0266, rel=0.05)


def test_off_the_plane_the_thin_plate_knows_nothing(a_reference):
    errors = ThinPlate(a_reference, PAPER).errors()
    assert errors.still.in_plane == errors.carried.in_plane
    assert errors.still.off_plane.relative == 1
    assert errors.carried.in_plane.relative < errors.carried.off_plane.relative


def test_the_thin_plate_does_not_depend_on_the_frame(a_rotation, an_analytic_history):
    plain = ss.Tissue(ss.Grid.unit_cube(9))
    turned = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=1 / 8, origin=(3, -2, 1), direction=a_rotation))
    found = [
        ThinPlate(Reference.solve(ALL[4], tissue, steps=1, history=an_analytic_history), PAPER).errors()
        for tissue in (plain, turned)
    ]
    assert found[1].carried.off_plane.mae == pytest.approx(found[0].carried.off_plane.mae, rel=1e-5)
    assert found[1].still.in_plane.mae == pytest.approx(found[0].still.in_plane.mae, rel=1e-5)


def test_the_reference_itself_has_no_error_in_or_off_the_plane(a_reference):
    errors = plane_errors(a_reference, a_reference.last.displacements[0])
    assert errors.in_plane.largest == errors.off_plane.largest == 0


def test_every_reading_is_measured_or_says_why_not(a_reference):
    reported = []
    found = readings.compare_readings([a_reference], steps=3, progress=lambda *done: reported.append(done))
    assert len(found) == len(reported) == reported[-1][0] == reported[-1][1]
    assert {reading["group"] for reading in found} == {"units", "rows", "epsilon"}
    assert {reading["accumulation"] for reading in found} == {"maximum", "current", "additive", "moving mesh"}
    by_name = {(reading["name"], reading["accumulation"]): reading for reading in found}
    refused = by_name["+eps = 0.5 h", "current"]
    assert "singular" in refused["failure"]
    assert refused["mae"] is refused["largest_displacement"] is None
    adopted = by_name["shaft in sides, tip lengths in k", "maximum"]
    direct = errors_along(ss.Insertion(a_reference.tissue, PAPER), a_reference.last)[0]
    assert (adopted["mae"], adopted["rmse"], adopted["relative"]) == (direct.mae, direct.rmse, direct.relative)
    assert by_name["shaft in sides, tip lengths in k", "additive"]["largest_displacement"] > 0.05


def test_readings_need_a_reference():
    with pytest.raises(ValueError, match="at least one insertion"):
        readings.compare_readings([])
