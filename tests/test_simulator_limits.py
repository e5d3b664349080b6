"""Every state within the limits that a scene publishes gives a picture: corners and random places between them."""

import itertools

import numpy as np
import pytest

from simulator_scenes import SMALL
from sonospline.geometry import facing
from sonospline.simulator import Console, SceneFile, Session
from sonospline.ultrasound import Phantom, Probe, Scanner

KNOBS = ("gain", "depth", "frequency", "focus")
BLOCK = """name = "Block"
[tissue]
source = "gel block"
voxel_mm = 4.0
nodes = 1000
[model]
use = "kelvinlet"
[probe]
kind = "{kind}"
frequency_mhz = {frequency}
depth_mm = {depth}
focus_mm = {focus}
lines = {lines}
"""


def ranges(console, group):
    return {knob.field: (knob.low, knob.high) for knob in console.scene.knobs if knob.group == group}


def anywhere(console, rng, group):
    """Knobs of a group, each at an end or between."""
    return {name: float(rng.choice([*ends, rng.uniform(*ends)])) for name, ends in ranges(console, group).items()}


def show(console, rng, knobs):
    """One picture, with the scanner's other knobs and the probe anywhere they may be."""
    image = anywhere(console, rng, "image") | dict(zip(KNOBS, map(float, knobs), strict=True))
    state = console.command.with_image(**image).with_probe(**anywhere(console, rng, "probe"))
    frame = console.step(state.with_needle(depth=float(rng.choice([0.0, 5.0]))))
    assert frame.image.pixels.dtype == np.uint8
    assert frame.image.pixels.ndim == 2
    return frame


def places(console, rng, between):
    """All corners of the knobs' limits, then random places between."""
    limits = [ranges(console, "image")[name] for name in KNOBS]
    yield from itertools.product(*[sorted({*ends}) for ends in limits])
    for _ in range(between):
        yield [rng.uniform(*ends) for ends in limits]


def test_every_knob_at_every_end_gives_a_picture(rng):
    console = Console(Session(SceneFile.parse(SMALL), model="kelvinlet"))
    pictures = [show(console, rng, knobs) for knobs in places(console, rng, 4)]
    assert len(pictures) == 20


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["kidney", "gel", "cube"])
def test_every_knob_of_a_shipped_scene_gives_a_picture(rng, scene):
    console = Console(Session(scene, model="kelvinlet"))
    for knobs in places(console, rng, 40):
        show(console, rng, knobs)


PROBES = list(
    itertools.product(("linear", "curvilinear", "phased"), (1.0, 20.0), (20.0, 250.0), (16, 512), (5.0, 250.0))
)


def of_a_scene_file(rng, corners):
    for kind, frequency, depth, lines, focus in corners:
        text = BLOCK.format(kind=kind, frequency=frequency, depth=depth, lines=lines, focus=focus)
        console = Console(Session(SceneFile.parse(text)))
        low = [ranges(console, "image")[name][0] for name in KNOBS]
        show(console, rng, low)
        show(console, rng, [0.0, depth, frequency, focus])


@pytest.mark.parametrize("kind", ["linear", "curvilinear", "phased"])
def test_a_probe_of_low_frequency_and_small_depth_gives_a_picture(rng, kind):
    of_a_scene_file(rng, [(kind, 1.0, 20.0, 16, 5.0)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["linear", "curvilinear", "phased"])
def test_every_probe_of_a_scene_file_gives_a_picture(rng, kind):
    of_a_scene_file(rng, [corner for corner in PROBES if corner[0] == kind])


@pytest.mark.slow
@pytest.mark.usefixtures("backend")
@pytest.mark.parametrize(("frequency", "depth"), [(1.0, 20.0), (20.0, 30.0)])
def test_presets_take_the_samples_their_pulse_needs(frequency, depth):
    probe = Probe.linear(frequency_mhz=frequency, depth_mm=depth, lines=16, aperture_mm=15)
    assert 0.1 < probe.sample_mm / probe.axial_sigma < 1.5
    scene = Phantom.uniform("liver", size_mm=(20, 10, 30))
    beams = Scanner(scene, probe, facing((10, 5, 0), depth=(0, 0, 1), right=(1, 0, 0))).render().beams
    assert beams.shape == (16, probe.samples)
    near = (probe.ranges > 3) & (probe.ranges < 10)
    assert 100 < beams[:, near].mean() < 150


def test_usual_presets_keep_their_samples():
    assert {probe().samples for probe in (Probe.linear, Probe.curvilinear, Probe.phased)} == {1024}


@pytest.mark.parametrize("model", ["kelvinlet", "paper"])
@pytest.mark.parametrize("count", [15, pytest.param(250, marks=pytest.mark.slow)])
def test_no_pose_within_the_limits_moves_tissue_further_than_the_needle_drags_it(rng, model, count):
    console = Console(Session(SceneFile.parse(SMALL), model=model))
    limits, side = ranges(console, "needle"), console.scene.tissue.grid.side
    wanted = {"kelvinlet": 1.2 * 0.0279, "paper": 1.05 * np.hypot(0.0266, 0.0041)}[model] * side
    moved = 0.0
    for _ in range(count):
        console.step(console.command.with_needle(depth=0.0))
        pose = {name: float(rng.choice([*ends, rng.uniform(*ends)])) for name, ends in limits.items()}
        pose["depth"] = float(rng.choice([0.06, 0.1, 0.3, 1.0, 10.0, limits["depth"][1]]))
        values = console.step(console.command.with_needle(**pose)).field.values
        moved = max(moved, float(np.linalg.norm(values, axis=-1).max()))
    assert 0.1 * wanted < moved <= wanted
