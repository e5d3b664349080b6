"""What tissues resist, fitted to curves of force: known values come back, and what a curve cannot tell is said."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from sonospline import cli
from sonospline.contact.calibration import ForceCurve, Layer, fit_forces, force_along
from sonospline.contact.calibration.closed_form import tip_along
from sonospline.contact.calibration.least_squares import CUTTING, FASTER, FRICTION, RUPTURE, VISCOUS
from sonospline.contact.calibration.membranes_shown import falls
from sonospline.geometry import LabelMap
from sonospline.mechanics import Material, MaterialTable, Membrane, TissueMap
from sonospline.models.elastic import ElasticModel
from sonospline.simulator import SceneFile

DEPTHS = np.arange(0.3, 75, 0.3)
LAYERS = (
    Layer("fat", 0, 0.03, 0.35, 2.0, 0.2),
    Layer("muscle", 24, 0.055, 0.7, 0.0, 0.25),
    Layer("kidney", 48, 0.04, 0.9, 1.6, 0.25),
)


def measured(layers=LAYERS, noise=0.02, seed=0, depths=DEPTHS, **options):
    force = force_along(depths, layers) + noise * np.random.default_rng(seed).standard_normal(len(depths))
    return ForceCurve(depths, force, tuple((layer.tissue, layer.begin_mm) for layer in layers), **options)


def true(layers=LAYERS):
    return {
        (kind, layer.tissue): value
        for layer in layers
        for kind, value in zip((FRICTION, CUTTING, RUPTURE), layer[2:5], strict=True)
        if value
    }


def is_there(found, value, share=0.05):
    return abs(found.value - value) <= max(4 * found.error, share * abs(value))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
def test_known_values_come_back_from_a_noisy_curve(seed):
    fit = fit_forces([measured(seed=seed)])
    assert {key for key in fit.values if key[0] == RUPTURE} == {(RUPTURE, "fat"), (RUPTURE, "kidney")}
    for key, value in true().items():
        assert fit.values[key].known, key
        assert is_there(fit.values[key], value), (key, fit.values[key], value)
    assert fit.residual_n == pytest.approx(0.02, rel=0.25)
    assert fit.explained > 0.99


@pytest.mark.slow
@settings(max_examples=12)
@given(
    friction=st.tuples(*[st.floats(0.015, 0.08)] * 2),
    cutting=st.tuples(*[st.floats(0.2, 1.0)] * 2),
    rupture=st.floats(1.8, 4.0),
    border=st.floats(30.0, 45.0),
    seed=st.integers(0, 1000),
)
def test_whatever_the_values_are_they_come_back(friction, cutting, rupture, border, seed):
    layers = (
        Layer("fat", 0, friction[0], cutting[0], rupture, 0.25),
        Layer("muscle", border, friction[1], cutting[1], 0.0, 0.25),
    )
    fit = fit_forces([measured(layers, seed=seed)])
    for key, value in true(layers).items():
        assert is_there(fit.values[key], value, share=0.1), (key, fit.values[key], value)


def test_two_speeds_tell_what_depends_on_speed():
    curves = [
        measured(
            [
                layer._replace(
                    friction_n_per_mm=layer.friction_n_per_mm + 0.001 * speed,
                    rupture_force_n=layer.rupture_force_n * (1 - 0.1 * np.log(speed / 5)),
                )
                for layer in LAYERS[:1]
            ],
            speed_mm_s=speed, name=f"{speed:g}",
        )
        for speed in (2.0, 20.0)
    ]  # fmt: skip
    fit = fit_forces(curves)
    assert fit.values[VISCOUS, "fat"].value == pytest.approx(0.001, rel=0.05)
    assert fit.values[FRICTION, "fat"].value == pytest.approx(0.03, rel=0.05)
    assert fit.values[FASTER, "fat"].value / fit.values[RUPTURE, "fat"].value == pytest.approx(-0.1, rel=0.1)
    assert fit.untold == ()
    assert fit.materials(MaterialTable.assumed(), "x")["fat"].viscous_friction == pytest.approx(0.001, rel=0.05)


def test_what_a_curve_cannot_tell_is_said_and_stays_as_it_was():
    """A tissue that the tip jumps through, and one that is passed for too little."""
    layers = (Layer("skin", 0, 0.05, 0.6, 2.5, 0.2), Layer("fat", 1.5, 0.03, 0.4, 0.0, 0.2))
    fit = fit_forces([measured(layers)])
    assert not fit.values[CUTTING, "skin"].known
    assert not fit.values[FRICTION, "skin"].known
    assert fit.values[FRICTION, "fat"].value == pytest.approx(0.03, rel=0.1)
    assert "cutting force of skin, passed for 1.5 mm at most: nothing is known of it N" in fit.untold
    assert any(line.startswith("friction of skin, passed for 1.5 mm at most") for line in fit.untold)
    assert fit.untold[-1] == "viscous friction and the rate of rupture: give curves at two speeds or more"
    table = MaterialTable.assumed()
    found = fit.materials(table, "mine.csv")
    assert found["skin"] == table["skin"]
    assert found["fat"].source == "friction fitted to mine.csv; the rest assumed"  # skin's may be part of what cuts
    assert found["fat"].stiffness_kpa == table["fat"].stiffness_kpa


def test_noise_and_a_softer_tissue_are_no_membranes():
    layers = (Layer("muscle", 0, 0.05, 0.8, 0.0, 0.25), Layer("fat", 40, 0.02, 0.3, 0.0, 0.25))
    curve = measured(layers)
    assert falls(curve)  # the tip jumps ahead where less holds it
    assert not [key for key in fit_forces([curve]).values if key[0] == RUPTURE]
    flat = ForceCurve(DEPTHS, 1 + 0.02 * np.random.default_rng(0).standard_normal(len(DEPTHS)))
    assert falls(flat) == []


def test_errors_say_how_far_off_values_are():
    """Of a dozen curves of one tissue without a membrane: two thirds within one error, nearly all within two."""
    off = []
    for seed in range(12):
        fit = fit_forces([measured([Layer("fat", 0, 0.03, 0.35, 0.0, 0.25)], seed=seed, depths=np.arange(5, 60, 0.5))])
        found = fit.values[FRICTION, "fat"]
        off.append(abs(found.value - 0.03) / found.error)
    assert np.mean(np.array(off) < 1) > 0.4
    assert np.mean(np.array(off) < 2) > 0.8


@given(
    friction=st.floats(0.0, 0.1), cutting=st.floats(0.0, 2.0), rupture=st.floats(0.0, 4.0), stiffness=st.floats(0.05, 2)
)
def test_the_law_holds_what_it_says(friction, cutting, rupture, stiffness):
    layers = [Layer("fat", 0, friction, cutting, rupture, stiffness)]
    tip, force = tip_along(DEPTHS, layers), force_along(DEPTHS, layers)
    assert (np.diff(tip.cut_mm) >= -1e-9).all()
    assert (tip.cut_mm <= DEPTHS + 0.05).all()
    dents = rupture / stiffness - 0.1 > DEPTHS
    np.testing.assert_allclose(force[dents], stiffness * DEPTHS[dents], atol=1e-9)
    cuts = max(rupture, cutting) / stiffness + 0.2 < DEPTHS
    expected = friction * np.maximum(DEPTHS - cutting / stiffness, 0) + cutting
    np.testing.assert_allclose(force[cuts], expected[cuts], atol=0.06 * (friction + stiffness))


@pytest.mark.slow
def test_values_of_live_tissue_come_back():
    """What the closed form leaves out: friction takes tissue along, too, and cutting forces come out lower for it.

    In some draws of noise the fit does not find the inner membrane, or too small: in which depends on the last bits.
    """
    voxels = np.zeros((50, 50, 50), np.uint8)
    voxels[23:] = 1
    materials = {
        0: Material(6, friction_n_per_mm=0.02, cutting_force_n=0.3),
        1: Material(12, friction_n_per_mm=0.05, cutting_force_n=0.6),
    }
    labels = LabelMap(voxels=voxels, spacing=(2, 2, 2), names={0: "fat", 1: "muscle"})
    membranes = Membrane("skin", ["*"], 2.0), Membrane("capsule", ["muscle"], 1.5)
    tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    model = ElasticModel(tissue, TissueMap(labels, materials, membranes), nodes=17**3, contact="track")
    depths, forces, state = np.arange(0.5, 85, 0.5), [], model.rest
    for depth in depths:
        response = model.step(state, {"needle": ss.Needle((0, 50, 50), (depth, 50, 50))}, 0.1)
        state = response.state
        forces.append(response.forces["needle"].axial_n)
    noise = 0.02 * np.random.default_rng(4).standard_normal((8, len(forces)))
    boundaries = (("fat", 0.0), ("muscle", 45.0))
    fits = [fit_forces([ForceCurve(depths, noisy, boundaries)]).values for noisy in np.array(forces) + noise]
    for values in fits:
        assert values[FRICTION, "fat"].value == pytest.approx(0.02, rel=0.3)
        assert values[FRICTION, "muscle"].value == pytest.approx(0.05, rel=0.1)
        assert values[RUPTURE, "fat"].value == pytest.approx(2.0, rel=0.04)
        assert 0.35 * 0.3 < values[CUTTING, "fat"].value < 0.3
    # Every half millimetre the peak is seen up to 0.1 N too low, of a drop of 0.7 N.
    found = [values for values in fits if (RUPTURE, "muscle") in values]
    near = [values for values in found if values[RUPTURE, "muscle"].value == pytest.approx(1.5, rel=0.4)]
    assert len(near) >= 2
    assert 0.5 * 0.6 < np.median([values[CUTTING, "muscle"].value for values in near]) < 0.6


FORCE = 0.5 + 0.03 * DEPTHS


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: ForceCurve(DEPTHS, np.where(DEPTHS > 5, np.nan, 1)), r"force_n = nan at sample 16 is not finite"),
        (lambda: ForceCurve(DEPTHS[::-1], FORCE), "depth_mm goes from .* give the part in which the needle is"),
        (lambda: ForceCurve(np.repeat(DEPTHS[:15], 2), FORCE[:30]), "depth_mm goes from 0.3 to 0.3"),
        (lambda: ForceCurve(DEPTHS[:19], FORCE[:19]), "19 samples are too few; give at least 20"),
        (lambda: ForceCurve(DEPTHS, FORCE[:-1]), "250 depths and 249 forces"),
        (lambda: ForceCurve(DEPTHS, -FORCE), "pulls; give what resists as positive, tared to zero"),
        (lambda: ForceCurve(DEPTHS, 0 * FORCE), "pulls; give what resists"),
        (lambda: ForceCurve(DEPTHS - 1, FORCE), "depth_mm = -0.7 is out of range; count from where the tip first"),
        (lambda: ForceCurve("deep", FORCE), "depth_mm = 'deep' is not numeric"),
        (lambda: ForceCurve(DEPTHS[None], FORCE), "one number a sample"),
        (lambda: ForceCurve(DEPTHS, FORCE, (("fat", 1.0),)), "let the first begin at 0"),
        (lambda: ForceCurve(DEPTHS, FORCE, (("fat", 0.0), ("muscle", 90.0))), "muscle begins at 90 mm, and the curve"),
        (lambda: ForceCurve(DEPTHS, FORCE, speed_mm_s=0.0), "speed_mm_s = 0.0 is out of range"),
        (lambda: fit_forces([]), "curves is empty"),
        (lambda: fit_forces([measured(), measured()]), "names curve, curve are alike"),
    ],
)  # fmt: skip
def test_what_is_no_curve_is_refused_in_a_line(wrong, message):
    with pytest.raises(ValueError, match=message) as error:
        wrong()
    assert len(str(error.value).splitlines()) == 1


def test_curves_and_fits_are_values():
    curve = measured(LAYERS[:1], depths=DEPTHS[::4])
    fit = fit_forces([curve])
    assert curve == measured(LAYERS[:1], depths=DEPTHS[::4])
    assert curve != measured(LAYERS[:1], seed=1, depths=DEPTHS[::4])
    assert pickle.loads(pickle.dumps(curve)) == curve
    assert pickle.loads(pickle.dumps(fit)) == fit
    assert repr(fit).startswith("ForceFit(1 tissues, 1 curves, 0.01")


def written(path, curve, speed=None):
    heading = "depth_mm,force_n,tissue" + (",speed_mm_s" if speed else "")
    names = [[t for t, begin in curve.tissues if begin <= depth][-1] for depth in curve.depths_mm]
    rows = [
        f"{depth:.3f},{force:.5f},{tissue}" + (f",{speed}" if speed else "")
        for depth, force, tissue in zip(curve.depths_mm, curve.force_n, names, strict=True)
    ]
    path.write_text("\n".join([heading, *rows]))
    return path


def test_a_curve_is_read_as_it_was_written(tmp_path):
    curve = ForceCurve.read(written(tmp_path / "a.csv", measured(), 5.0))
    np.testing.assert_allclose(curve.force_n, measured().force_n, atol=1e-5)
    assert [name for name, _ in curve.tissues] == ["fat", "muscle", "kidney"]
    assert repr(curve) == "ForceCurve('a.csv', 250 samples to 75 mm, 3 tissues, 5 mm/s)"
    (tmp_path / "t.csv").write_text("depth_mm;force_n;time_s\n" + "\n".join(f"{k};{k / 10};{k / 4}" for k in range(30)))
    assert ForceCurve.read(tmp_path / "t.csv").speed_mm_s == pytest.approx(4)
    (tmp_path / "b.csv").write_text("depth_mm,force_n\n1,2\n2,much\n")
    with pytest.raises(ValueError, match=r"b\.csv, line 3: force_n = 'much' is not a number; give one"):
        ForceCurve.read(tmp_path / "b.csv")


def test_the_command_writes_what_other_commands_and_scenes_take(tmp_path, capsys):
    file, out = written(tmp_path / "mine.csv", measured(LAYERS[:1])), tmp_path / "out"
    assert cli.main(["tune", "--forces", str(file), "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert {"materials.toml", "membranes.toml", "forces.csv", "summary.json"} <= set(summary["files"])
    assert all(row["known"] for row in summary["values"] if row["of"] == FRICTION)
    table = MaterialTable.read(out / "materials.toml")
    assert table["fat"].friction_n_per_mm == pytest.approx(0.03, rel=0.05)
    assert "mine.csv" in table["fat"].source
    scene = SceneFile.parse('name = "x"\n[tissue]\nsource = "gel block"\n' + (out / "membranes.toml").read_text())
    assert scene.membranes[0].rupture_force_n == pytest.approx(2.0, rel=0.02)
    assert scene.membranes[0].source.startswith("fitted to mine.csv, +- ")
    assert len((out / "forces.csv").read_text().splitlines()) == 1 + len(DEPTHS)


def test_the_command_refuses_in_a_line(tmp_path, capsys):
    file = tmp_path / "short.csv"
    file.write_text("depth_mm,force_n\n1,1\n2,1\n")
    assert cli.main(["tune", "--forces", str(file), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "sonospline tune: short.csv: 2 samples are too few; give at least 20\n"
    assert not (tmp_path / "out").exists()
