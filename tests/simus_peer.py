"""The same scatterers before the same array, by an independent simulator and by ours: for tests, and a table in docs.

SIMUS (PyMUST: Garcia's MUST toolbox, LGPL) sums spherical waves from every element to every scatterer and back. Here
it sends and hears line by line: transmit focused where it is looked at, delay and sum of what the elements hear,
focused at every depth. A line's scatterers are moved to where the array is, so that the same few elements hear each.
"""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import hilbert

from sonospline.geometry import facing
from sonospline.ultrasound import Display, Phantom, Probe, Scanner
from sonospline.ultrasound.aim import aim
from sonospline.ultrasound.probe import SPEED_OF_SOUND

REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_PYMUST") == "1"
FWHM = 2 * np.sqrt(2 * np.log(2))
CELL = 65536  # places within a cell of the lattice


def must():
    """PyMUST, or a skipped test."""
    try:
        import pymust
    except ImportError:
        if REQUIRED:
            pytest.fail("PyMUST is not installed, and SONOSPLINE_REQUIRE_PYMUST is set")
        pytest.skip("PyMUST is not installed")
    return pymust


def array(name, f_number, aperture_mm, depth_mm):
    """An array of Verasonics by its name, as both simulators know it: PyMUST's parameters, and our probe."""
    parameters = must().getparam(name)
    frequency = parameters.fc / 1e6
    curved = np.isfinite(parameters.radius)
    settings = {
        "frequency_mhz": frequency, "depth_mm": depth_mm, "bandwidth": gaussian_bandwidth(parameters),
        "aperture_mm": 1e3 * parameters.pitch * (parameters.Nelements - 1), "f_number": f_number,
        "active_aperture_mm": aperture_mm, "lines": 256,
    }  # fmt: skip
    if curved:
        return parameters, Probe.curvilinear(radius_mm=1e3 * parameters.radius, **settings)
    return parameters, Probe.linear(**settings)


def two_way(parameters):
    """Frequencies, MHz, and the amplitude of what is sent, through the elements and back."""
    f = np.linspace(0, 2 * parameters.fc, 20_001)
    pulse, element = parameters.getPulseSpectrumFunction(), parameters.getProbeFunction()
    return f / 1e6, np.abs(pulse(2 * np.pi * f)) * element(2 * np.pi * f) ** 2


def gaussian_bandwidth(parameters):
    """Bandwidth at -6 dB of the Gaussian spectrum whose standard deviation is theirs, which has a flatter top."""
    f, heard = two_way(parameters)
    mean = (f * heard).sum() / heard.sum()
    sigma = np.sqrt(((f - mean) ** 2 * heard).sum() / heard.sum())
    return float(FWHM * sigma / (parameters.fc / 1e6))


def simus(parameters, probe, points, strength, focus_mm, lines, ranges_mm, reach_mm):
    """Complex beams (lines, ranges) of points (n, 2) across and along the middle beam, in mm; focused at a depth."""
    aperture = min(focus_mm / probe.f_number, probe.active_aperture_mm)
    own = must().utils.Param(**parameters)
    own.Nelements, own.c = 2 * round(aperture / 2e3 / parameters.pitch), 1e3 * SPEED_OF_SOUND
    x, z = (1e3 * part.ravel() for part in own.getElementPositions()[:2])
    z = z - z.max()  # the face of the middle is 0
    rise = 1e-3 * (own.getElementPositions()[1].max())
    sent = np.hypot(x, focus_mm - z)
    delays = (sent.max() - sent) / SPEED_OF_SOUND * 1e-6
    options = must().utils.Options()
    options.dBThresh, options.ElementSplitting = -40, 1
    found = np.zeros((len(lines), len(ranges_mm)), complex)
    for number, line in enumerate(lines):
        across, along = seen_by(probe, points, line)
        near = np.abs(across) < reach_mm
        heard = must().simus(
            1e-3 * across[near][None], 1e-3 * along[near][None] + 1e3 * rise, strength[near][None], delays[None].copy(),
            own, options,
        )[0]  # fmt: skip
        found[number] = summed(heard, own.fs, probe.frequency_mhz, x, z, sent.max(), focus_mm, ranges_mm)
    return found


