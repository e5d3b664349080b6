"""The needle's echo against the measured curve and its own formulas."""

import numpy as np
import pytest

from needle_images import PROBE, at_angle, brightness_by_angle, measured, scanner
from sonospline.geometry import facing
from sonospline.ultrasound import Artefacts, NeedleEcho, Probe, needle_synthesis
from sonospline.ultrasound.optics import CUT_WEIGHT, Optics


@pytest.mark.parametrize(
    ("model", "name", "least"),
    [(NeedleEcho.steel_2mm(), "Steel_2mm", 0.985), (NeedleEcho.steel_1mm(), "Steel_1mm", 0.985),
     (NeedleEcho.trocar(), "Trocar_18G", 0.94), (NeedleEcho.echogenic_2mm(), "Steel_2cut_2mm", 0.9)],
)  # fmt: skip
def test_the_fits_are_those_of_the_measurements(shared_data, model, name, least):
    angle, cnr = measured(shared_data, name)
    fitted = model.cnr(angle - model.centre_deg)
    assert np.corrcoef(fitted, cnr)[0, 1] >= least
    assert np.sqrt(np.mean((fitted - cnr) ** 2)) < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("artefacts", [None, Artefacts()], ids=["clean", "every part on"])
def test_brightness_in_the_image_follows_the_measured_curve(shared_data, artefacts):
    angle, cnr, seen = brightness_by_angle(shared_data, artefacts)
    assert np.corrcoef(seen, cnr)[0, 1] >= 0.97
    assert angle[seen.argmax()] in (75, 80)


def level_db(image):
    """Largest echo of the middle beams."""
    return 20 * np.log10(np.abs(image.iq[60:100]).max(axis=1).mean())


@pytest.mark.parametrize("offset_mm", [0.3, 0.6, 0.9, 1.2])
def test_it_fades_out_of_plane_as_the_slice_profile_says(offset_mm):
    steel = scanner(needle=NeedleEcho.steel_2mm())
    fall = level_db(steel.render(needle=at_angle(0, offset_mm))) - level_db(steel.render(needle=at_angle(0)))
    profile = np.exp(-(offset_mm**2) / 2 / float(PROBE.elevation_sigma(20.0)) ** 2) - CUT_WEIGHT
    assert fall == pytest.approx(20 * np.log10(profile / (1 - CUT_WEIGHT)), abs=0.3)


def test_far_out_of_plane_it_is_not_seen():
    steel = scanner(needle=NeedleEcho.steel_2mm())
    assert np.array_equal(steel.render(needle=at_angle(0, 5.0)).iq, steel.render().iq)


def test_reverberation_repeats_at_the_shafts_travel_time():
    model = NeedleEcho.steel_2mm()
    assert model.reverberation_mm == pytest.approx(2.0 * 1.54 / 5.9)
    beam = np.abs(scanner(needle=model).render(needle=at_angle(0)).iq[70:90]).mean(axis=0)
    peaks = np.flatnonzero((beam[1:-1] > beam[:-2]) & (beam[1:-1] >= beam[2:]) & (beam[1:-1] > 0.02 * beam.max())) + 1
    spacing = np.diff(peaks) * PROBE.sample_mm
    assert len(peaks) >= 5
    assert np.median(spacing) == pytest.approx(model.reverberation_mm, rel=0.03)
    shadowless = beam[peaks[:2]] / beam[peaks[0]]
    assert shadowless[1] == pytest.approx(0.62, abs=0.03)
    oblique = scanner(needle=model).render(needle=at_angle(35))
    assert np.abs(oblique.iq).max() < 0.5 * beam.max()


@pytest.mark.parametrize("offset_mm", [0.0, pytest.param(0.8, marks=pytest.mark.slow)])
def test_the_shadow_is_as_dark_as_its_formula(offset_mm):
    model = NeedleEcho.steel_2mm()
    ratios = []
    for seed in range(3):
        liver = scanner("liver", model, seed=seed)
        below = slice(700, 1000)  # 27 to 39 mm
        shaded, open_ = (np.abs(liver.render(needle=n).iq[62:98, below]) ** 2 for n in (at_angle(0, offset_mm), None))
        ratios.append(shaded.mean() / open_.mean())
    wanted = float(model.shaded(offset_mm, PROBE.elevation_sigma(20.0))) ** 2
    assert np.mean(ratios) == pytest.approx(wanted, rel=0.1)


def test_above_the_needle_nothing_changes():
    liver = scanner("liver", NeedleEcho.steel_2mm())
    above = slice(0, 450)
    assert np.array_equal(liver.render(needle=at_angle(0)).iq[:, above], liver.render().iq[:, above])


def test_the_tip_is_where_the_needle_ends():
    trocar = scanner(needle=NeedleEcho.trocar())
    needle = at_angle(20, half_length=5.0)
    envelope = np.abs(trocar.render(needle=needle).iq)
    line, sample = np.unravel_index(envelope.argmax(), envelope.shape)
    r, at, _ = PROBE.beam_coordinates(trocar.plane.project(needle.tip[None]))[0]
    assert sample * PROBE.sample_mm == pytest.approx(r, abs=0.15)
    assert line == pytest.approx(at, abs=1.5)


def test_a_needle_that_is_none_is_refused():
    with pytest.raises(ValueError, match="diameter_mm"):
        NeedleEcho(name="x", shape="gaussian", floor=1, height=9, width_deg=8, centre_deg=78, diameter_mm=0)
    with pytest.raises(ValueError, match="shape"):
        NeedleEcho(name="x", shape="square", floor=1, height=9, width_deg=8, centre_deg=78, diameter_mm=1)


REAL = Artefacts(diffuse=False, side_lobes_db=None, haze_db=None, tail_db=None)


def echoes_of(needle, real):
    probe = Probe.linear(depth_mm=50)
    pose = facing((30, 15, 0), depth=(0, 0, 1), right=(1, 0, 0))
    return needle_synthesis.echo(NeedleEcho.trocar(), needle, Optics(probe), pose, real=real)[0]


def test_a_real_shaft_has_drop_outs_and_the_same_mean_power():
    ratio = np.concatenate([needle_synthesis._uneven(1500, 0.12, seed) for seed in range(4)])
    assert np.mean(ratio**2) == pytest.approx(1, abs=0.2)
    assert ratio.min() < 0.25
    assert 0.02 < np.mean(ratio < 0.5) < 0.35


def test_speckle_stays_with_the_shaft_as_it_is_pushed():
    """Counted from the tip, a longer part of the same shaft is as uneven."""
    short, long = (needle_synthesis._uneven(count, 0.12, 0) for count in (300, 500))
    assert np.allclose(long[-300:], short)


def test_a_bevel_has_two_echoes_and_square_to_the_beam_a_longer_tail():
    needle = at_angle(0, half_length=12)
    ruled, real = (echoes_of(needle, real) for real in (False, True))
    assert np.ptp(real[:, 1]) > 1.5 * np.ptp(ruled[:, 1])
    bevel = 2.4 * NeedleEcho.trocar().diameter_mm
    assert np.diff(np.abs(real[-2:, 0]) * Probe.linear().line_step)[0] == pytest.approx(-bevel, abs=0.15)


def test_a_real_needle_hides_more_of_what_lies_below():
    model = NeedleEcho.trocar()
    assert model.shaded(0.0, 1.0, real=True) < model.shaded(0.0, 1.0)
    images = [scanner("liver", artefacts=artefacts).render(None, at_angle(20)) for artefacts in (None, REAL)]
    below = [np.square(image.envelope[70:90, 750:900]).mean() for image in images]
    assert below[1] < below[0]
