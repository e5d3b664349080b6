"""Speckle of synthetic B-mode: its statistics, and that it moves with the tissue."""

import numpy as np
import pytest

import image_statistics
from liver import CURVED, EDGE, LINEAR, SEEDS, liver_scanner, shifted, speckle
from sonospline.ultrasound import Artefacts
from sonospline.ultrasound.optics import CUT_WEIGHT


@pytest.fixture(scope="module", params=[LINEAR, CURVED], ids=lambda p: p.kind)
def speckled(request):
    """A probe and its images of liver, one a seed."""
    return request.param, image_statistics.images_of(request.param, Artefacts.none())


def test_the_signal_to_noise_ratio_is_rayleighs(speckled):
    assert image_statistics.signal_to_noise(speckled[1]) == pytest.approx(np.sqrt(np.pi / (4 - np.pi)), rel=0.03)


def test_the_envelope_is_rayleigh_distributed(speckled):
    probe, images = speckled
    for image in images:
        chance, count = image_statistics.rayleigh_p(probe, image)
        assert count > 500
        assert chance > 0.01


def test_mean_brightness_is_flat_in_depth(speckled):
    assert np.abs(image_statistics.level_along_depth(*speckled)).max() < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("probe", [LINEAR, CURVED], ids=lambda p: p.kind)
@pytest.mark.parametrize("artefacts", [Artefacts.none(), Artefacts()], ids=["clean", "every part on"])
def test_autocovariance_widths_follow_pulse_and_beam(probe, artefacts):
    assert image_statistics.width_errors(probe, artefacts) == pytest.approx([0, 0], abs=0.1)


@pytest.mark.slow
def test_elevational_motion_decorrelates_as_theory_says():
    scanners = [liver_scanner(LINEAR, seed) for seed in SEEDS]
    focus = int(LINEAR.elevation_focus_mm / LINEAR.sample_mm) - 80
    sigma = float(LINEAR.elevation_sigma(20.0))
    still = np.concatenate([speckle(scanner.render())[:, focus - 150 : focus + 150] for scanner in scanners]) ** 2
    y = np.linspace(-8, 8, 4001)

    def profile(offset):
        return np.maximum(np.exp(-((y - offset) ** 2) / 2) - CUT_WEIGHT, 0)

    for steps in (0.5, 1.0, 1.5, 2.0):
        moved = [speckle(shifted(s, (0, steps * sigma, 0)))[:, focus - 150 : focus + 150] for s in scanners]
        found = np.corrcoef(still.ravel(), (np.concatenate(moved) ** 2).ravel())[0, 1]
        wanted = ((profile(0) * profile(steps)).sum() / (profile(0) ** 2).sum()) ** 2
        assert found == pytest.approx(wanted, abs=0.06)
        assert found == pytest.approx(np.exp(-(steps**2) / 2), abs=0.08)  # a Gaussian slice without the cut


@pytest.mark.slow
@pytest.mark.parametrize("probe", [LINEAR, CURVED], ids=lambda p: p.kind)
def test_speckle_stays_as_it_is_with_every_part_on(probe):
    images = image_statistics.images_of(probe, Artefacts())
    assert image_statistics.signal_to_noise(images) == pytest.approx(1.913, abs=0.06)
    assert min(image_statistics.rayleigh_p(probe, image)[0] for image in images) > 0.01
    below = image_statistics.level_along_depth(probe, images, image_statistics.HAZE_MM)
    assert np.ptp(below) < 2.0


def test_an_axial_shift_moves_speckle_with_its_phase():
    scanner = liver_scanner(LINEAR)
    samples = 3
    still, moved = scanner.render().iq, shifted(scanner, (0, 0, samples * LINEAR.sample_mm)).iq
    turn = np.exp(-2j * np.pi * scanner.optics.cycles_per_mm * samples * LINEAR.sample_mm)
    a, b = still[EDGE:-EDGE, 200:800] * turn, moved[EDGE:-EDGE, 200 + samples : 800 + samples]
    coherence = np.vdot(a, b) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)
    assert coherence.real > 0.99
    assert abs(coherence.imag) < 0.01


@pytest.mark.parametrize(
    "artefacts", [Artefacts.none(), pytest.param(Artefacts(), marks=pytest.mark.slow)], ids=["clean", "every part on"]
)
def test_speckle_moves_with_the_tissue(artefacts):
    """Block matching between frames before and after a needle step recovers the model's displacement."""
    errors, sizes = image_statistics.tracked(artefacts)
    assert len(errors) > 150
    assert min(sizes) < 0.35
    assert max(sizes) > 1.45
    assert np.median(errors) <= 0.05


@pytest.mark.slow
def test_a_displacement_beyond_the_margin_chooses_scatterers_anew():
    scanner = liver_scanner(LINEAR)
    far = shifted(scanner, (0, 6.0, 0))
    envelope = speckle(far)
    assert envelope.mean() / envelope.std() == pytest.approx(1.913, rel=0.06)
    still = scanner.render().envelope[EDGE:-EDGE, 100:900]
    assert np.mean(far.envelope[EDGE:-EDGE, 100:900] ** 2) == pytest.approx(np.mean(still**2), rel=0.2)
