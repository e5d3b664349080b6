"""Algorithm 1, in both readings."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

import sonospline as ss
from sonospline.mechanics.interaction import accumulated

# Ties with no node of the grids used here, so that rounding decides nothing.
ENTRY, TARGET = np.array([0, 0.413, 0.578]), np.array([0.617, 0.531, 0.469])


def needle_at(part, entry=ENTRY, target=TARGET):
    return ss.Needle(entry, entry + part * (target - entry))


@pytest.fixture
def an_insertion(unit_tissue):
    return ss.Insertion(unit_tissue)


@pytest.fixture
def an_incremental_insertion(unit_tissue):
    return ss.Insertion(unit_tissue, ss.NeedleTissueModel.paper_incremental(), accumulation="incremental")


def test_tissue_without_a_needle_is_at_rest(an_insertion, an_incremental_insertion):
    for insertion in (an_insertion, an_incremental_insertion):
        assert not insertion.field.on_grid("direct").any()
        assert insertion.needle is None
        assert insertion.landmark_count == 0


@pytest.mark.usefixtures("backend")
def test_landmarks_take_their_displacement_and_anchors_stay(an_insertion):
    field = an_insertion.advance(needle_at(1))
    anchors, landmarks = np.split(field.centres, [89])
    assert len(landmarks) == an_insertion.landmark_count > 20
    np.testing.assert_allclose(field.displacement(anchors), 0, atol=1e-12)
    expected = accumulated(landmarks, needle_at(1), ss.NeedleTissueModel.paper())
    assert (np.linalg.norm(expected, axis=1) > 1e-4).all()
    np.testing.assert_allclose(field.displacement(landmarks), expected, rtol=0, atol=1e-12)


def test_tissue_beside_the_shaft_follows_the_needle(an_insertion):
    along = an_insertion.advance(needle_at(1)).displacement(needle_at(1).at([0.3, 0.5, 0.8]))
    assert (along @ needle_at(1).direction > 0.5 * 0.0227).all()
    assert np.abs(an_insertion.field.on_grid("direct")).max() < 0.03


@pytest.mark.parametrize("steps", [1, 3, 20])
def test_maximum_does_not_depend_on_the_number_of_steps(an_insertion, unit_tissue, steps):
    fields = list(an_insertion.run(ENTRY, TARGET, steps=steps))
    at_once = ss.Insertion(unit_tissue).advance(needle_at(1))
    assert len(fields) == steps
    assert an_insertion.field is fields[-1]
    np.testing.assert_allclose(fields[-1].on_grid("direct"), at_once.on_grid("direct"), rtol=0, atol=1e-13)


def test_run_stops_at_equal_depths(an_insertion):
    seen = [an_insertion.needle.depth for _ in an_insertion.run(ENTRY, TARGET, steps=4)]
    np.testing.assert_allclose(seen, np.linalg.norm(TARGET - ENTRY) * np.array([0.25, 0.5, 0.75, 1]))


def test_pulling_back_returns_the_earlier_field(an_insertion):
    first, deeper, back = (an_insertion.advance(needle_at(p)).on_grid("direct") for p in (0.4, 1.0, 0.4))
    assert np.abs(deeper - first).max() > 1e-3
    assert np.array_equal(back, first)


def test_deeper_needle_displaces_more_tissue(an_insertion):
    active, moved = [], []
    for field in an_insertion.run(ENTRY, TARGET, steps=6):
        active.append(an_insertion.landmark_count)
        moved.append(np.linalg.norm(field.on_grid("direct"), axis=-1).mean())
    assert active == sorted(active)
    assert active[-1] > 2 * active[0]
    assert moved[-1] > 1.1 * moved[0]


def test_needle_elsewhere_starts_a_new_pass(an_insertion, unit_tissue):
    elsewhere = ss.Needle((0, 0.287, 0.319), (0.433, 0.471, 0.387))
    an_insertion.advance(needle_at(1))
    second = an_insertion.advance(elsewhere)
    fresh = ss.Insertion(unit_tissue).advance(elsewhere)
    assert np.array_equal(second.on_grid("direct"), fresh.on_grid("direct"))
    again = an_insertion.advance(needle_at(1))
    assert np.array_equal(again.on_grid("direct"), ss.Insertion(unit_tissue).advance(needle_at(1)).on_grid("direct"))


def test_reset_takes_the_needle_out(an_insertion):
    first = an_insertion.advance(needle_at(1)).on_grid("direct")
    an_insertion.reset()
    assert an_insertion.needle is None
    assert not an_insertion.field.on_grid("direct").any()
    assert np.array_equal(an_insertion.advance(needle_at(1)).on_grid("direct"), first)


@pytest.mark.parametrize("accumulation", ["maximum", "incremental"])
def test_unit_cube_and_block_of_100_mm_are_one_problem(unit_tissue, accumulation):
    model = ss.NeedleTissueModel.paper if accumulation == "maximum" else ss.NeedleTissueModel.paper_incremental
    block_tissue = ss.Tissue(ss.Grid(shape=(13, 13, 13), spacing=100 / 12))
    cube = ss.Insertion(unit_tissue, model(), accumulation=accumulation)
    block = ss.Insertion(block_tissue, model(100), accumulation=accumulation)
    *_, small = cube.run(ENTRY, TARGET, steps=3)
    *_, large = block.run(100 * ENTRY, 100 * TARGET, steps=3)
    assert cube.landmark_count == block.landmark_count
    np.testing.assert_allclose(large.on_grid("direct") / 100, small.on_grid("direct"), rtol=0, atol=1e-12)


def test_default_model_is_table_one_at_the_size_of_the_tissue(a_tilted_grid):
    assert ss.Insertion(ss.Tissue(a_tilted_grid)).model == ss.NeedleTissueModel.paper(side=a_tilted_grid.side)


def test_placed_and_turned_tissue_deforms_alike(unit_tissue, a_rotation):
    grid = ss.Grid(shape=(13, 13, 13), spacing=1 / 12, origin=(3, -2, 5), direction=a_rotation)
    here = ss.Insertion(unit_tissue).advance(needle_at(1)).on_grid("direct")
    there = ss.Insertion(ss.Tissue(grid)).advance(ss.Needle(grid.world(ENTRY), grid.world(TARGET))).on_grid("direct")
    np.testing.assert_allclose(there, here @ a_rotation.T, rtol=0, atol=1e-12)


def test_more_landmarks_come_nearer_to_the_field_of_all_nodes():
    tissue = ss.Tissue(ss.Grid.unit_cube(17))
    some, more, every = (
        ss.Insertion(tissue, max_landmarks=n).advance(needle_at(1)).on_grid("direct") for n in (200, 400, 10**6)
    )
    far, near = (
        np.linalg.norm(field - every, axis=-1).mean() / np.linalg.norm(every, axis=-1).mean() for field in (some, more)
    )
    # 0.23 and 0.09 of the mean displacement when written down.
    assert 0 < near < 0.6 * far
    assert far < 0.3


def test_options_reach_the_spline(unit_tissue):
    exact, smooth, cubic = (
        ss.Insertion(unit_tissue, **options).advance(needle_at(1))
        for options in ({}, {"smoothing": 0.05}, {"kernel": ss.Triharmonic()})
    )
    landmarks = exact.centres[89:]
    assert np.abs(smooth.displacement(landmarks) - exact.displacement(landmarks)).max() > 1e-4
    assert cubic.kernel == ss.Triharmonic()
    np.testing.assert_allclose(cubic.displacement(landmarks), exact.displacement(landmarks), atol=1e-9)
    assert len(ss.Insertion(unit_tissue, anchors=13).anchors) == unit_tissue.pinned.sum()


def shown_state(insertion):
    return insertion.needle, insertion.field, insertion.plan, insertion.landmark_count


@pytest.mark.parametrize("kind", ["an_insertion", "an_incremental_insertion"])
def test_failing_step_leaves_the_previous_field(request, kind, monkeypatch):
    insertion = request.getfixturevalue(kind)
    insertion.advance(needle_at(0.4))
    before, values = shown_state(insertion), insertion.field.on_grid("direct")

    def fail(*_, **__):
        raise np.linalg.LinAlgError("singular")

    with monkeypatch.context() as broken:
        broken.setattr(ss.PolyharmonicSpline, "solve", fail)
        with pytest.raises(np.linalg.LinAlgError):
            insertion.advance(needle_at(0.8))
    with pytest.raises(ValueError, match="outside"):
        insertion.advance(needle_at(5.0))
    assert all(now is then for now, then in zip(shown_state(insertion)[:3], before[:3], strict=True))
    assert insertion.landmark_count == before[3]
    assert np.array_equal(insertion.field.on_grid("direct"), values)
    # And the next good step goes on from there as if nothing had happened.
    undisturbed = ss.Insertion(insertion.tissue, insertion.model, accumulation=insertion.accumulation)
    for part in (0.4, 0.8):
        expected = undisturbed.advance(needle_at(part))
    assert np.array_equal(insertion.advance(needle_at(0.8)).on_grid("direct"), expected.on_grid("direct"))


def algorithm_one(grid, pinned, model, needles):
    """Algorithm 1 to the letter, every displaced node a landmark and every pinned one an anchor."""
    mesh, rest = grid.points.copy(), grid.points[pinned.ravel()]
    maps = []
    for needle in needles:
        u = (needle.tip - needle.entry) / np.linalg.norm(needle.tip - needle.entry)  # (10)
        depth = np.linalg.norm(needle.tip - needle.entry)
        displacement = np.zeros_like(mesh)
        for i, (node, is_pinned) in enumerate(zip(mesh, pinned.ravel(), strict=True)):
            tau = (node - needle.entry) @ u  # (11)
            outward = node - (needle.entry + tau * u)  # (12)
            d = np.sqrt(outward @ outward)  # (13)
            if is_pinned:
                continue
            if 0 <= tau <= depth and d <= model.shaft_radius:
                drag = model.shaft_displacement * np.exp(-d * d / (2 * model.shaft_decay**2))
                pull = min(d, model.shaft_pull * np.exp(-d * d / (2 * model.pull_decay**2)))
                displacement[i] = drag * u - (pull * outward / d if d > 0 else 0)
            elif 0 < tau - depth <= model.tip_length and d <= model.tip_radius:
                displacement[i] = model.tip_displacement * u
        moved = displacement.any(axis=1)
        g = RBFInterpolator(
            np.vstack([rest, mesh[moved]]),
            np.vstack([rest, mesh[moved] + displacement[moved]]),
            kernel="linear",
            degree=1,
        )
        maps.append(g)
        mesh = g(mesh)  # lines 9 and 10
    return mesh, maps


def test_incremental_is_algorithm_one_to_the_letter(rng):
    grid = ss.Grid.unit_cube(8)
    tissue = ss.Tissue(grid)
    # Wide enough to reach every node, so that which nodes are candidates plays no part.
    model = ss.NeedleTissueModel(
        shaft_displacement=0.01,
        shaft_pull=0.004,
        shaft_radius=0.9,
        shaft_decay=0.2,
        pull_decay=0.15,
        tip_displacement=0.02,
        tip_radius=0.2,
        tip_length=0.3,
    )
    entry = np.array([0, 0.453, 0.561])
    insertion = ss.Insertion(tissue, model, accumulation="incremental", anchors=8, max_landmarks=10**6)
    needles = [ss.Needle(entry, entry + depth * np.array([1, 0, 0])) for depth in (0.113, 0.237, 0.351, 0.466)]
    for needle in needles:
        field = insertion.advance(needle)
    mesh, maps = algorithm_one(grid, tissue.pinned, model, needles)
    assert np.abs(mesh - grid.points).max() > 0.02
    np.testing.assert_allclose(field.on_grid("direct").reshape(-1, 3), mesh - grid.points, rtol=0, atol=1e-10)
    places = rng.random((50, 3))
    moved = places
    for g in maps:
        moved = g(moved)
    np.testing.assert_allclose(field.forward(places), moved, rtol=0, atol=1e-10)


def test_incremental_steps_add_up(an_incremental_insertion):
    """What the maximum must not do: twenty steps displace far more than one."""
    one = an_incremental_insertion.advance(needle_at(1)).on_grid("direct")
    an_incremental_insertion.reset()
    *_, twenty = an_incremental_insertion.run(ENTRY, TARGET, steps=20)
    assert np.abs(twenty.on_grid("direct")).max() > 5 * np.abs(one).max()
    assert len(twenty.steps) == 20


@pytest.mark.parametrize("part", [0.5, 0.3])
def test_incremental_refuses_to_pull_back(an_incremental_insertion, part):
    an_incremental_insertion.advance(needle_at(0.5))
    with pytest.raises(ValueError, match=r"tip = \[.*\] does not advance.*use 'maximum' or reset\(\)"):
        an_incremental_insertion.advance(needle_at(part))
    assert len(an_incremental_insertion.field.steps) == 1
    an_incremental_insertion.reset()
    assert len(an_incremental_insertion.advance(needle_at(part)).steps) == 1


def test_incremental_takes_a_second_needle_through_the_deformed_tissue(an_incremental_insertion):
    an_incremental_insertion.advance(needle_at(0.5))
    first = an_incremental_insertion.field.on_grid("direct")
    field = an_incremental_insertion.advance(ss.Needle((0, 0.2, 0.3), (0.2, 0.3, 0.35)))
    assert len(field.steps) == 2
    # Nodes beside the second track move on; those at the end of the first feel it less.
    change = np.linalg.norm(field.on_grid("direct") - first, axis=-1)
    assert change[1, 3, 4] > 1.5 * change[4, 6, 6] > 0


@pytest.mark.parametrize(
    ("entry", "tip", "message"),
    [
        ((-0.1, 0.5, 0.5), (0.5, 0.5, 0.5), r"entry = \[-0.1, 0.5, 0.5\] lies outside.*move it into \[0, 1\] x"),
        ((0, 0.5, 0.5), (1.2, 0.5, 0.5), r"tip = \[1.2, 0.5, 0.5\] lies outside.*move it into \[0, 1\] x \[0, 1\]"),
        ((0, 0.5, 0.5), (0, 0.5, 0.5), r"tip = \[0.0, 0.5, 0.5\] equals the entry"),
        ((0, np.nan, 0.5), (0.5, 0.5, 0.5), r"entry contains NaN"),
        ((0, 0.5, 0.5), (0.5, np.inf, 0.5), r"tip contains NaN or infinity"),
    ],
)
def test_bad_needle_is_refused(an_insertion, entry, tip, message):
    with pytest.raises(ValueError, match=message):
        an_insertion.advance(ss.Needle(entry, tip))
    assert an_insertion.needle is None
    assert not an_insertion.field.on_grid("direct").any()


def test_bad_run_is_refused_before_its_first_step(an_insertion):
    with pytest.raises(ValueError, match=r"steps = 0 is too small; give at least 1"):
        an_insertion.run(ENTRY, TARGET, steps=0)
    with pytest.raises(ValueError, match=r"steps = 2.5 is not a whole number"):
        an_insertion.run(ENTRY, TARGET, steps=2.5)
    with pytest.raises(
        ValueError, match=r"target = \[2.0, 0.5, 0.5\] lies outside the tissue, 1 beyond its face x.; move it into"
    ):
        an_insertion.run(ENTRY, (2, 0.5, 0.5))
    with pytest.raises(ValueError, match="equals the entry"):
        an_insertion.run(ENTRY, ENTRY)
    assert an_insertion.needle is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"accumulation": "sum"}, r"accumulation = 'sum' is not known; choose one of maximum, incremental"),
        ({"max_landmarks": 0}, r"max_landmarks = 0 is too small; give at least 1"),
        ({"max_landmarks": 10.0}, r"max_landmarks = 10.0 is not a whole number"),
        ({"anchors": 1}, r"anchors = 1 is too small; give at least 2"),
        ({"smoothing": -1.0}, r"smoothing = -1.0 is out of range; give a finite number"),
    ],
)
def test_bad_option_is_refused_by_name(unit_tissue, options, message):
    with pytest.raises(ValueError, match=message):
        ss.Insertion(unit_tissue, **options)


def test_something_else_than_tissue_is_refused():
    with pytest.raises(ValueError, match=r"tissue = 25 is not a Tissue; make one"):
        ss.Insertion(25)


def test_maximum_does_not_depend_on_the_number_of_steps_on_a_tie():
    """At round coordinates whole planes of nodes are exactly level with the tip."""
    tissue = ss.Tissue(ss.Grid.unit_cube(25))
    entry, target = (0, 0.5, 0.5), (0.5, 0.75, 0.25)
    *_, stepped = ss.Insertion(tissue).run(entry, target, steps=3)
    at_once = ss.Insertion(tissue).advance(ss.Needle(entry, target))
    np.testing.assert_allclose(stepped.on_grid("direct"), at_once.on_grid("direct"), rtol=0, atol=1e-9)


def test_one_tip_array_may_serve_every_step(an_incremental_insertion):
    """What a live loop does: overwrite the tip in place and advance again."""
    tip = TARGET / 2
    for _ in range(2):
        an_incremental_insertion.advance(ss.Needle((0, 0.4, 0.4), tip))
        tip += 0.1
    assert len(an_incremental_insertion.field.steps) == 2
