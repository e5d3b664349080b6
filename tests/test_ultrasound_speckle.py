"""Speckle of synthetic B-mode: its statistics, and that it moves with the tissue."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import fftconvolve

import sonospline as ss
from liver import CURVED, EDGE, FLAT, LINEAR, SEEDS, liver_scanner, shifted, speckle
from sonospline.geometry import facing
from sonospline.ultrasound import Phantom, Probe, Scanner
from sonospline.ultrasound.optics import CUT_WEIGHT


@pytest.fixture(scope="module", params=[LINEAR, CURVED], ids=lambda p: p.kind)
def speckled(request):
    """A probe and its images of liver, one a seed."""
    return request.param, [liver_scanner(request.param, seed).render() for seed in SEEDS]


def test_the_signal_to_noise_ratio_is_rayleighs(speckled):
    _, images = speckled
    envelope = np.concatenate([speckle(image) for image in images])
    assert envelope.mean() / envelope.std() == pytest.approx(np.sqrt(np.pi / (4 - np.pi)), rel=0.03)


def test_the_envelope_is_rayleigh_distributed(speckled):
    probe, images = speckled
    along = int(np.ceil(2.0 * 2.355 * probe.axial_sigma / probe.sample_mm))
    for image in images:
        sample = speckle(image)[::4, ::along]  # samples some resolution cells apart
        independent = sample.ravel() / np.sqrt(np.mean(sample**2))
        assert len(independent) > 500
        assert stats.kstest(independent, stats.rayleigh(scale=np.sqrt(0.5)).cdf).pvalue > 0.01


def test_mean_brightness_is_flat_in_depth(speckled):
    probe, images = speckled
    power = np.mean([np.mean(np.abs(image.iq[EDGE:-EDGE]) ** 2, axis=0) for image in images], axis=0)
    tgc = 2 * 0.5 * probe.frequency_mhz * probe.ranges / 10
    level = 10 * np.log10(power / images[0].optics.speckle_power) + tgc
    bands = level[64:].reshape(15, -1)
    bands = 10 * np.log10(np.mean(10 ** (bands / 10), axis=1))
    assert np.abs(bands).max() < 1.0


def half_width(covariance, step):
    """Full width at half maximum of a covariance that falls from its first value."""
    below = np.flatnonzero(covariance < 0.5 * covariance[0])[0]
    high, low = covariance[below - 1 : below + 1] / covariance[0]
    return 2 * step * (below - 1 + (high - 0.5) / (high - low))


@pytest.mark.slow
@pytest.mark.parametrize("probe", [LINEAR, CURVED], ids=lambda p: p.kind)
def test_autocovariance_widths_follow_pulse_and_beam(probe):
    window = slice(440, 600)
    axial, lateral = [], []
    for seed in range(8):
        intensity = speckle(liver_scanner(probe, seed).render())[:, window] ** 2
        intensity -= intensity.mean()
        axial.append([np.mean(intensity[:, : 160 - k] * intensity[:, k:]) for k in range(40)])
        lateral.append([np.mean(intensity[: len(intensity) - k] * intensity[k:]) for k in range(3)])
    middle = probe.sample_mm * (80 + 520)
    wanted_axial, wanted_lateral = 2.3548 * probe.axial_sigma, float(probe.lateral_fwhm(middle))
    assert half_width(np.mean(axial, axis=0), probe.sample_mm) == pytest.approx(wanted_axial, rel=0.1)
    # Lines are half a beam apart: the width of the Gaussian follows from its first lag.
    covariance = np.mean(lateral, axis=0)
    found = 2.3548 * float(probe.line_spacing(middle)) / np.sqrt(2 * np.log(covariance[0] / covariance[1]))
    assert found == pytest.approx(wanted_lateral, rel=0.1)


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


def test_an_axial_shift_moves_speckle_with_its_phase():
    scanner = liver_scanner(LINEAR)
    samples = 3
    still, moved = scanner.render().iq, shifted(scanner, (0, 0, samples * LINEAR.sample_mm)).iq
    turn = np.exp(-2j * np.pi * scanner.optics.cycles_per_mm * samples * LINEAR.sample_mm)
    a, b = still[EDGE:-EDGE, 200:800] * turn, moved[EDGE:-EDGE, 200 + samples : 800 + samples]
    coherence = np.vdot(a, b) / np.sqrt(np.vdot(a, a).real * np.vdot(b, b).real)
    assert coherence.real > 0.99
    assert abs(coherence.imag) < 0.01


def block_shift(first, second, at, size, search):
    """Sub-sample shift of one block by normalised cross-correlation, and its score."""
    i, j = at
    template = first[i : i + size[0], j : j + size[1]].astype(float)
    template = template - template.mean()
    window = second[i - search[0] : i + size[0] + search[0], j - search[1] : j + size[1] + search[1]].astype(float)
    ones = np.ones(size)
    product = fftconvolve(window, template[::-1, ::-1], mode="valid")
    total, squares = (fftconvolve(w, ones, mode="valid") for w in (window, window**2))
    score = product / np.sqrt(np.maximum(squares - total**2 / template.size, 1e-9) * (template**2).sum())
    peak = np.unravel_index(score.argmax(), score.shape)
    shift = []
    for axis in range(2):
        if not 0 < peak[axis] < score.shape[axis] - 1:
            return None
        before, here, after = (
            score[tuple(p + (step if a == axis else 0) for a, p in enumerate(peak))] for step in (-1, 0, 1)
        )
        shift.append(peak[axis] - search[axis] + 0.5 * (before - after) / (before - 2 * here + after))
    return np.array(shift)


def test_speckle_moves_with_the_tissue():
    """Block matching between frames before and after a needle step recovers the model's displacement."""
    probe = Probe.linear(depth_mm=40, lines=192, aperture_mm=38.2)
    phantom = Phantom.uniform("liver", size_mm=(60, 30, 52))
    scanner = Scanner(phantom, probe, facing((30, 15, 4), depth=(0, 0, 1), right=(1, 0, 0)), display=FLAT)
    grid = ss.Grid.covering((60, 30, 52), nodes=60_000)
    insertion = ss.Insertion(ss.Tissue(grid, entry_face="x-"), model=ss.NeedleTissueModel.paper(60.0))
    deeper = [ss.GridField.of(insertion.advance(ss.Needle((0, 15, 16), tip))) for tip in ((10, 15, 17), (44, 15, 30))]
    before, after = (scanner.render(field).beams for field in deeper)
    step = np.array([float(probe.line_spacing(0.0)), probe.sample_mm])
    size = np.rint(np.array([4.0, 2.4]) / step).astype(int)
    errors, sizes = [], []
    for i in range(24, 192 - 24 - size[0], 9):
        for j in range(110, 1024 - 110 - size[1], 40):
            centre = np.array([[j + size[1] / 2, i + size[0] / 2, 0]]) * [probe.sample_mm, 1, 1]
            world = scanner.probe_to_reference[:3, :3] @ probe.image_points(centre)[0] + [30, 15, 4]
            material = deeper[0].inverse(world[None])
            moved = deeper[1].forward(material)[0] - world
            if not 0.3 <= np.hypot(moved[0], moved[2]) <= 1.5:
                continue
            found = block_shift(before, after, (i, j), size, (14, 70))
            if found is None:
                errors.append(np.inf)
                continue
            errors.append(np.hypot(*(found * step - [moved[0], moved[2]])))
            sizes.append(np.hypot(moved[0], moved[2]))
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
