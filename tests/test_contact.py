"""A needle that remembers: friction sticks and slips, the tip cuts, membranes dent and break."""

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from real_anatomy import abdomen_cases
from sonospline.contact import Left, Punctured
from sonospline.elasticity import NotConvergedError, RelaxingSolver
from sonospline.mechanics import Material, Membrane, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticModel

TISSUE = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
ENTRY = np.array([0.0, 45.0, 52.0])
GEL = Material(10.0)


def needle(depth, entry=ENTRY, towards=(1.0, 0.0, 0.0)):
    return ss.Needle(entry, np.asarray(entry) + depth * np.asarray(towards))


def made(material=GEL, nodes=13**3, **options):
    return ElasticModel(TISSUE, material, nodes=nodes, contact="track", **options)


def driven(model, depths, state=None, dt=0.02):
    """The responses to a needle at some depths, one after the other."""
    state, found = model.rest if state is None else state, []
    for depth in depths:
        found.append(model.step(state, {"needle": needle(depth)}, dt))
        state = found[-1].state
    return found


def way(*depths, step=1.0):
    """From depth to depth in steps."""
    parts = [np.linspace(a, b, round(abs(b - a) / step) + 1)[1:] for a, b in pairwise(depths)]
    return np.concatenate(parts)


def axial(response):
    return response.forces["needle"].axial_n


def moved(response, x):
    return response.field.displacement(np.array([x, *ENTRY[1:]]))[0]


def test_a_needle_that_slides_all_along_meets_its_friction_and_cuts():
    last = driven(made(), way(0, 60))[-1]
    track = dict(last.state.tracks)["needle"]
    assert track.tip == pytest.approx(700.0)
    assert axial(last) == pytest.approx(0.7 + 0.03 * track.cut, rel=0.01)
    assert 55 < track.cut < 60  # the tissue ahead has gone with it


def test_all_of_the_shaft_that_is_in_the_cut_rubs():
    """What the tip comes past within a step does so at its end, in a fresh cut and in one that it comes back into."""
    for response in driven(made(reuse=1.0), way(0, 40, 22, 38, step=2.0), dt=0.1):
        track = dict(response.state.tracks)["needle"]
        if track.sliding.any() and (track.axial >= 0).all():
            assert track.axial.sum() / 30.0 == pytest.approx(track.lengths.sum(), abs=0.3)


def test_a_tip_that_cuts_on_in_tissue_that_relaxes_does_so_with_all_of_its_force():
    """It cuts no further within a step than the tissue's own answer lets it, and so is not pushed back."""
    model = made(replace(GEL, relaxation_exponent=0.3), relaxation="tissue")
    for response in driven(model, np.arange(6, 50, 6), dt=0.1)[2:]:
        assert dict(response.state.tracks)["needle"].tip == pytest.approx(700.0)


def test_pulled_back_a_little_the_tissue_goes_with_the_needle():
    model = made()
    inside = driven(model, way(0, 50))
    back = driven(model, way(50, 49.2, step=0.2), inside[-1].state)
    assert moved(inside[-1], 20.0) - moved(back[-1], 20.0) == pytest.approx(0.8, rel=0.05)


def test_a_needle_that_turns_back_takes_hardly_more_than_an_iteration_a_frame():
    """The field goes on as it last went, by what the compliance along the track says: a tenth of it a frame."""
    inside = driven(made(), [*way(0, 20), *way(20, 24, step=0.25)])[-1]
    back = driven(made(), way(24, 18, step=0.25), inside.state)
    assert sum(response.state.solution.iterations for response in back) <= 28  # of 24 frames; 45 from where it was
    assert max(response.error_estimate for response in back) < 0.02


def test_pulled_out_tissue_stands_outward_where_pushing_held_it_inward():
    found = driven(made(), way(0, 60, 40))
    pushed, pulled = found[59], found[-1]
    assert moved(pushed, 25.0) > 1.5
    assert moved(pulled, 25.0) < -1.0
    assert axial(pulled) < -0.5