def seen_by(probe, points, line):
    """Points as they lie from the face of a beam: across it, and along."""
    step = (line - (probe.lines - 1) / 2) * probe.line_step
    if not probe.curved:
        return points[:, 0] - step, points[:, 1]
    x, y = points[:, 0], points[:, 1] + probe.apex_mm
    return np.cos(step) * x - np.sin(step) * y, np.sin(step) * x + np.cos(step) * y - probe.apex_mm


def summed(heard, rate, frequency_mhz, x, z, sent_mm, focus_mm, ranges_mm):
    """Delay and sum: when the focus was met follows from the delays, any other depth so much sooner or later."""
    microseconds = np.arange(len(heard)) / rate * 1e6
    base = hilbert(heard, axis=0) * np.exp(-2j * np.pi * frequency_mhz * microseconds)[:, None]
    out = np.zeros(len(ranges_mm), complex)
    for element in range(len(x)):
        when = (sent_mm - focus_mm + ranges_mm + np.hypot(x[element], ranges_mm - z[element])) / SPEED_OF_SOUND
        at_base = np.interp(when, microseconds, base[:, element])
        out += at_base * np.exp(2j * np.pi * frequency_mhz * when)
    return out


def ours(probe, points, strength):
    """Complex beams (lines, samples) of points (n, 2) across and along, in mm, in the image plane."""
    half = float(np.abs(probe.footprint[:2]).max()) + 5
    size = (2 * half, 20.0, probe.depth_mm + 20)
    pose = facing((half, 10.0, 10.0), depth=(0, 0, 1), right=(1, 0, 0))
    quiet = Display(noise_db=-200.0)
    scanner = Scanner(Phantom.uniform("liver", size_mm=size), probe, pose, display=quiet, margin_mm=0.2)
    still = scanner._still
    seen = aim(scanner.phantom, scanner.optics, scanner.probe_to_reference, still.grid, 0.2, 0)
    world = np.array([half, 10.0, 10.0]) + np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    cell, place = np.divmod(still.grid.local(world) / np.array(still.grid.spacing), 1.0)
    node = np.ravel_multi_index(cell.astype(int).T, still.grid.shape)
    order = np.argsort(node, kind="stable")
    starts = np.searchsorted(node[order], seen.nodes[:, 0])
    ends = np.searchsorted(node[order], seen.nodes[:, 0], side="right")
    order = np.concatenate([order[a:b] for a, b in zip(starts, ends, strict=True)])
    count, slack = len(order), 64
    assert count == len(points)
    places = np.zeros((3, count + slack), np.uint16)
    places[:, :count] = np.floor(CELL * place[order]).T
    amplitude = np.zeros(count + slack, np.int16)
    step = float(np.abs(strength).max()) / 32_000
    amplitude[:count] = np.rint(strength[order] / step)
    silent = np.zeros(len(seen.starts), np.int32)
    scanner._aimed.plan.aim(
        *seen._replace(
            starts=np.append(0, np.cumsum(ends - starts)).astype(np.int32), place=places, amplitude=amplitude,
            amplitude_step=step, loss_db=np.zeros_like(seen.loss_db), impedance=np.ones_like(seen.impedance),
            surface_starts=silent, surfaces=np.zeros((5, slack), np.float32),
        )
    )  # fmt: skip
    scanner._aimed.grid = still.grid
    return scanner.render().iq


def width(profile, step):
    """Full width at half maximum of a peak."""
    level = np.abs(profile) / np.abs(profile).max()
    peak = int(level.argmax())
    sides = []
    for direction in (1, -1):
        fall = level[peak::direction]
        below = int(np.flatnonzero(fall < 0.5)[0])
        sides.append(below - 1 + (fall[below - 1] - 0.5) / (fall[below - 1] - fall[below]))
    return float(step * sum(sides))


