"""The stepwise reference of a needle's friction and cutting: closed forms, work, memory and symmetries."""

import pickle
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import sonospline as ss
from elastic_problems import largest_difference
from sonospline.fem import FiniteElementModel, StepwiseNeedle, StepwiseTissue
from sonospline.fem.scikit_assembly import assemble
from sonospline.mechanics import labelled_cube

pytest.importorskip("skfem", reason="needs the extra 'fem'")

TIMES, FRACTIONS = np.array([0.5, 10.0]), np.array([0.3, 0.3])
FRICTION, CUTTING, WIDTH = 0.03, 0.007, 0.125
ENTRY = np.array([0.0, 0.4, 0.55])
ALONG = np.array([0.6, 0.1, -0.05]) / np.linalg.norm([0.6, 0.1, -0.05])
APART = 0.0625


def modulus(time):
    """What is left of the stiffness after a time."""
    return 1 - FRACTIONS.sum() + FRACTIONS @ np.exp(-time / TIMES)


@cache
def cube(nodes, name, relaxing):
    """Tissue that relaxes in one way, if at all, made and factored once."""
    tissues = labelled_cube(name, voxels=24)
    known = {"times": TIMES, "fractions": FRACTIONS} if relaxing else {}
    return StepwiseTissue(ss.Tissue(ss.Grid.unit_cube(nodes)), tissues, **known)


def made(nodes=9, name="homogeneous", *, relaxing=False, body=None, depths=None, **options):
    """A needle through points half a width apart, of the paper's size."""
    depths = np.arange(APART / 2, 0.6, APART) if depths is None else np.array(depths)
    known = {"width": WIDTH, "bounds": FRICTION * APART, "cutting": CUTTING, **options}
    points = ENTRY + depths[:, None] * ALONG
    return StepwiseNeedle(body or cube(nodes, name, relaxing), entry=ENTRY, points=points, direction=ALONG, **known)


def way(*turns, step):
    """Travels from 0 to each turn in steps of at most this length."""
    ends = pairwise((0.0, *turns))
    return np.concatenate([np.linspace(a, b, 1 + int(np.ceil(abs(b - a) / step - 1e-9)))[1:] for a, b in ends])


def run(needle, *turns, step):
    return [needle.rest, *needle.path(needle.rest, way(*turns, step=step))]


# One point


def grip(**options):
    """One point alone, with the tip far past it, its compliance, and how far the needle has come."""
    needle = made(depths=[0.3], cutting=0.0, **options)
    state = needle.path(needle.rest, [0.32, 0.4])[-1]
    return needle, state, needle._shaft(0.0).compliance[0, 0]


def test_one_point_sticks_and_slides_as_a_spring_and_a_slider():
    needle, state, compliance = grip()
    most = FRICTION * APART
    assert state.force == most
    for travel in np.linspace(0.4, 0.4 - 3 * most * compliance, 13)[1:]:
        state = needle.step(state, travel)
        assert state.force == pytest.approx(max(most - (0.4 - travel) / compliance, -most), abs=1e-12)


def test_the_loop_of_one_point_has_the_area_of_its_closed_form():
    """4 q (A - q C) for an amplitude A, in steps that meet the corners of the loop."""
    needle, state, compliance = grip()
    most = FRICTION * APART
    amplitude = 5 * most * compliance
    assert amplitude < 0.05
    travels = 0.4 - amplitude + amplitude * np.interp(np.arange(61), [0, 20, 40, 60], [1, -1, 1, -1])
    forces = np.array([found.force for found in needle.path(state, travels)])
    work = ((forces[21:] + forces[20:-1]) / 2) @ np.diff(travels[20:])
    assert work == pytest.approx(4 * most * (amplitude - most * compliance), rel=1e-8)


