"""Probes of every kind at every frequency and depth: samples and lines follow."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import sonospline as ss

KINDS = {"linear": ss.Probe.linear, "curvilinear": ss.Probe.curvilinear, "phased": ss.Probe.phased}
FREQUENCIES, DEPTHS = (1, 2, 3.5, 5, 7.5, 10, 15, 20), (20, 45, 80, 120, 180, 250)
EVERY = list(product(KINDS, FREQUENCIES, DEPTHS))


def image_of(kind, frequency, depth):
    probe = KINDS[kind](frequency_mhz=frequency, depth_mm=depth)
    phantom = ss.Phantom.uniform("liver", size_mm=(40, 12, 40), spacing_mm=2)
    return ss.Scanner(phantom, probe, ss.facing((20, 6, 0), depth=(0, 0, 1), right=(1, 0, 0))).render()


def shows_speckle(image):
    probe = image.optics.probe
    near = image.envelope[probe.lines // 2, (probe.ranges > 1) & (probe.ranges < 8)]
    return bool(np.isfinite(image.envelope).all() and 0.2 < near.mean() < 3 and np.ptp(image.pixels) > 30)


@pytest.mark.parametrize(("kind", "frequency", "depth"), EVERY)
def test_samples_and_lines_follow_the_pulse_and_the_beam(kind, frequency, depth):
    probe = KINDS[kind](frequency_mhz=frequency, depth_mm=depth)
    assert (probe.frequency_mhz, probe.depth_mm, probe.lines >= 192) == (frequency, depth, True)
    assert probe.sample_mm < 1.5 * probe.axial_sigma
    if probe.lines < 512:
        ranges = np.linspace(0, depth, 50)
        assert (probe.line_spacing(ranges) < 2.7 * probe.lateral_sigma(ranges)).all()


def test_a_given_number_of_lines_is_kept():
    assert ss.Probe.curvilinear(frequency_mhz=20, lines=64).lines == 64


def test_what_the_presets_were_they_are():
    found = [(p.lines, p.samples) for p in (ss.Probe.linear(), ss.Probe.curvilinear(), ss.Probe.phased())]
    assert found == [(192, 1024)] * 3


@pytest.mark.parametrize(("kind", "frequency", "depth"), EVERY[:: len(EVERY) // 6])
def test_some_show_speckle(kind, frequency, depth):
    assert shows_speckle(image_of(kind, frequency, depth))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "frequency", "depth"), EVERY[::5])
def test_more_show_speckle(kind, frequency, depth):
    assert shows_speckle(image_of(kind, frequency, depth))


def test_one_knob_is_turned_at_a_time():
    probe = ss.Probe.linear()
    deeper = probe.tuned(depth_mm=80)
    assert (deeper.depth_mm, deeper.frequency_mhz, deeper.elevation_focus_mm) == (80, 7.5, 20)
    assert deeper.tuned(depth_mm=45) == probe
    assert probe.tuned(frequency_mhz=10, depth_mm=80) == replace(ss.Probe.linear(frequency_mhz=10, depth_mm=80))
    with pytest.raises(ValueError, match="depth_mm"):
        probe.tuned(depth_mm=-1)
