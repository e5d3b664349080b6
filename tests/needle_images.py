"""Needles in liver and gel, at angles to the beam, and what was measured of real ones."""

import csv

import numpy as np

import sonospline as ss
from sonospline.geometry import facing
from sonospline.ultrasound import Display, NeedleEcho, Phantom, Probe, Scanner

PROBE = Probe.linear(depth_mm=40, lines=160, aperture_mm=32)
POSE = facing((30, 15, 4), depth=(0, 0, 1), right=(1, 0, 0))
CENTRE = np.array([30.0, 15.0, 24.0])


def measured(folder, name):
    """Angles and median contrast-to-noise ratios of one needle's shaft."""
    with (folder / "needle_visibility.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["needle"] == name]
    return np.array([[float(row["angle_deg"]), float(row["shaft_cnr_median"])] for row in rows]).T


def scanner(tissue="gel", needle=None, **settings):
    phantom = Phantom.uniform(tissue, size_mm=(60, 30, 50))
    display = Display(tgc_db_cm_mhz=0.5, noise_db=-150)
    return Scanner(phantom, PROBE, POSE, display=display, needle_echo=needle, margin_mm=0.2, **settings)


def at_angle(beta_deg, offset_mm=0.0, half_length=7.0):
    """A needle through the middle of the image, so far from square to the beam and from the image plane."""
    beta = np.radians(beta_deg)
    along = half_length * np.array([np.cos(beta), 0, np.sin(beta)])
    middle = CENTRE + np.array([0, offset_mm, 0])
    return ss.Needle(middle - along, middle + along)


def brightness_by_angle(folder, artefacts=None):
    """Angles of the measurements, contrast of a 2 mm steel shaft there, and that of its image in liver.

    Angles are counted from the fitted maximum, 78.15 degrees, which stands for square to the beam.
    """
    model = NeedleEcho.steel_2mm()
    angle, cnr = measured(folder, "Steel_2mm")
    angle, cnr = angle[angle <= 130], cnr[angle <= 130]
    seen = np.zeros(len(angle))
    for seed in range(2):
        liver = scanner("liver", model, seed=seed, artefacts=artefacts)
        plane, still = liver.plane, liver.render().frame.pixels[40:-40, 40:-40]
        for number, degrees in enumerate(angle):
            needle = at_angle(degrees - model.centre_deg)
            x, y, _ = plane.project(needle.at(np.linspace(0.05, 0.9, 160))).T
            column, row = (
                np.rint((v - c) / plane.spacing_mm[0]).astype(int) for v, c in zip((x, y), plane.corner_mm, strict=True)
            )
            grey = liver.render(needle=needle).frame.pixels[row, column].mean()
            seen[number] += (grey - still.mean()) / still.std() / 2
    return angle, cnr, seen
