"""What images of liver say in numbers, for tests and a table of the docs, with parts of a real image off or on."""

import numpy as np
from scipy import stats
from scipy.signal import fftconvolve

import sonospline as ss
from liver import EDGE, FLAT, SEEDS, a_field, liver_scanner, speckle
from sonospline import _core
from sonospline.geometry import facing
from sonospline.ultrasound import Phantom, Probe, Scanner

FWHM = 2 * np.sqrt(2 * np.log(2))
HAZE_MM = 15.0
"""Above it reverberation under the face is part of an image that has it, and stays where it is."""


def images_of(probe, artefacts):
    """Liver, one image a seed."""
    return [liver_scanner(probe, seed, artefacts=artefacts).render() for seed in SEEDS]


def signal_to_noise(images):
    """Mean over standard deviation of the envelope."""
    envelope = np.concatenate([speckle(image) for image in images])
    return float(envelope.mean() / envelope.std())


def rayleigh_p(probe, image):
    """By Kolmogorov and Smirnov, of samples some resolution cells apart; and how many they are."""
    along = int(np.ceil(2.0 * FWHM * probe.axial_sigma / probe.sample_mm))
    sample = speckle(image)[::4, ::along]
    independent = sample.ravel() / np.sqrt(np.mean(sample**2))
    return float(stats.kstest(independent, stats.rayleigh(scale=np.sqrt(0.5)).cdf).pvalue), len(independent)


def level_along_depth(probe, images, from_mm=0.0):
    """Mean level in fifteen bands of depth, attenuation made up for, dB."""
    power = np.mean([np.mean(np.abs(image.iq[EDGE:-EDGE]) ** 2, axis=0) for image in images], axis=0)
    tgc = 2 * 0.5 * probe.frequency_mhz * probe.ranges / 10
    level = 10 * np.log10(power / images[0].optics.speckle_power) + tgc
    bands = 10 * np.log10(np.mean(10 ** (level[64:].reshape(15, -1) / 10), axis=1))
    return bands[probe.ranges[64:].reshape(15, -1)[:, 0] >= from_mm]


def half_width(covariance, step):
    """Full width at half maximum of a covariance that falls from its first value."""
    below = np.flatnonzero(covariance < 0.5 * covariance[0])[0]
    high, low = covariance[below - 1 : below + 1] / covariance[0]
    return 2 * step * (below - 1 + (high - 0.5) / (high - low))


def width_errors(probe, artefacts):
    """How far the axial and the lateral width of the intensity's autocovariance are off pulse and beam, of 1."""
    window = slice(440, 600)
    axial, lateral = [], []
    for seed in range(8):
        intensity = speckle(liver_scanner(probe, seed, artefacts=artefacts).render())[:, window] ** 2
        intensity -= intensity.mean()
        axial.append([np.mean(intensity[:, : 160 - k] * intensity[:, k:]) for k in range(40)])
        lateral.append([np.mean(intensity[: len(intensity) - k] * intensity[k:]) for k in range(3)])
    middle = probe.sample_mm * (80 + 520)
    found_axial = half_width(np.mean(axial, axis=0), probe.sample_mm)
    # Lines are half a beam apart: the width of the Gaussian follows from its first lag.
    covariance = np.mean(lateral, axis=0)
    found = FWHM * float(probe.line_spacing(middle)) / np.sqrt(2 * np.log(covariance[0] / covariance[1]))
    return [found_axial / (FWHM * probe.axial_sigma) - 1, found / float(probe.lateral_fwhm(middle)) - 1]


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


def tracked(artefacts):
    """Errors of block matching between the frames before and after a needle step, and what the model says, mm."""
    probe = Probe.linear(depth_mm=40, lines=192, aperture_mm=38.2)
    phantom = Phantom.uniform("liver", size_mm=(60, 30, 52))
    pose = facing((30, 15, 4), depth=(0, 0, 1), right=(1, 0, 0))
    scanner = Scanner(phantom, probe, pose, display=FLAT, artefacts=artefacts)
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
    return errors, sizes


def twin_difference(probe, artefacts):
    """Of the compiled core's beams from those of the NumPy twin, over their rms."""

    def image(back_end):
        before, _core.active = _core.active, back_end
        try:
            needle = ss.Needle((40, 15, 10), (75, 16, 40))
            return liver_scanner(probe, artefacts=artefacts).render(a_field(), needle, frame=1)
        finally:
            _core.active = before

    found, expected = image(_core.native), image(_core.twin)
    weight = 1 / np.sqrt(expected.optics.speckle_power)
    rms = np.sqrt(np.mean(np.abs(expected.iq * weight) ** 2))
    return float(np.sqrt(np.mean(np.abs((found.iq - expected.iq) * weight) ** 2)) / rms)
