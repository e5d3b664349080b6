"""What the needle does nearby: equations (14) to (21), Table I, and the accumulated displacement."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonospline as ss
from sonospline.mechanics.interaction import History, accumulated, interaction, shaft_displacement, tip_displacement

MODEL = ss.NeedleTissueModel(
    shaft_displacement=0.4,
    shaft_pull=0.1,
    shaft_radius=2.0,
    shaft_decay=1.0,
    pull_decay=0.5,
    tip_displacement=0.3,
    tip_radius=0.5,
    tip_length=1.0,
)
UPWARD = ss.Needle(entry=(1, 2, 3), tip=(1, 2, 7))  # depth 4 along z; all of it exact in binary


def at(x, y, z):
    return np.array([[x, y, z]], float)


def test_shaft_drags_along_and_pulls_inward_by_hand():
    """d = 1: 0.4 exp(-1/2) along z, 0.1 exp(-1 / (2 0.25)) towards the axis."""
    np.testing.assert_allclose(
        shaft_displacement(at(2, 2, 5), UPWARD, MODEL), [[-0.01353352832, 0, 0.24261226389]], atol=1e-11
    )
    # d = 2 on the other side, along y: 0.4 exp(-2) and 0.1 exp(-8).
    np.testing.assert_allclose(
        shaft_displacement(at(1, 0, 5), UPWARD, MODEL), [[0, 0.00003354626, 0.05413411329]], atol=1e-11
    )


def test_shaft_drags_points_on_the_axis_by_the_whole_amplitude():
    assert shaft_displacement(at(1, 2, 4.5), UPWARD, MODEL).tolist() == [[0, 0, 0.4]]


def test_shaft_along_an_oblique_axis_by_hand():
    """Axis (3, 4, 0) / 5, the point 2 along it and 1 above: e^-0.5 0.4 = 0.24261226."""
    needle = ss.Needle(entry=(0, 0, 0), tip=(3, 4, 0))
    np.testing.assert_allclose(
        shaft_displacement(at(1.2, 1.6, 1), needle, MODEL), [[0.14556735833, 0.19408981111, -0.01353352832]], atol=1e-11
    )


@pytest.mark.parametrize(
    ("place", "acts"),
    [
        ((2, 2, 3), True),  # tau = 0
        ((2, 2, 2.999), False),
        ((2, 2, 7), True),  # tau = inserted length
        ((2, 2, 7.001), False),
        ((3, 2, 5), True),  # d = delta
        ((3.001, 2, 5), False),
    ],
)
def test_shaft_acts_beside_the_inserted_length_alone(place, acts):
    assert shaft_displacement(at(*place), UPWARD, MODEL).any() == acts


@pytest.mark.parametrize(
    ("place", "acts"),
    [
        ((1, 2, 7), False),  # the tip itself: (19) asks for more than zero
        ((1, 2, 7.001), True),
        ((1, 2, 8), True),  # l_tip ahead
        ((1, 2, 8.001), False),
        ((1.5, 2, 7.5), True),  # r_tip beside
        ((1.501, 2, 7.5), False),
        ((1, 2, 6.5), False),  # behind the tip
    ],
)
def test_tip_pushes_its_cylinder_by_one_amount(place, acts):
    push = tip_displacement(at(*place), UPWARD, MODEL)  # (21)
    assert push.tolist() == [[0, 0, 0.3 if acts else 0]]


def test_shaft_and_tip_superpose():
    """A long cylinder cannot overlap the shaft, so each point gets exactly one of the two."""
    points = np.vstack([at(2, 2, 5), at(1, 2, 7.5), at(9, 9, 9)])
    np.testing.assert_allclose(
        interaction(points, UPWARD, MODEL), [[-0.01353352832, 0, 0.24261226389], [0, 0, 0.3], [0, 0, 0]], atol=1e-11
    )


def test_table_one():
    paper = dataclasses.asdict(ss.NeedleTissueModel.paper())
    # 0.3873 is the truncation radius, three sigma_s; tip lengths count spacings of the 25-node mesh.
    assert paper == pytest.approx(
        {
            "shaft_displacement": 0.0227,
            "shaft_pull": 0.0041,
            "shaft_radius": 0.3873,
            "shaft_decay": 0.1291,
            "pull_decay": 0.1291,
            "tip_displacement": 0.0266,
            "tip_radius": 0.0549375,
            "tip_length": 0.0898583333,
        }
    )
    assert paper["shaft_radius"] == pytest.approx(3 * paper["shaft_decay"])


def test_table_one_in_a_block_of_100_mm():
    unit, block = ss.NeedleTissueModel.paper(), ss.NeedleTissueModel.paper(side=100)
    assert dataclasses.astuple(block) == pytest.approx([100 * v for v in dataclasses.astuple(unit)])
    assert unit.scaled(100) == block


def test_incremental_reading_scales_the_displacements_alone():
    total, step = ss.NeedleTissueModel.paper(), ss.NeedleTissueModel.paper_incremental()
    assert step.shaft_displacement == pytest.approx(0.0227 / 24)
    assert step.shaft_pull == pytest.approx(0.0041 / 24)
    assert step.tip_displacement == pytest.approx(0.0266 / 24)
    for name in ("shaft_radius", "shaft_decay", "pull_decay", "tip_radius", "tip_length"):
        assert getattr(step, name) == getattr(total, name)
    assert ss.NeedleTissueModel.paper_incremental(side=100).shaft_displacement == pytest.approx(2.27 / 24)


@given(pull=st.floats(0, 100), decay=st.floats(0.01, 100), distance=st.floats(0, 1.9), turn=st.floats(-3.15, 3.15))
def test_pull_never_crosses_the_axis(pull, decay, distance, turn):
    strong = dataclasses.replace(MODEL, shaft_pull=pull, pull_decay=decay)
    radial = distance * np.array([np.cos(turn), np.sin(turn)])
    moved = at(1 + radial[0], 2 + radial[1], 5) + shaft_displacement(
        at(1 + radial[0], 2 + radial[1], 5), UPWARD, strong
    )
    beside = moved[0, :2] - [1, 2]
    # Still on its own side of the axis, and never pushed outward.
    assert beside @ radial >= -1e-12
    assert np.linalg.norm(beside) <= distance + 1e-12


def test_pull_is_capped_at_the_axis():
    """gamma_max = 10 at d = 0.25: the point comes to the axis, not past it."""
    strong = dataclasses.replace(MODEL, shaft_pull=10.0)
    assert shaft_displacement(at(1.25, 2, 5), UPWARD, strong)[0, :2].tolist() == [-0.25, 0]


@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-50, 50)] * 3))
def test_interaction_turns_with_the_needle(angles, shift):
    rotation = Rotation.from_rotvec(angles).as_matrix()
    rng = np.random.default_rng(11)
    entry, tip, points = np.zeros(3), np.array([1.1, 2.3, 3.1]), rng.uniform(-1, 4, (200, 3))
    here = interaction(points, ss.Needle(entry, tip), MODEL)
    there = interaction(points @ rotation.T + shift, ss.Needle(rotation @ entry + shift, rotation @ tip + shift), MODEL)
    assert here.any(axis=1).sum() > 20
    np.testing.assert_allclose(there, here @ rotation.T, rtol=0, atol=1e-9)


WEAK_TIP = dataclasses.replace(MODEL, tip_displacement=0.05)
LONG_TIP = dataclasses.replace(MODEL, tip_length=30.0, tip_radius=3.0)


@pytest.mark.parametrize("model", [MODEL, WEAK_TIP, LONG_TIP], ids=["table", "weak tip", "long tip"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_accumulated_is_the_maximum_over_the_way_in(model, seed):
    """Against the definition: the largest displacement met at any of 1,500 depths."""
    rng = np.random.default_rng(seed)
    entry, tip = rng.uniform(0, 1, 3), rng.uniform(3, 4, 3)
    points = rng.uniform(-1, 6, (400, 3))
    points[:40] = entry + rng.uniform(0, 1.5, (40, 1)) * (tip - entry) + 0.1 * rng.standard_normal((40, 3))
    largest, size = np.zeros((400, 3)), np.zeros(400)
    for part in np.linspace(1e-6, 1, 1500):
        now = interaction(points, ss.Needle(entry, entry + part * (tip - entry)), model)
        stronger = np.linalg.norm(now, axis=1) > size + 1e-12
        largest[stronger], size[stronger] = now[stronger], np.linalg.norm(now[stronger], axis=1)
    assert (size > 0).sum() > 40
    np.testing.assert_allclose(accumulated(points, ss.Needle(entry, tip), model), largest, rtol=0, atol=1e-9)


def test_tissue_behind_the_tip_remembers_its_push():
    """A node close to the axis was pushed by 0.3 before a weaker shaft drag took over."""
    weak_shaft = dataclasses.replace(MODEL, shaft_displacement=0.1)
    place = at(1, 2, 5)
    assert interaction(place, UPWARD, weak_shaft).tolist() == [[0, 0, 0.1]]
    assert accumulated(place, UPWARD, weak_shaft).tolist() == [[0, 0, 0.3]]


@pytest.mark.parametrize(
    ("place", "depth"),
    [
        ((2.5, 2, 5), 2.0),  # beside the tip's path: when the tip comes level
        ((1.25, 2, 5), 1.0),  # in its path: tip_length earlier
        ((1, 2, 3.5), 0.0),  # from the first touch
        ((1, 2, 60), 56.0),  # the axis goes on for ever
        ((2.5, 2, 2.9), np.inf),  # behind the entry
        ((3.5, 2, 5), np.inf),  # beyond delta
    ],
)
def test_activation_depth_by_hand(place, depth):
    np.testing.assert_allclose(History.of(at(*place), UPWARD, MODEL).wakes, [depth], atol=1e-12)


def test_activation_depth_is_where_the_displacement_begins():
    points = np.random.default_rng(4).uniform(-1, 8, (500, 3))
    wakes = History.of(points, UPWARD, MODEL).wakes
    finite = np.isfinite(wakes) & (wakes > 0)
    assert finite.sum() > 20
    for point, depth in zip(points[finite], wakes[finite], strict=True):
        before, after = (ss.Needle(UPWARD.entry, (1, 2, 3 + depth + d)) for d in (-1e-6, 1e-6))
        assert not accumulated(point[None], before, MODEL).any()
        assert accumulated(point[None], after, MODEL).any()


LENGTHS = ("shaft_radius", "shaft_decay", "pull_decay", "tip_radius", "tip_length")
AMPLITUDES = ("shaft_displacement", "shaft_pull", "tip_displacement")


@pytest.mark.parametrize("name", LENGTHS + AMPLITUDES)
@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5, "deep", None])
def test_bad_parameter_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=rf"{name} = {value!r} is (not a number|out of range; give a finite number)"):
        dataclasses.replace(MODEL, **{name: value})


@pytest.mark.parametrize("name", LENGTHS)
def test_length_of_zero_is_refused_by_name(name):
    with pytest.raises(ValueError, match=rf"{name} = 0 is out of range; give a finite number above zero"):
        dataclasses.replace(MODEL, **{name: 0})


def test_displacements_of_zero_are_a_needle_that_does_nothing():
    still = dataclasses.replace(MODEL, **dict.fromkeys(AMPLITUDES, 0))
    points = np.random.default_rng(6).uniform(-1, 8, (100, 3))
    assert not accumulated(points, UPWARD, still).any()


def test_bad_scale_is_refused_by_name():
    with pytest.raises(ValueError, match=r"side = 0 is out of range; give a finite number above zero"):
        ss.NeedleTissueModel.paper(side=0)


def test_model_is_frozen():
    with pytest.raises(AttributeError):
        MODEL.tip_length = 2.0