def still(model, depth, state):
    """Held until nothing changes any more."""
    for _ in range(40):
        response = driven(model, [depth], state)[-1]
        if response.settled:
            return response
        state = response.state
    raise AssertionError("a needle that is held does not come to rest")


@pytest.mark.parametrize("static", [1.5, 5.0], ids=["gel", "layers"])
def test_an_elastic_loop_closes(static):
    """Where nothing slips and nothing cuts, pulled back a little and pushed on again changes nothing."""
    model = made(replace(GEL, static_friction=static) if static < 2 else layered(static_friction=static))
    there = still(model, 44.8, driven(model, [*way(0, 45), *way(45, 44.8, step=0.1)])[-1].state)
    loop = driven(model, way(44.8, 44.6, 44.8, step=0.05), there.state)
    again = still(model, 44.8, loop[-1].state)
    before, after = (dict(response.state.tracks)["needle"] for response in (there, again))
    stuck = before.lengths > before.apart / 2  # what the tip has hardly reached holds hardly anything
    assert not before.sliding.any() and np.abs(after.anchors - before.anchors)[stuck].max() < 1e-5
    in_it = np.abs(loop[3].field.on_grid() - there.field.on_grid()).max()
    assert in_it == pytest.approx(0.2, rel=0.1)
    assert np.abs(again.field.on_grid() - there.field.on_grid()).max() < 1e-3 * in_it
    assert np.abs(loop[-1].field.on_grid() - there.field.on_grid()).max() < 0.03 * in_it
    assert axial(again) == pytest.approx(axial(there), rel=1e-4)


def test_the_force_of_a_needle_that_is_held_stays():
    """What the compliance has wrong must not grow from step to step."""
    model = made(labelled_cube("layers", side=100, stiffness_kpa=10))
    there = driven(model, [*way(0, 45), *way(45, 44.5, step=0.1), *[44.5] * 4])[-1]
    held = driven(model, [44.5] * 60, there.state)[-1]
    assert axial(held) == pytest.approx(axial(there), rel=5e-3)
    assert held.settled
    assert driven(model, [44.5], held.state)[-1].state == held.state


def test_back_in_its_own_track_a_needle_meets_less_until_it_cuts_on():
    found = driven(made(), way(0, 50, 25, 54))
    first, again, on = found[44], found[25 + 50 + 19], found[-1]
    assert axial(again) < 0.7 * axial(first)
    assert dict(again.state.tracks)["needle"].tip == 0.0
    assert dict(on.state.tracks)["needle"].tip == pytest.approx(700.0)


