"""The scanner's knobs beyond gain: sliders, grey maps, where the beam is sent, its pulse in depth, harmonics."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace as changed

from liver import CURVED, LINEAR, liver_scanner
from simulator_scenes import SMALL_PAPER
from sonospline.io.records import FieldError
from sonospline.simulator import ImageSettings, SceneFile, Session
from sonospline.ultrasound import Display, Probe
from sonospline.ultrasound.display import GREY_MAPS, IMPERFECT_TGC_DB


@given(st.lists(st.floats(-30, 30), min_size=8, max_size=8))
def test_sliders_add_what_they_say_in_the_middle_of_their_eighth(sliders):
    added = Display(tgc_db=tuple(sliders)).slider_db(LINEAR)
    middles = (np.arange(8) + 0.5) * LINEAR.samples / 8
    assert np.allclose(added[middles.astype(int)], sliders, atol=0.5)
    assert added[0] == sliders[0]
    assert added[-1] == pytest.approx(sliders[-1])
    assert min(sliders) - 1e-9 <= added.min() <= added.max() <= max(sliders) + 1e-9


def test_a_slider_moves_grey_levels_and_not_the_echoes():
    plain = liver_scanner(LINEAR)
    moved = plain.with_display(tgc_db=(0, 0, 0, 0, 0, 0, 0, 6))
    a, b = plain.render(), moved.render()
    assert np.array_equal(a.iq, b.iq)
    grey = a.beams[20:-20, -40:].astype(int)
    middling = (grey > 20) & (grey < 200)
    assert np.abs(b.beams[20:-20, -40:].astype(int)[middling] - grey[middling] - 6 * 255 / 60).max() <= 1
    assert np.array_equal(a.beams[:, :760], b.beams[:, :760])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tgc_db": (1, 2, 3)}, "tgc_db has 3 sliders; give 8 numbers in dB"),
        ({"tgc_db": (0,) * 7 + (40,)}, r"tgc_db\[7\] = 40.0 is out of range; give -30 to 30 dB"),
        ({"tgc_db": (0,) * 7 + (np.nan,)}, r"tgc_db\[7\] = nan is out of range"),
        ({"tgc_db": 3}, "tgc_db = 3 are no sliders"),
        ({"grey_map": "sepia"}, "grey_map = 'sepia'"),
    ],
)
def test_sliders_and_maps_that_are_none_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Display(**settings)


def test_grey_maps_rise_from_black_to_white_and_touch_the_picture_alone():
    for name, levels in GREY_MAPS.items():
        assert (np.diff(levels.astype(int)) >= 0).all(), name
        assert (levels[0], levels[-1]) == (0, 255)
    scanner = liver_scanner(LINEAR)
    plain, soft = scanner.render(), scanner.with_display(grey_map="soft").render()
    assert np.array_equal(plain.beams, soft.beams)
    assert np.array_equal(GREY_MAPS["soft"][plain.pixels], soft.pixels)


def test_the_imperfect_sliders_are_a_display():
    assert np.ptp(Display(tgc_db=IMPERFECT_TGC_DB).slider_db(CURVED)) == pytest.approx(5.5)


def test_the_centre_frequency_falls_as_a_gaussian_spectrum_through_tissue_does():
    """Against the spectrum itself: Gaussian times what 2 r of tissue leave of each frequency."""
    probe = replace(CURVED, downshift_db_cm_mhz=0.5)
    f = np.linspace(0, 10, 20_001)
    spread = probe.bandwidth * probe.frequency_mhz / (2 * np.sqrt(2 * np.log(2)))
    for r in (0.0, 20.0, 60.0):
        spectrum = np.exp(-(((f - probe.frequency_mhz) / spread) ** 2) / 2) * 10 ** (-2 * 0.5 * f * r / 10 / 20)
        assert probe.frequency_at(r) == pytest.approx(f[spectrum.argmax()], abs=1e-3)
    assert probe.frequency_at(1e4) == probe.frequency_mhz / 2
    assert probe.lateral_fwhm(60) / CURVED.lateral_fwhm(60) == pytest.approx(3.5 / probe.frequency_at(60))


def test_a_beam_is_narrowest_where_it_is_sent_to_and_at_most_root_two_wider():
    sent = replace(CURVED, transmit_focus_mm=50.0)
    r = np.linspace(1, 100, 400)
    wider = sent.lateral_fwhm(r) / CURVED.lateral_fwhm(r)
    assert sent.lateral_fwhm(50) == pytest.approx(CURVED.lateral_fwhm(50))
    assert 1 <= wider.min() <= wider.max() <= np.sqrt(2) + 1e-9
    assert wider[0] > 1.2
    assert wider[-1] > 1.1
    assert np.array_equal(replace(sent, elevation_focus_mm=20).lateral_fwhm(r), sent.lateral_fwhm(r))


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [{"transmit_focus_mm": 40.0}, {"downshift_db_cm_mhz": 0.5}], ids=lambda c: next(iter(c))
)
def test_speckle_widens_as_the_beam_does_and_keeps_its_level(changes):
    def width_and_level(probe):
        images = [liver_scanner(probe, seed).render().envelope[15:-15, 800:1000].astype(float) for seed in range(4)]
        power = np.mean([np.square(e) for e in images])
        field = [np.square(e) - np.square(e).mean() for e in images]
        lags = [np.mean([np.mean(f[: len(f) - k] * f[k:]) for f in field]) for k in range(3)]
        return np.sqrt(-1 / np.log(lags[1] / lags[0])), power

    (narrow, level), (wide, same) = width_and_level(CURVED), width_and_level(replace(CURVED, **changes))
    wanted = replace(CURVED, **changes).lateral_fwhm(88.0) / CURVED.lateral_fwhm(88.0)
    assert wide / narrow == pytest.approx(wanted, rel=0.12)
    assert 10 * np.log10(same / level) == pytest.approx(0, abs=0.5)


def test_harmonic_mode_is_narrower_and_goes_back():
    harmonic = Probe.curvilinear().in_harmonic_mode()
    assert harmonic.in_harmonic_mode() is harmonic
    assert harmonic.axial_sigma == pytest.approx(Probe.curvilinear().axial_sigma)
    assert harmonic.samples == Probe.curvilinear().samples


def test_a_session_shows_what_the_settings_say():
    session = Session(SceneFile.parse(SMALL_PAPER))
    start = session.scene.start.image

    def image(**settings):
        return session.step(settings=changed(start, **settings)).image.pixels.astype(int)

    plain = image()
    dark = GREY_MAPS["dark"][plain]
    assert np.median(np.abs(image(grey_map="dark") - dark)) <= 2  # noise is another in each frame
    assert image(tgc8=12.0)[-60:].mean() > plain[-60:].mean() + 5
    assert np.median(np.abs(image() - plain)) <= 2
    assert max(image(pixels=1024).shape) == 1024
    with pytest.raises(FieldError, match=r"image.tgc3 = 13 is out of range; give -12 to 12"):
        image(tgc3=13.0)
    with pytest.raises(FieldError, match=r"mode = 'doppler' is not known; choose one of fundamental, harmonic"):
        ImageSettings(gain=0, depth=45, frequency=7, focus=20, mode="doppler")
    with pytest.raises(FieldError, match=r"pixels = 4000 is out of range; give 128 to 1024"):
        ImageSettings(gain=0, depth=45, frequency=7, focus=20, pixels=4000)


def test_a_finer_picture_is_of_the_same_beams():
    scanner = liver_scanner(CURVED)
    rows, columns = scanner.plane.shape
    fine = scanner.with_picture((2 * rows, 2 * columns))
    a, b = scanner.render(), fine.render()
    assert np.array_equal(a.iq, b.iq)
    assert b.pixels.shape == (2 * rows, 2 * columns)
    coarse = b.pixels.reshape(rows, 2, columns, 2).mean(axis=(1, 3))
    assert np.corrcoef(coarse.ravel(), a.pixels.ravel())[0, 1] > 0.97