def point_spread(parameters, probe, depth_mm):
    """Axial and lateral width of a point at a depth by the middle beam, mm: SIMUS's, and ours."""
    middle, spacing = (probe.lines - 1) / 2, float(probe.line_spacing(depth_mm))
    fine = np.linspace(-1.3, 1.3, 27) * float(probe.lateral_fwhm(depth_mm)) / spacing
    ranges = depth_mm + np.arange(-1.5, 1.5, 0.02) * FWHM * probe.axial_sigma
    point = np.array([[0.0, depth_mm]])
    theirs = np.abs(simus(parameters, probe, point, np.ones(1), depth_mm, middle + fine, ranges, 1e9))
    at = np.unravel_index(theirs.argmax(), theirs.shape)
    mine = [widths(probe, depth_mm, part) for part in (0, 0.25, 0.5, 0.75)]
    axial, lateral = np.mean(mine, axis=0)
    return SimpleNamespace(
        depth_mm=depth_mm,
        axial=(width(theirs[at[0]], ranges[1] - ranges[0]), float(axial)),
        lateral=(width(theirs[:, at[1]], (fine[1] - fine[0]) * spacing), float(lateral)),
    )


def widths(probe, depth_mm, part):
    """Axial and lateral width of a point of ours, which lies a part of the way from one line and sample to the next."""
    number, sample = probe.lines // 2 + part, np.rint(depth_mm / probe.sample_mm) + part
    point = probe.image_points(np.array([[sample * probe.sample_mm, number, 0.0]]))[:, :2]
    level = np.abs(ours(probe, point, np.ones(1)))
    line, at = np.unravel_index(level.argmax(), level.shape)
    return width(level[line], probe.sample_mm), width(level[:, at], float(probe.line_spacing(depth_mm)))


def speckle(parameters, probe, depth_mm, size_mm, seed=0, per_cell=12):
    """Envelopes (lines, samples) of one cloud of scatterers around a depth: SIMUS's, and ours at the same places."""
    random = np.random.default_rng(seed)
    wide, deep = size_mm
    lateral = float(probe.lateral_sigma(depth_mm))
    area = (wide + 6 * lateral) * (deep + 8 * probe.axial_sigma)
    count = int(per_cell * area / (4 * np.pi * probe.axial_sigma * lateral))
    points = np.column_stack(
        [
            random.uniform(-wide / 2 - 3 * lateral, wide / 2 + 3 * lateral, count),
            depth_mm + random.uniform(-deep / 2, deep / 2, count) * (1 + 8 * probe.axial_sigma / deep),
        ]
    )
    strength = random.choice(np.array([-1.0, 1.0]), count)
    mine = np.abs(ours(probe, points, strength))
    spacing = float(probe.line_spacing(depth_mm))
    half = int(wide / 2 / spacing)
    lines = np.arange(probe.lines // 2 - half, probe.lines // 2 + half, 2)
    samples = np.flatnonzero(np.abs(probe.ranges - depth_mm) < deep / 2)
    theirs = simus(parameters, probe, points, strength, depth_mm, lines, probe.ranges[samples], 6 * lateral + wide / 6)
    return np.abs(theirs), mine[np.ix_(lines, samples)]


ARRAYS = {"L11-5v": (2.0, 22.0, 45.0), "C5-2v": (2.5, 20.0, 120.0)}
"""F-number, widest aperture and depth of the image, mm, by the names of Verasonics' linear and convex array."""
DEPTHS = {"L11-5v": (10, 20, 35), "C5-2v": (30, 60, 100)}
CLOUDS = {"L11-5v": (20, (12, 6)), "C5-2v": (60, (30, 13))}
"""Depth of a cloud of scatterers, and its width and height, mm."""