@pytest.mark.slow
def test_reuse_one_is_a_track_that_is_as_tight_as_at_first():
    found = driven(made(reuse=1.0), way(0, 50, 25, 54))
    assert axial(found[-1]) == pytest.approx(axial(found[49]) + 0.03 * 4, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("parts", [1, 3, 24])
def test_the_answer_depends_little_on_the_steps_of_the_hand(parts):
    model = made()
    many = driven(model, way(0, 48, step=0.5))[-1]
    few = driven(model, [*way(0, 48, step=48 / parts), *[48.0] * 5])[-1]
    assert axial(few) == pytest.approx(axial(many), rel=0.02)
    apart = np.linalg.norm(few.field.on_grid() - many.field.on_grid(), axis=-1).mean()
    assert apart < 0.03 * np.linalg.norm(many.field.on_grid(), axis=-1).mean()


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(depths=st.lists(st.floats(2.0, 60.0), min_size=1, max_size=4))
def test_whatever_the_hand_does_forces_are_within_their_bounds_and_states_keep(depths):
    model = made()
    state = model.rest
    for depth in depths:
        before = pickle.dumps(state)
        response = model.step(state, {"needle": needle(depth)}, 0.1)
        assert pickle.dumps(state) == before
        again = model.step(pickle.loads(before), {"needle": needle(depth)}, 0.1)
        assert again.state == response.state
        state, track = response.state, dict(response.state.tracks)["needle"]
        assert (np.abs(track.axial) <= 30.0 * track.lengths + 0.02 * 30.0 * track.apart).all()
        assert 0.0 <= track.tip <= 700.001
        assert np.isfinite(response.field.on_grid()).all()


@pytest.mark.slow
def test_the_hand_s_work_is_never_negative_in_a_closed_loop():
    """Friction takes energy: into the tissue and back out the needle does work."""
    found = driven(made(), [*way(0, 40, 5)])
    depths = way(0, 40, 5)
    work = sum(0.5 * (axial(a) + axial(b)) * (y - x) for a, b, x, y in
               zip(found, found[1:], depths, depths[1:], strict=False))  # fmt: skip
    assert work > 10  # N mm


SKIN = Membrane("skin", around=["*"], rupture_force_n=2.0)


def layered(*membranes, **changes):
    cube = labelled_cube("layers", side=100, stiffness_kpa=10)
    named = ss.LabelMap(voxels=cube.labels.voxels, spacing=cube.labels.spacing, origin=cube.labels.origin,
                        names={0: "fat", 1: "muscle", 2: "organ"})  # fmt: skip
    materials = {label: Material(m.stiffness_kpa, m.poissons_ratio, **changes) for label, m in cube.materials.items()}
    return TissueMap(named, materials, membranes)


def test_skin_dents_then_breaks_and_the_tip_jumps_in():
    found = driven(made(layered(SKIN)), way(0, 40, step=0.5))
    broken = next(k for k, response in enumerate(found) if response.events)
    assert found[broken].events == (Punctured("needle", "skin", 2.0),)
    before, after = (dict(found[k].state.tracks)["needle"] for k in (broken - 1, broken))
    assert before.cut == 0.0 and before.tip > 1800
    assert after.cut > 0.5 * needle(0.5 * (broken + 1)).depth
    assert axial(found[broken]) < 0.75 * axial(found[broken - 1])


@pytest.mark.slow
def test_an_organ_s_capsule_is_met_at_its_face_and_at_its_back():
    capsule = Membrane("capsule", around=["muscle"], rupture_force_n=1.2)
    found = driven(made(layered(capsule)), way(0, 80, 5, step=1.0))
    said = [event for response in found for event in response.events]
    names = [type(event) for event in said]
    assert names.count(Punctured) >= 1
    assert all(event.membrane == "capsule" for event in said)
    assert Left("needle", "capsule") in said


@pytest.mark.slow
def test_dents_are_those_of_a_pressed_half_space():
    """Mindlin's solution under the Gaussian of the load, folded at the face: in closed form, for a large box."""
    side = 300.0
    tissue = ss.Tissue(ss.Grid(shape=(13, 13, 13), spacing=side / 12))
    model = ElasticModel(tissue, Material(10.0), nodes=33**3, contact="track")
    entry = np.array([0.0, side / 2, side / 2])
    response = model.settle(
        model.step(model.rest, {"needle": ss.Needle(entry, entry + np.array([0.5, 0, 0]))}), tolerance=2e-3
    )
    width, ratio = model.load.finest_length, 0.45
    per_n = 1e3 * (1 + ratio) / (2 * np.pi * 10.0) * np.sqrt(2 / np.pi) / width * (2 * (1 - ratio) + 1 / 3)
    assert 0.5 / response.forces["needle"].axial_n == pytest.approx(per_n, rel=0.1)


@pytest.mark.slow
def test_faster_hands_break_membranes_at_less_where_the_rate_is_negative():
    tissues = layered(Membrane("skin", around=["*"], rupture_force_n=2.0, rate=-0.2))
    forces = [next(e for r in driven(made(tissues), way(0, 30), dt=dt) for e in r.events).force_n for dt in (1.0, 0.01)]
    assert forces[0] > 2.0 > forces[1]


@pytest.mark.slow
def test_static_friction_holds_more_than_it_gives_way_to():
    model = made(Material(10.0, static_friction=1.5))
    inside = driven(model, way(0, 40))[-1]
    held = driven(model, [40.0] * 3, inside.state)[-1]
    pulled = driven(model, way(40, 30, step=0.25), held.state)
    forces = np.array([axial(response) for response in pulled])
    assert forces.min() < 1.1 * forces[-1]  # it holds on, then lets go


@pytest.mark.slow
def test_viscous_friction_grows_with_the_speed_of_the_hand():
    model = made(Material(10.0, viscous_friction=0.001))
    slow, fast = (axial(driven(model, way(0, 40), dt=dt)[-1]) for dt in (1.0, 0.02))
    assert fast > slow + 0.5 * 0.001 * 50 * 40


def test_a_needle_that_is_turned_meets_force_sideways_and_takes_tissue_along():
    model = made()
    inside = driven(model, way(0, 50))[-1]
    state = inside.state
    for angle in np.linspace(0.01, 0.06, 6):
        turned = needle(50.0, towards=(np.cos(angle), np.sin(angle), 0.0))
        response = model.step(state, {"needle": turned}, 0.02)
        state = response.state
    response = model.settle(response, tolerance=0.02)
    assert response.forces["needle"].lateral_n > 0.2
    tip = needle(45.0, towards=(np.cos(0.06), np.sin(0.06), 0.0)).tip
    now = response.field.inverse(tip[None])[0]
    assert abs(now[1] - ENTRY[1]) < 0.5 * abs(tip[1] - ENTRY[1])  # what was on the axis is near it still
    assert abs(response.forces["needle"].moment_nmm[2]) > 5


def test_two_needles_have_two_tracks():
    model, state = made(), None
    state = model.rest
    for depth in way(0, 30, step=2.0):
        response = model.step(state, {"a": needle(depth), "b": needle(depth, entry=(0.0, 70.0, 52.0))}, 0.02)
        state = response.state
    assert len(state.tracks) == 2
    assert response.forces["a"].axial_n == pytest.approx(response.forces["b"].axial_n, rel=0.1)
    one = model.step(state, {"a": needle(30.0)})
    assert len(one.state.tracks) == 1
    assert model.step(one.state, {}).state == model.rest


def test_a_needle_put_in_elsewhere_begins_a_new_track():
    model = made()
    inside = driven(model, way(0, 40))[-1]
    other = model.step(inside.state, {"needle": needle(20.0, entry=(0.0, 70.0, 60.0))})
    assert dict(other.state.tracks)["needle"].cut < 20
    np.testing.assert_allclose(dict(other.state.tracks)["needle"].places[0], (0, 70, 60))


@pytest.mark.slow
def test_a_fluid_neither_rubs_nor_resists():
    cube = labelled_cube("layers", side=100, stiffness_kpa=10)
    materials = {**cube.materials, 0: Material(10.0), 1: Material(10.0, fluid=True)}
    model = made(TissueMap(cube.labels, materials))
    forces = [axial(response) for response in driven(model, way(0, 80, step=2.0))]
    assert np.isfinite(forces).all()


def test_in_tissue_that_relaxes_the_force_of_a_held_needle_falls_and_tissue_stays():
    model = made(Material(10.0, relaxation_exponent=0.15), nodes=11**3, relaxation="tissue")
    inside = driven(model, way(0, 40, step=2.0), dt=0.2)[-1]
    held = driven(model, [40.0] * 10, inside.state, dt=1.0)[-1]
    assert axial(held) < 0.9 * axial(inside)
    assert moved(held, 20.0) == pytest.approx(moved(inside, 20.0), rel=0.15)
    assert not held.settled
    at_once = model.step(inside.state, {"needle": needle(40.0)})
    assert axial(at_once) == pytest.approx(axial(inside), rel=0.02)


def test_what_creeps_little_in_a_frame_is_not_solved_for(monkeypatch):
    model = made(Material(10.0, relaxation_exponent=0.15), nodes=11**3, relaxation="tissue")
    inside = driven(model, way(0, 40, step=2.0), dt=0.2)[-1]
    solved, predicted = [], RelaxingSolver.predicted
    monkeypatch.setattr(RelaxingSolver, "predicted", lambda *given: solved.append(given) or predicted(*given))
    held = driven(model, [40.0] * 5, inside.state, dt=1 / 60)
    assert not solved
    driven(model, [40.0], inside.state, dt=1.0)
    assert len(solved) == 1
    monkeypatch.setattr(RelaxingSolver, "growth", lambda *given: np.inf)
    as_solved = driven(model, [40.0] * 5, inside.state, dt=1 / 60)
    assert axial(held[-1]) == pytest.approx(axial(as_solved[-1]), rel=2e-3)
    assert axial(inside) - axial(held[-1]) > 0.02


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Material(10.0, static_friction=0.5), "static_friction = 0.5 is below 1"),
        (lambda: Material(10.0, friction_n_per_mm=-1), "friction_n_per_mm"),
        (lambda: Material(10.0, viscous_friction=-1), "viscous_friction"),
        (lambda: Membrane("skin", ["*"], 0.0), "rupture_force_n"),
        (lambda: Membrane("skin", "kidney", 1.0), "around = 'kidney' is no list"),
        (lambda: Membrane("skin", [], 1.0), "around"),
        (lambda: Membrane("skin", ["*"], 1.0, rate=-1.0), "rate = -1"),
        (lambda: layered(Membrane("capsule", ["kidney"], 1.0)), "membrane 'capsule': around"),
        (lambda: ElasticModel(TISSUE, GEL, nodes=9**3, contact="friction"), "contact = 'friction'"),
        (lambda: made(reuse=-1), "reuse"),
        (lambda: ElasticModel(TISSUE, GEL, nodes=9**3, relaxation="tissue"), "give contact = 'track', too"),
        (lambda: made(relaxation="slow"), "relaxation = 'slow'"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(make, words):
    with pytest.raises(ValueError, match=words) as refused:
        make()
    assert "\n" not in str(refused.value)


def test_a_dt_that_jumps_by_a_minute_changes_little_without_time():
    model = made()
    inside = driven(model, way(0, 30))[-1]
    later = model.step(inside.state, {"needle": needle(30.0)}, 60.0)
    assert axial(later) == pytest.approx(axial(inside), rel=0.02)


def test_a_step_that_loses_the_tissue_raises_and_leaves_the_state(monkeypatch):
    model = made(nodes=9**3)
    inside = driven(model, way(0, 20, step=2.0))[-1]
    before = pickle.dumps(inside.state)
    monkeypatch.setattr("sonospline.models.elastic.in_time._LOST", 1e-12)
    with pytest.raises(NotConvergedError, match="the last field is kept"):
        model.step(inside.state, {"needle": needle(30.0)}, 0.1)
    assert pickle.dumps(inside.state) == before


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ribs", "spine", "soft"])
def test_tracks_hold_in_a_real_abdomen(shared_data, kind):
    """In, held, out and in again: beside bone forces across the needle once grew from step to step."""
    for case in abdomen_cases(kind, faces=1):
        model = ElasticModel(case.tissue, case.tissues, nodes=15625, contact="track")
        state, found = model.rest, []
        for part in [*range(1, 61), *[60] * 5, *range(58, 10, -2), *range(12, 61, 2)]:
            found.append(model.step(state, {"needle": case.at(part / 60)}, 1 / 30))
            state = found[-1].state
            assert np.abs(state.solution.displacement).max() < 12
        forces = np.array([axial(response) for response in found])
        assert 0.5 < forces[59] < 5
        assert forces.min() < -0.5
        assert max(response.forces["needle"].lateral_n for response in found) < 2
        assert np.median([response.error_estimate for response in found]) < 0.03