def test_static_friction_breaks_to_the_kinetic_one_and_holds_again_at_the_turn():
    needle, state, compliance = grip(kinetic=FRICTION * APART / 2)
    static, kinetic = FRICTION * APART, FRICTION * APART / 2
    assert state.force == kinetic
    slack = static * compliance
    forces = [found.force for found in needle.path(state, 0.4 - slack * np.array([0.7, 1.4, 1.45, 1.6, 1.7, 1.5, 1.4]))]
    # back from +kinetic: sticks to -0.9 static, breaks beyond it, slides, and sticks again when it turns
    assert forces[:2] == pytest.approx([kinetic - 0.7 * static, kinetic - 1.4 * static])
    assert forces[3:5] == [-kinetic, -kinetic]
    assert forces[5:] == pytest.approx([-kinetic + 0.2 * static, -kinetic + 0.3 * static], rel=1e-6)


@pytest.mark.slow
def test_viscous_friction_grows_with_the_speed_of_the_slip():
    """Forward, backward, and not at all while the point sticks or no time passes."""
    needle, state, compliance = grip(viscous=0.01)
    most, dt = FRICTION * APART, 0.1
    for speed in (0.02, 0.08):
        on = speed * dt * np.arange(1, 9)
        steady = needle.path(state, state.travel + on, dt)[-1]
        assert steady.force == pytest.approx(most + 0.01 * speed, rel=1e-6)
        back = needle.path(needle.step(steady, 0.38, dt), 0.38 - on, dt)[-1]
        assert back.force == pytest.approx(-most - 0.01 * speed, rel=1e-6)
    little = 0.2 * most * compliance
    assert needle.step(state, state.travel - little, dt).force == pytest.approx(0.8 * most, rel=1e-6)
    assert needle.step(state, state.travel + 0.01, 0.0).force == most


def test_a_point_that_lost_the_needle_is_free_until_the_tip_is_at_it_again():
    needle, state, compliance = grip()
    out, outside, short = needle.path(state, [0.31, 0.29, 0.2])
    assert out.contact.touching.tolist() == [True]
    for found in (outside, short):
        assert found.force == 0
        assert not found.displacement.any()
        assert not found.contact.touching.any()
    before, again, deeper = needle.path(short, [0.2999, 0.3 + 0.5 * FRICTION * APART * compliance, 0.4])
    assert before.force == 0
    assert again.force == pytest.approx(0.5 * FRICTION * APART)
    assert deeper.force == FRICTION * APART


# The tip


def test_a_tip_alone_cuts_at_its_resistance_and_lets_go_like_a_spring():
    needle = made(bounds=0.0)
    state = run(needle, 0.3, step=0.1)[-1]
    at_tip = needle.smoothed(state.displacement, state.contact.cut)
    assert state.force == pytest.approx(CUTTING, rel=1e-9)
    assert state.contact.cut + at_tip == pytest.approx(0.3, abs=1e-9)
    half = needle.step(state, 0.3 - at_tip / 2)
    assert half.force == pytest.approx(CUTTING / 2, rel=1e-7)
    assert half.contact.cut == state.contact.cut
    assert needle.step(half, 0.3 - 1.01 * at_tip).force == 0
    again = needle.step(half, 0.3)
    assert (again.force, again.contact.cut) == pytest.approx((CUTTING, state.contact.cut), rel=1e-6)


@pytest.mark.slow
def test_where_resistance_jumps_the_tip_waits_until_it_is_overcome():
    """Twice as tough from 0.2 on: the cut stays there while the force doubles."""
    needle = made(bounds=0.0, cutting=lambda depth: CUTTING * (1 if depth < 0.2 else 2))
    states = needle.path(needle.rest, [0.1, *np.linspace(0.2, 0.215, 16)])
    cuts, forces = (np.array(values) for values in zip(*[(s.contact.cut, s.force) for s in states], strict=True))
    waiting = np.abs(cuts - 0.2) < 1e-8
    assert waiting.sum() >= 3
    assert (np.diff(forces[waiting]) > 0).all()
    assert forces[cuts < 0.2 - 1e-8] == pytest.approx(CUTTING, rel=1e-7)
    assert forces[cuts > 0.2 + 1e-8] == pytest.approx(2 * CUTTING, rel=1e-7)
    assert (cuts < 0.2 - 1e-8).sum() >= 3
    assert (cuts > 0.2 + 1e-8).sum() >= 3


