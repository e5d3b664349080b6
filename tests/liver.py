"""Probes on liver that fills their image, and how it is moved: for tests of the synthetic image."""

import numpy as np

import sonospline as ss
from sonospline.geometry import facing
from sonospline.ultrasound import Display, Phantom, Probe, Scanner

LINEAR = Probe.linear(depth_mm=40, lines=128, aperture_mm=25.4)
CURVED = Probe.curvilinear(depth_mm=100, lines=128, aperture_mm=42)
FLAT = Display(tgc_db_cm_mhz=0.5)
EDGE = 15  # lines left out on either side
SEEDS = range(4)


def liver_scanner(probe, seed=0, **settings):
    """A probe on liver that fills its slice."""
    depth = probe.depth_mm + 8
    phantom = Phantom.uniform("liver", size_mm=(140, 30, depth))
    pose = facing((70, 15, 4), depth=(0, 0, 1), right=(1, 0, 0))
    return Scanner(phantom, probe, pose, display=FLAT, seed=seed, **({"margin_mm": 0.2} | settings))


def speckle(image):
    """Envelope away from the edges, over its rms at each depth."""
    part = image.envelope[EDGE:-EDGE, 80:-40].astype(float)
    rms = np.sqrt(np.mean(part**2, axis=0))
    smooth = np.convolve(np.pad(rms, 40, mode="edge"), np.ones(81) / 81, mode="valid")
    return part / smooth


def shifted(scanner, displacement):
    """The image of tissue moved as a whole."""
    grid = ss.Grid(shape=(4, 4, 4), spacing=(60, 20, 60), origin=(-20, -10, -20))
    return scanner.render(
        ss.GridField(grid, np.broadcast_to(np.asarray(displacement, np.float32), (4, 4, 4, 3)).copy())
    )


def a_field(size=(140, 30, 108)):
    """A smooth field of a few millimetres with a cusp."""
    grid = ss.Grid.covering(size, nodes=20_000)
    away = np.linalg.norm(grid.points - np.array(size) / 2, axis=1)
    values = 2.5 * np.exp(-away / 20)[:, None] * [0.8, 0.2, 0.6]
    return ss.GridField(grid, values.reshape(*grid.shape, 3).astype(np.float32))
