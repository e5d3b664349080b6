"""Breathing and the pressed probe as a background: what it is made of, what it costs, and what the kidney does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline.elasticity import Background, BackgroundMotion, ElasticSolver, ProbeContact, carried_by_diaphragm
from sonospline.mechanics import ORGAN_RATIO, Breathing, Footprint, LineForce, Material, Spread
from sonospline.simulator import SceneError, SceneFile, make_scene, scene_motion

GEL = Material(10.0)
BOX = ss.Tissue(ss.Grid.covering((120, 100, 60), nodes=9000, origin=(5, -10, 2)), "z-")
SOLVER = ElasticSolver(BOX, GEL, nodes=1500)
ORGAN = BOX.grid.world(np.array([(60.0, 50, 40), (70, 50, 30), (50, 40, 35)]))
MOTION = BackgroundMotion(
    SOLVER, breathing=Breathing(seed=3), cranial_face="x-", organ=ORGAN, footprint=Footprint(40, 16)
)


def probe(x, y, deep):
    return ss.facing(BOX.grid.world((x, y, deep)), depth=(0, 0, 1), right=(1, 0, 0))


def test_a_frame_is_the_excursion_times_the_unit_field_and_the_dents_around_the_probe():
    t, place = 2.3, probe(60.7, 50.2, 6.3)
    background = MOTION.at(t, place)
    blend = MOTION._dents.at(place)
    brute = MOTION.breathing.excursion(t) * MOTION.carried.astype(float)
    brute += sum(weight * dent.displacement.astype(float) for weight, dent in blend.parts)
    assert np.abs(background.displacement - brute).max() < 1e-4
    assert len(blend.parts) <= 8  # each one multiplication and addition a number
    assert background.probe_force_n == blend.force_n > 0
    assert background.excursion_mm == MOTION.breathing.excursion(t)


@settings(max_examples=30, deadline=None)
@given(t=st.floats(0, 1000), x=st.floats(55, 60), deep=st.floats(-1, 6))
def test_it_is_a_pure_function_of_time_and_pose(t, x, deep):
    once = MOTION.at(t, probe(x, 50, deep))
    MOTION.at(2 * t, probe(x + 2, 50, 3))
    assert MOTION.at(t, probe(x, 50, deep)) == once
    assert not once.displacement.flags.writeable


def test_nothing_moves_at_rest():
    assert MOTION.at(0.0) is MOTION.rest and not MOTION.rest.displacement.any()
    assert BackgroundMotion(SOLVER).at(12.0, probe(60, 50, 5)) == MOTION.rest


def test_the_organ_moves_its_part_of_the_excursion_and_the_skin_does_not():
    field = MOTION.field(MOTION.at(1.9))
    along = field.displacement(ORGAN)[:, 0]
    assert along.mean() == pytest.approx(ORGAN_RATIO * MOTION.breathing.excursion(1.9), rel=1e-3)
    assert np.abs(MOTION.carried[..., 0]).max() == 0


@pytest.mark.parametrize(("face", "direction"), [("x-", (1, 0, 0)), ("x+", (-1, 0, 0)), ("y+", (0, -1, 0))])
def test_tissue_moves_away_from_the_head(face, direction):
    field = carried_by_diaphragm(SOLVER, face, ORGAN, ratio=0.5)
    moved = BackgroundMotion(SOLVER).field(Background(field)).displacement(ORGAN)
    assert (moved @ direction).mean() == pytest.approx(0.5, rel=1e-3)


def test_in_a_turned_box_it_is_the_same_motion_turned():
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    grid = ss.Grid(shape=BOX.grid.shape, spacing=BOX.grid.spacing, origin=(1, 2, 3), direction=turn)
    solver = ElasticSolver(ss.Tissue(grid, "z-"), GEL, nodes=1500)
    organ = grid.world(BOX.grid.local(ORGAN))
    motion = BackgroundMotion(
        solver, breathing=Breathing(seed=3), cranial_face="x-", organ=organ, footprint=Footprint(40, 16)
    )
    place = np.eye(4)
    place[:3, :3] = turn @ probe(60, 50, 6)[:3, :3]
    place[:3, 3] = grid.world(BOX.grid.local(probe(60, 50, 6)[:3, 3]))
    turned, upright = motion.at(1.9, place), MOTION.at(1.9, probe(60, 50, 6))
    assert turned.probe_force_n == pytest.approx(upright.probe_force_n, rel=1e-3)
    expected = MOTION.field(upright).displacement(ORGAN) @ turn.T
    assert motion.field(turned).displacement(organ) == pytest.approx(expected, abs=5e-3)


def test_a_held_breath_solves_nothing_again():
    held = MOTION.breathes(MOTION.breathing.held(1.0))
    assert held.carried is MOTION.carried and held.at(0.5) == MOTION.at(0.5)
    drifted = held.at(1.0).excursion_mm - held.at(25.0).excursion_mm
    assert drifted == pytest.approx(5.6)


def test_a_needle_in_breathing_tissue_is_composed_and_not_added():
    needle = ss.Needle(BOX.grid.world((60, 50, 0)), BOX.grid.world((60, 50, 45)))
    inner = SOLVER.field(SOLVER.solve(LineForce.for_cube(60), needle))
    large = BackgroundMotion(SOLVER, breathing=Breathing(*_alike(30)), cranial_face="x-", organ=ORGAN)
    field = ss.CarriedField(inner, large.field(large.at(2.0)))
    on_path = BOX.grid.world(np.column_stack([np.full(5, 60), np.full(5, 50), np.linspace(5, 45, 5)]))
    back = field.inverse(field.forward(on_path))
    assert back == pytest.approx(on_path, abs=1e-3)
    assert field.smallest_jacobian() > 0
    rest = field.at_rest(np.stack([needle.entry, needle.tip]))
    assert rest[0] == pytest.approx(needle.entry, abs=0.05)  # the skin is held, so that the entry stays a point of it
    assert 10 < np.linalg.norm(rest[1] - needle.tip) < 40


@settings(max_examples=30, deadline=None)
@given(t=st.floats(0, 60), x=st.floats(20, 100), y=st.floats(20, 80), deep=st.floats(0, 3), tip=st.floats(5, 50))
def test_a_needle_at_rest_is_through_the_tissue_that_its_tip_is_in(t, x, y, deep, tip):
    now = MOTION.at(t, probe(60, 50, deep))
    field, world = MOTION.field(now), BOX.grid.world
    needle = ss.Needle(world((x, y, 0)), world((60, 50, tip)))
    rest = MOTION.at_rest(now, needle)
    assert field.forward(rest.tip) == pytest.approx(needle.tip, abs=1e-3)
    BOX.check_inside(entry=rest.entry, tip=rest.tip)
    met = field.forward(rest.entry) - needle.entry
    aside = met - (met @ needle.direction) * needle.direction
    assert np.linalg.norm(aside) < 0.5  # where the needle meets the dent is a place on its axis
    assert MOTION.at_rest(MOTION.rest, needle) is needle


def test_a_needle_that_does_not_reach_the_dented_skin_is_not_in_tissue():
    now = MOTION.at(0.0, probe(60, 50, 5))
    assert MOTION.at_rest(now, ss.Needle(BOX.grid.world((60, 50, 0)), BOX.grid.world((60, 50, 2)))) is None


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (
            lambda: BackgroundMotion(SOLVER, breathing=Breathing(*_alike(500)), cranial_face="x-", organ=ORGAN),
            "breathing.excursion_mm reaches 500 mm, at which tissue in a box of [120.0, 100.0, 60.0] mm folds; give at",
        ),
        (lambda: BackgroundMotion(SOLVER, breathing=Breathing()), "breathing needs cranial_face and organ"),
        (lambda: BackgroundMotion(SOLVER, breathing=17), "breathing = 17 is not a Breathing"),
        (lambda: BackgroundMotion(SOLVER, footprint=17), "footprint = 17 is not a Footprint"),
        (lambda: carried_by_diaphragm(SOLVER, "z-", ORGAN), "cranial_face = 'z-' is the entry face, the skin"),
        (lambda: carried_by_diaphragm(SOLVER, "head", ORGAN), "cranial_face = 'head' is not known"),
        (lambda: carried_by_diaphragm(SOLVER, "x-", [(0, 0, 900)]), "organ has 1 points, not all in the tissue"),
        (lambda: carried_by_diaphragm(SOLVER, "x-", [(60, 40, 2)]), "does not move with the face x-"),
        (lambda: MOTION.at(-1.0), "t = -1.0 is out of range"),
        (lambda: MOTION.at(1.0, probe(60, 50, 5), force_n=-2), "force_n = -2 is out of range"),
        (lambda: MOTION.at(1.0, force_n=2), "force_n = 2 presses nothing: probe_to_reference is missing"),
        (lambda: MOTION.at(1.0, probe(-9, 50, 5)), "beyond the skin, face z- of the box"),
        (lambda: MOTION.at(1.0, 2 * np.eye(4)), "probe_to_reference"),
        (lambda: MOTION.breathes(Breathing(*_alike(500))), "breathing.excursion_mm reaches 500 mm"),
        (lambda: BackgroundMotion(SOLVER).breathes(Breathing()), "breathing = None where this motion was made"),
    ],
)
def test_what_cannot_move_is_refused_in_a_line(act, said):
    with pytest.raises(ValueError) as error:
        act()
    assert said in str(error.value) and "\n" not in str(error.value)


def _alike(height):
    return Spread(15, 0, 15, 15), Spread(height, 0, height, height)


@pytest.fixture(scope="module")
def kidney():
    """The shipped scene, its solver, and the points of its kidney."""
    scene = make_scene("kidney")
    solver = ElasticSolver(scene.tissue, scene.tissues, nodes=15625)
    named = [label for label, name in scene.tissues.labels.names.items() if "kidney" in name]
    points = scene.tissue.grid.points
    return scene, solver, points[np.isin(scene.tissues.labels_at(points), named)]


@pytest.mark.slow
def test_the_kidney_s_excursion_is_the_published_one(kidney):
    _, solver, organ = kidney
    motion = BackgroundMotion(solver, breathing=Breathing(seed=1), cranial_face="x-", organ=organ)
    unit = motion.field(Background(motion.carried)).displacement(organ).mean(axis=0)
    peaks = []
    for seed in range(20):
        t = np.arange(0, 600, 0.05)
        s = Breathing(seed=seed).excursion(t)
        top = (s[1:-1] > s[:-2]) & (s[1:-1] >= s[2:])
        peaks.append(s[1:-1][top])
    excursion = np.concatenate(peaks) * np.linalg.norm(unit)
    low, median, high = np.quantile(excursion, (0.05, 0.5, 0.95))
    assert len(excursion) > 2000
    assert median == pytest.approx(11.0, abs=0.7)
    assert low >= 2.5 and high <= 20.5
    assert motion.field(Background(31.5 * motion.carried)).smallest_jacobian() > 0.3
    assert abs(unit[1]) < 0.1 * unit[0] and abs(unit[2]) < 0.4 * unit[0]


@pytest.mark.slow
def test_the_probe_on_the_flank_balances_its_work(kidney):
    _, solver, _ = kidney
    contact = ProbeContact(solver, Footprint(60, 20, radius_mm=60))
    depths = np.arange(0, 16.5, 0.5)
    dents = [contact.dent(ss.facing((58, 50, deep), depth=(0, 0, 1), right=(-1, 0, 0))) for deep in depths]
    assert np.trapezoid([dent.force_n for dent in dents], depths) == pytest.approx(dents[-1].energy_mj, rel=0.01)
    assert 5 < dents[-1].force_n < 35  # assumed stiffnesses, which do not grow with strain


@pytest.mark.slow
def test_a_scene_says_what_breathes_and_what_presses():
    scene = make_scene("kidney")
    solver = ElasticSolver(scene.tissue, scene.tissues, nodes=3000)
    motion = scene_motion(scene, solver, breathing=Breathing(seed=1), pressed=True)
    top = motion.at(1.6)
    field, target = motion.field(top), scene.targets["lower calyx"]
    assert field.displacement(target)[0] == pytest.approx(ORGAN_RATIO * top.excursion_mm, rel=0.5)
    pressed = motion.at(0.0, ss.facing((58, 50, 8), depth=(0, 0, 1), right=(-1, 0, 0)))
    assert pressed.probe_force_n > 0.5
    assert (
        scene_motion(scene, solver).at(1.6, ss.facing((58, 50, 8), depth=(0, 0, 1), right=(-1, 0, 0))).excursion_mm == 0
    )


def test_a_scene_without_breathing_cannot_breathe():
    scene = make_scene("gel")
    solver = ElasticSolver(scene.tissue, scene.tissues, nodes=1000)
    with pytest.raises(ValueError, match=r"scene 'Gel block with a vessel' says nothing of breathing; give its file"):
        scene_motion(scene, solver, breathing=Breathing())


def test_the_head_is_not_behind_the_skin():
    text = 'name = "x"\n[tissue]\nsource = "kidney"\n[breathing]\ncranial_face = "z-"\norgan = ["kidney *"]'
    with pytest.raises(SceneError, match=r"line 5: .*cranial_face = 'z-' is the skin; give the face to"):
        SceneFile.parse(text)