# Work


def taken(needle, one, other):
    """What friction and the tip take of a step's work, by means of both ends.

    Of the tip's it is the resistance times the way of the cut in the tissue, wherever it cuts all the time.
    """
    moved, displaced = other.travel - one.travel, other.displacement - one.displacement
    slip = moved - needle.smoothed(displaced)
    both = one.contact.touching & other.contact.touching
    np.testing.assert_allclose((other.contact.anchors - one.contact.anchors)[both], slip[both], atol=1e-9)
    assert (other.contact.forces * slip > -1e-12).all()
    friction = (one.contact.forces + other.contact.forces) / 2 @ slip
    pushes = [state.contact.tip_force for state in (one, other)]
    cuts = [state.contact.cut for state in (one, other)]
    pushed = sum(push * needle.smoothed(displaced, cut) for push, cut in zip(pushes, cuts, strict=True)) / 2
    tip = np.mean(pushes) * moved - pushed
    if min(pushes) > CUTTING * (1 - 1e-6):
        mean = (one.displacement + other.displacement) / 2
        opened = cuts[1] - cuts[0] + needle.smoothed(mean, cuts[1]) - needle.smoothed(mean, cuts[0])
        assert tip == pytest.approx(CUTTING * opened, rel=1e-6)
    return friction, tip


def balance(needle, states):
    """Work of the needle, and what friction and the tip took of it."""
    steps = list(pairwise(states))
    work = sum((one.force + other.force) / 2 * (other.travel - one.travel) for one, other in steps)
    parts = np.array([taken(needle, *step) for step in steps])
    return work, *parts.sum(axis=0)


def stored(needle, state):
    """By the matrix that scikit-fem assembles of all cells."""
    model = FiniteElementModel(needle.body.tissue, needle.body.moduli, integration="mean_dilatation")
    displacement = state.displacement.ravel()
    return 0.5 * displacement @ (assemble(model._system()).stiffness @ displacement)


TURNS = (0.3, 0.15, 0.4, -0.02, 0.25)
"""In, half out, in again and deeper, all the way out, and into the cut track."""


@pytest.mark.slow
def test_the_work_of_the_needle_is_stored_rubbed_and_cut():
    needle = made(name="layers")
    states = run(needle, *TURNS, step=0.05)
    for end in (6, 9, len(states) - 1):
        work, friction, tip = balance(needle, states[: end + 1])
        assert work == pytest.approx(stored(needle, states[end]) + friction + tip, rel=1e-6)
        assert min(friction, tip) > 0.05 * work


@pytest.mark.slow
def test_halved_steps_halve_what_the_work_of_friction_lacks():
    """Means of both ends against bounds times slip, which is what friction takes where steps have no length."""
    needle = made()
    pushed, errors = run(needle, 0.4, step=0.1)[-1], []
    for steps in (4, 8, 16):
        travels = np.concatenate([np.linspace(0.4, 0.36, steps + 1), np.linspace(0.36, 0.4, steps + 1)[1:]])
        states = [pushed, *needle.path(pushed, travels[1:])]
        slid = sum(
            np.abs(other.contact.forces) @ np.abs(other.contact.anchors - one.contact.anchors)
            for one, other in pairwise(states)
        )
        errors.append(slid / balance(needle, states)[1] - 1)
    assert errors[0] > 1.5 * errors[1] > 2.2 * errors[2] > 0
    assert errors[2] < 0.05


# Memory


