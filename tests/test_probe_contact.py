"""A probe pressed on elastic tissue: closed forms, scikit-fem, contact's own conditions, and energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

import sonospline as ss
from elastic_problems import system_of
from sonospline.elasticity import BackgroundMotion, ElasticSolver, FaceCompliance, ProbeContact, ProbeDents
from sonospline.elasticity.probe_dents import _simplex
from sonospline.fem.scikit_assembly import assemble
from sonospline.mechanics import Footprint, Material, Stiffening, labelled_cube

GEL = Material(10.0, 0.45)
BOX = ss.Tissue(ss.Grid.covering((100, 90, 60), nodes=9000), "z-")
SOLVER = ElasticSolver(BOX, GEL, nodes=1200)
CONTACT = ProbeContact(SOLVER, Footprint(40, 16))
DENTS = ProbeDents(CONTACT)


def facing_down(x, y, deep, turn=0.0, fan=0.0):
    place = ss.facing((x, y, deep), depth=(0, 0, 1), right=(1, 0, 0)).copy()
    place[:3, :3] = Rotation.from_euler("zx", [turn, fan], degrees=True).as_matrix() @ place[:3, :3]
    return place


def layer_force(side, depth, thickness, material):
    """Of a rigid square flat punch on a layer that is bonded to a rigid base.

    That of a disc of the same area, 2 E* a d, times 1.012 for a square (King, Int. J. Solids Struct. 23 (1987) 1657)
    and 1 + x + x^2 + x^3 for the layer, x = 2 a0 a / (pi h), a0 = int 1 - L(u) du with L the kernel of a bonded layer
    (Vorovich, Aleksandrov, Babeshko, Nonclassical mixed problems of elasticity, 1974).
    """
    nu, a = material.poissons_ratio, side / np.sqrt(np.pi)
    k, u = 3 - 4 * nu, np.linspace(1e-6, 30, 100_001)
    kernel = (2 * k * np.sinh(2 * u) - 4 * u) / (2 * k * np.cosh(2 * u) + 4 * u**2 + 1 + k**2)
    x = 2 * np.trapezoid(1 - kernel, u) * a / (np.pi * thickness)
    return 2 * 1.012 * material.stiffness_kpa / (1 - nu**2) * a * depth * (1 + x + x**2 + x**3) / 1000


@pytest.mark.slow
@pytest.mark.parametrize(("side", "held"), [(36, ()), (36, ("z+",)), (50, ("z+",))])
def test_a_flat_punch_on_a_thick_layer_takes_the_force_of_the_closed_form(side, held):
    tissue = ss.Tissue(ss.Grid.covering((240, 240, 80), nodes=9000), "z-", pinned_faces=held)
    contact = ProbeContact(ElasticSolver(tissue, GEL, nodes=8000), Footprint(side, side))
    dent = contact.dent(facing_down(120, 120, 2.0))
    assert dent.force_n == pytest.approx(layer_force(side, 2.0, 80, GEL), rel=0.1)
    assert (dent.pressure_kpa > 0).all()


@pytest.mark.slow
def test_the_compliance_of_the_face_is_that_of_scikit_fem():
    tissues = labelled_cube("layers", side=100, stiffness_kpa=10)
    solver = ElasticSolver(ss.Tissue(ss.Grid(shape=(13, 13, 13), spacing=100 / 12), "x+"), tissues, nodes=13**3)
    face, nodes = FaceCompliance(solver), [6 * 13 + 6, 6 * 13 + 7, 3 * 13 + 9, 0]
    free = np.flatnonzero(np.repeat(solver.free.ravel() > 0, 3))
    factor, exact = splu(assemble(system_of(solver)).free.tocsc()), np.zeros((4, 4))
    for column, node in enumerate(nodes):
        load = np.moveaxis(face.load(np.array([node]), np.ones(1)), 0, -1).ravel()
        found = np.zeros(load.size)
        found[free] = factor.solve(load[free].astype(float))
        exact[:, column] = face.into(np.moveaxis(found.reshape(*solver.grid.shape, 3), -1, 0))[nodes]
    found = face.between(nodes)
    assert np.abs(found - exact).max() <= 1e-3 * exact.max()
    assert not found[3].any()  # a corner is held
    assert found[0, 0] > 0


@settings(max_examples=20, deadline=None)
@given(
    x=st.floats(20, 80), y=st.floats(20, 70), deep=st.floats(-1, 15), turn=st.floats(-90, 90), fan=st.floats(-25, 25)
)
def test_contact_neither_pulls_nor_lets_tissue_through(x, y, deep, turn, fan):
    place = facing_down(x, y, deep, turn, fan)
    dent = CONTACT.dent(place)
    where = CONTACT.footprint_at(place)
    depths = CONTACT.depth(where)
    assert (dent.pressure_kpa >= 0).all() and dent.force_n >= 0
    assert (dent.pressure_kpa[depths <= 0] == 0).all()
    on_face = CONTACT._on_face(where)
    pressed = CONTACT._inside(on_face) & (depths > 0)
    if pressed.any():
        nodes, weights = CONTACT._weights(on_face[pressed])
        gives_way = weights.T @ CONTACT.face.into(dent.displacement)[nodes]
        beyond = gives_way - depths[pressed]
        close = 0.01 * depths.max() + 1e-4
        assert beyond.min() > -close
        assert np.abs(beyond[dent.pressure_kpa[pressed] > 0]).max(initial=0) < close
    reaction = SOLVER.forces(dent.displacement)[:, SOLVER.free == 0].sum(axis=1)
    assert -reaction[2] / 1000 == pytest.approx(dent.force_n, abs=2e-3 * max(dent.force_n, 0.1))


def test_a_tilted_probe_lifts_off_on_one_side():
    dent = CONTACT.dent(facing_down(50, 45, 1.0, fan=20))
    across = CONTACT.footprint.points(1.08 * max(CONTACT._spacing))[:, 2]
    assert 0 < (dent.pressure_kpa > 0).mean() < 1
    assert abs((dent.pressure_kpa * across).sum()) > 0


@pytest.mark.parametrize("footprint", [Footprint(40, 16), Footprint(50, 20, radius_mm=40)])
def test_the_work_of_the_probe_is_the_energy_stored_in_tissue(footprint):
    contact = ProbeContact(SOLVER, footprint)
    depths = np.linspace(0, 12, 25)
    dents = [contact.dent(facing_down(50, 45, deep)) for deep in depths]
    work = np.trapezoid([dent.force_n for dent in dents], depths)
    assert work == pytest.approx(dents[-1].energy_mj, rel=0.01)
    strain_energy = np.vdot(dents[-1].displacement, SOLVER.forces(dents[-1].displacement)) / 2000
    assert dents[-1].energy_mj == pytest.approx(strain_energy, rel=0.01)


def test_twice_as_deep_is_twice_as_hard_where_a_flat_probe_lies_flat():
    one, two = (CONTACT.dent(facing_down(50, 45, deep)) for deep in (3.0, 6.0))
    assert two.force_n == pytest.approx(2 * one.force_n, rel=1e-3)
    assert two.energy_mj == pytest.approx(4 * one.energy_mj, rel=1e-3)


def test_a_convex_probe_touches_more_the_deeper_it_is():
    contact = ProbeContact(SOLVER, Footprint(60, 20, radius_mm=40))
    shallow, deep = (contact.dent(facing_down(50, 45, depth)) for depth in (3, 12))
    assert (shallow.pressure_kpa > 0).sum() < (deep.pressure_kpa > 0).sum()
    assert deep.force_n > 4.5 * shallow.force_n  # stiffer than in proportion


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(x=st.floats(40, 60), y=st.floats(40, 50), deep=st.floats(2, 10), step=st.floats(0, 0.2))
def test_a_blend_is_near_the_dent_and_moves_without_a_jump(x, y, deep, step):
    exact = CONTACT.dent(facing_down(x, y, deep))
    blend = DENTS.at(facing_down(x, y, deep))
    assert len(blend.parts) <= 8 and 0.99 < sum(weight for weight, _ in blend.parts) < 1.01
    assert blend.force_n == pytest.approx(exact.force_n, rel=0.06)
    moved = DENTS.at(facing_down(x + step, y, deep))
    assert abs(moved.force_n - blend.force_n) <= 0.05 * step * exact.force_n + 1e-9
    total, beyond = (sum(w * dent.displacement for w, dent in one.parts) for one in (blend, moved))
    assert np.abs(beyond - total).max() <= 0.5 * deep * step + 1e-6


def test_dents_do_not_depend_on_what_was_solved_before():
    place = facing_down(51, 44, 5)
    fresh = ProbeDents(ProbeContact(SOLVER, Footprint(40, 16))).at(place)
    again = DENTS.at(place)
    assert all(a == b and np.array_equal(c.displacement, d.displacement)
               for (a, c), (b, d) in zip(fresh.parts, again.parts, strict=True))  # fmt: skip


@settings(max_examples=15, deadline=None)
@given(force=st.floats(0, 8), deep=st.floats(-5, 10))
def test_a_force_presses_as_deep_as_it_is_answered(force, deep):
    blend = DENTS.at(facing_down(50, 45, deep), force)
    assert blend.force_n == pytest.approx(force, abs=1e-6)


def test_where_little_of_a_probe_is_on_the_skin_only_that_touches():
    dent = CONTACT.dent(facing_down(2, 45, 4))
    assert 0 < (dent.pressure_kpa > 0).mean() < 0.5


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: CONTACT.dent(facing_down(-3, 45, 4)), "beyond the skin, face z- of the box; slide it back"),
        (lambda: DENTS.at(facing_down(50, 95, 4)), "beyond the skin, face z- of the box; slide it back"),
        (
            lambda: CONTACT.dent(facing_down(50, 45, 21)),
            "presses 21 mm deep; give at most 20 mm, a third of the tissue",
        ),
        (lambda: DENTS.at(facing_down(50, 45, 0), 34.5), "force_n = 34.5 presses deeper than a third of the tissue"),
        (lambda: Footprint(0, 5), "length_mm = 0 is out of range; give a finite number above zero"),
        (lambda: Footprint(60, 5, 20), "radius_mm = 20 is below half of length_mm = 60"),
        (
            lambda: FaceCompliance(ElasticSolver(ss.Tissue(BOX.grid, "z-", ("z-",)), GEL, nodes=1000)),
            "pins its entry face z-; give one that is free",
        ),
    ],
)
def test_what_cannot_press_is_refused_in_a_line(act, said):
    with pytest.raises(ValueError) as error:
        act()
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.slow
def test_a_vessel_under_the_probe_is_flattened():
    """Round at rest, 8 mm wide at 20 mm depth: its section, from the displacement of points around it."""
    solver = ElasticSolver(BOX, GEL, nodes=15625)
    dent = ProbeContact(solver, Footprint(40, 16)).dent(facing_down(50, 45, 10.0))
    field = ss.GridField(BOX.grid, np.moveaxis(dent.displacement, 0, -1), lattice=solver.grid, order=3)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rest = np.column_stack([50 + 4 * np.cos(angle), np.full(60, 45.0), 20 + 4 * np.sin(angle)])
    now = field.forward(rest)
    height, width = np.ptp(now[:, 2]), np.ptp(now[:, 0])
    assert _area(now) < 0.97 * _area(rest)
    assert height < 0.9 * 8 and height < 0.9 * width
    assert now[:, 2].mean() > 22  # and pushed down


def _area(points):
    x, z = points[:, 0], points[:, 2]
    return abs(x @ np.roll(z, -1) - z @ np.roll(x, -1)) / 2


STIFF = ProbeContact(SOLVER, Footprint(50, 20, radius_mm=40), Stiffening(3.0))
SOFT = ProbeContact(SOLVER, Footprint(50, 20, radius_mm=40))


def test_stiffer_tissue_has_the_same_dent_and_its_force_is_the_derivative_of_its_energy():
    depths = np.linspace(0, 16, 65)
    stiff, soft = ([contact.dent(facing_down(50, 45, deep)) for deep in depths] for contact in (STIFF, SOFT))
    assert np.array_equal(stiff[-1].displacement, soft[-1].displacement)
    force, energy = (np.array([getattr(dent, name) for dent in stiff]) for name in ("force_n", "energy_mj"))
    assert (np.diff(force) >= 0).all() and force[-1] > 2 * soft[-1].force_n
    assert np.trapezoid(force, depths) == pytest.approx(energy[-1], rel=0.01)
    np.testing.assert_allclose(np.gradient(energy, depths)[8:-1], force[8:-1], rtol=0.05)
    assert stiff[1].force_n == pytest.approx(soft[1].force_n, rel=0.01), "at first it is linear"
    pressure = stiff[-1].pressure_kpa.sum() * STIFF._part / 1000
    assert pressure == pytest.approx(stiff[-1].force_n, rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(numbers=st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_a_place_is_the_mean_of_the_corners_of_its_simplex(numbers):
    corners = _simplex(tuple(numbers))
    weights = np.array([weight for weight, _ in corners])
    assert len(corners) <= 7 and (weights > 0).all()
    assert weights.sum() == pytest.approx(1)
    assert weights @ np.array([corner for _, corner in corners]) == pytest.approx(numbers, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(turn=st.floats(-180, 180), fan=st.floats(-60, 60), rock=st.floats(-30, 30), x=st.floats(20, 80))
def test_a_pose_is_known_by_its_numbers(turn, fan, rock, x):
    place = facing_down(x, 40, 3, turn, fan)
    place[:3, :3] = place[:3, :3] @ Rotation.from_euler("z", rock, degrees=True).as_matrix()
    assert DENTS._pose(DENTS._place(place)) == pytest.approx(place, abs=1e-5)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Stiffening(0.0), "energy_mj_cm2 = 0.0 is out of range; give a finite number above zero"),
        (lambda: BackgroundMotion(SOLVER, stiffening=4.0), "stiffening = 4.0 is not a Stiffening; make one"),
    ],
)
def test_what_is_no_stiffening_is_refused_in_a_line(make, said):
    with pytest.raises(ValueError) as error:
        make()
    assert said in str(error.value) and "\n" not in str(error.value)