def test_the_elastic_loop_closes_and_turns_only_gradually():
    needle = made(name="layers")
    inserted = run(needle, 0.4, step=0.05)[-1]
    turned, pulled, again = needle.path(inserted, [0.398, 0.3, 0.4])
    assert largest_difference(again.displacement, inserted.displacement) < 1e-6
    assert again.force == pytest.approx(inserted.force, rel=1e-6)
    assert again.contact.cut == pytest.approx(inserted.contact.cut, rel=1e-9)
    assert (turned.contact.sliding[turned.contact.touching] == 0).any()
    assert 0 < turned.force < inserted.force
    beside = pulled.contact.touching
    assert pulled.force == pytest.approx(-FRICTION * APART * beside.sum())
    assert (needle.smoothed(inserted.displacement)[beside] > 0).all()
    assert (needle.smoothed(pulled.displacement)[beside] < 0).all()


def test_the_end_of_an_insertion_does_not_depend_on_its_steps():
    """All points slide: friction then has no memory."""
    needle = made()
    ends = [run(needle, 0.4, step=step)[-1].displacement for step in (0.4, 0.04)]
    assert largest_difference(*ends) < 1e-6


def test_denser_points_of_the_same_friction_change_the_force_by_one_of_them():
    """Though their compliance is singular to rounding: four on a width."""
    coarse, fine = made(), made(depths=np.arange(APART / 4, 0.6, APART / 2), bounds=FRICTION * APART / 2)
    paths = [needle.path(needle.rest, [0.4, 0.39, 0.3]) for needle in (coarse, fine)]
    for one, other in zip(*paths, strict=True):
        assert abs(one.force - other.force) < FRICTION * APART
        assert np.abs(one.displacement - other.displacement).max() < 0.05 * paths[1][0].displacement.max()


@pytest.mark.slow
def test_forces_after_a_turn_converge_at_first_order():
    needle = made()
    pushed = run(needle, 0.4, step=0.1)[-1]
    forces = [needle.path(pushed, np.linspace(0.4, 0.39, n + 1)[1:])[-1].force for n in (1, 2, 4, 32)]
    errors = np.abs(np.array(forces[:3]) - forces[3]) / pushed.force
    assert errors[0] < 0.05
    assert errors[0] > 1.5 * errors[1] > 2.2 * errors[2]


# Relaxation


@pytest.mark.slow
def test_under_hold_points_stick_and_the_force_falls_as_the_series_says():
    """Everything relaxes alike after a push of no time: tissue stays, and every force falls by one factor."""
    needle = made(relaxing=True)
    state = pushed = run(needle, 0.35, step=0.05)[-1]
    for second in range(1, 11):
        state = needle.step(state, 0.35, 1.0)
        assert state.force == pytest.approx(modulus(second) * pushed.force, rel=1e-6)
        assert largest_difference(state.displacement, pushed.displacement) < 1e-6


def test_a_point_that_sticks_to_a_steady_needle_pulls_with_the_integral_of_the_series():
    needle, state, compliance = grip(relaxing=True, bounds=1.0)
    speed, dt, start = 0.01, 0.25, state.force
    left = state.travel
    for step in range(1, 9):
        state = needle.step(state, left + step * dt * speed, dt)
        time = step * dt
        integral = (1 - FRACTIONS.sum()) * time + FRACTIONS * TIMES @ (1 - np.exp(-time / TIMES))
        assert state.force == pytest.approx(start * modulus(time) + speed * integral / compliance, rel=1e-9)


@pytest.mark.slow
def test_relaxing_tissue_by_tissue_stays_between_its_fractions():
    tissue, tissues = ss.Tissue(ss.Grid.unit_cube(9)), labelled_cube("layers", voxels=24)
    shear = tissues.moduli(tissue.grid).shear
    share = 0.15 + 0.35 * (shear > 1.5 * shear.min())
    needle = made(body=StepwiseTissue(tissue, tissues, times=TIMES, fractions=np.stack([share, share / 2])))
    pushed = run(needle, 0.4, step=0.1)[-1]
    held = needle.path(pushed, [0.4] * 10, 1.0)[-1]

    def left(share):
        return 1 - 1.5 * share + share * np.exp(-10 / 0.5) + share / 2 * np.exp(-10 / 10.0)

    assert left(0.5) < held.force / pushed.force < left(0.15)
    assert 1e-4 < largest_difference(held.displacement, pushed.displacement) < 0.15
    assert held.contact.cut == pushed.contact.cut


# Symmetries and values


def test_the_compliance_is_symmetric_and_positive():
    compliance = made(name="layers")._shaft(0.0).compliance
    assert largest_difference(compliance, compliance.T) < 1e-11
    assert np.linalg.eigvalsh(compliance).min() > -1e-12 * compliance.max()


def test_a_mirrored_needle_moves_tissue_to_the_mirrored_places():
    needle, flip = made(), np.array([1, -1, 1])
    mirrored = StepwiseNeedle(
        needle.body,
        entry=ENTRY * flip + (0, 1, 0),
        points=needle.points * flip + (0, 1, 0),
        width=WIDTH,
        bounds=FRICTION * APART,
        cutting=CUTTING,
    )
    one, other = (run(which, 0.3, 0.28, step=0.1)[-1].displacement for which in (needle, mirrored))
    assert largest_difference(other[:, ::-1] * flip, one) < 1e-7


@pytest.mark.slow
def test_twice_the_stiffness_and_twice_the_forces_are_the_same_motion():
    doubled = StepwiseTissue(ss.Tissue(ss.Grid.unit_cube(9)), ss.Material(2.0))
    soft, stiff = made(), made(body=doubled, bounds=2 * FRICTION * APART, cutting=2 * CUTTING)
    one, other = (run(which, 0.3, 0.28, step=0.1)[-1] for which in (soft, stiff))
    assert largest_difference(other.displacement, one.displacement) < 1e-7
    assert other.force == pytest.approx(2 * one.force, rel=1e-7)


def test_a_step_changes_no_state_and_equal_steps_give_equal_states():
    needle = made(nodes=7)
    state = run(needle, 0.2, step=0.1)[-1]
    before = pickle.dumps(state)
    one, other = needle.step(state, 0.15), needle.step(pickle.loads(before), 0.15)
    assert one == other
    assert one != state
    assert pickle.dumps(state) == before


WRONG = {
    "points": ({"depths": [0.2, 0.1]}, "points lie at depths"),
    "outside": ({"depths": [0.2, 1.4]}, r"points = .* lies outside the tissue"),
    "bounds": ({"bounds": -1.0}, "bounds = -1"),
    "number of bounds": ({"bounds": [1.0, 2.0, 3.0]}, "bounds has 3 values"),
    "kinetic": ({"kinetic": 1.0}, "kinetic = 1 is above static friction"),
    "width": ({"width": 0}, "width = 0"),
    "cutting": ({"cutting": np.nan}, "cutting = nan"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_needle_is_refused(case):
    arguments, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        made(nodes=5, **arguments)


def test_a_travel_out_of_the_tissue_is_refused():
    needle = made(nodes=5)
    with pytest.raises(ValueError, match=r"tip = .* lies outside the tissue"):
        needle.step(needle.rest, 2.0)
    with pytest.raises(ValueError, match="travel = nan"):
        needle.step(needle.rest, np.nan)


@pytest.mark.slow
def test_grids_of_thirteen_and_seventeen_nodes_agree_in_layers():
    """The law is of the tissue: what is left between two grids is their cells'."""
    forces = []
    for nodes in (13, 17):
        needle = made(nodes, "layers")
        forces.append([state.force for state in run(needle, *TURNS, step=0.025)])
    assert largest_difference(*np.array(forces)) < 0.05
