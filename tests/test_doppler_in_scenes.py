"""Colour Doppler in a scene: its box, its clock, and what of it goes to the page."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from sonospline import cli
from sonospline.io.records import FieldError
from sonospline.server import wire
from sonospline.simulator import Console, ImageSettings, SceneFile, Session, make_scene
from sonospline.simulator.imaging import colour_box
from sonospline.ultrasound import Probe
from sonospline.ultrasound.colour_flow import NO_FLOW

SCENE = """name = "Small block"
[tissue]
source = "gel block"
voxel_mm = 1.0
nodes = 5000
[probe]
kind = "linear"
frequency_mhz = 5
depth_mm = 40
lines = 64
right = [1.0, 0.0, 0.0]
[needle]
u = -34
angle = 38
"""
SETTINGS = ImageSettings(gain=0, depth=40, frequency=5, focus=20, colour="flow", prf=3000, steer=20, box_depth=24)


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SCENE))


@given(
    st.sampled_from([Probe.linear, Probe.curvilinear]), st.floats(15, 60), st.floats(30, 250), st.floats(1.5, 12),
    st.floats(-20, 20), st.floats(-40, 40), st.floats(0, 200), st.floats(500, 10_000),
)  # fmt: skip
def test_the_box_is_always_one_that_the_probe_hears(kind, aperture, depth, frequency, steer, across, deep, prf):
    probe = kind(aperture_mm=aperture, depth_mm=depth, frequency_mhz=frequency)
    asked = replace(SETTINGS, steer=steer, box_across=across, box_depth=deep, prf=prf)
    found = colour_box(probe, asked)
    found.check(probe)
    assert found.prf_hz <= prf


def test_off_there_is_none():
    assert colour_box(Probe.linear(), replace(SETTINGS, colour="off")) is None
    assert colour_box(Probe.phased(), SETTINGS) is None
    with pytest.raises(FieldError, match="colour = 'on'"):
        replace(SETTINGS, colour="on")


def test_blood_flows_by_the_clock_of_the_session_and_again_in_the_same_bits(scene):
    def frames():
        session = Session(scene, model="kelvinlet")
        return [session.step(settings=settings, dt=dt) for settings, dt in ((SETTINGS, 0.1), (None, 0.0), (None, 0.02))]

    first, again = frames(), frames()
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.image.shown, other.image.shown)
    levels = [frame.image.colour.levels for frame in first]
    assert first[0].moves and not Session(scene, model="kelvinlet").step().moves
    flows = levels[0] != NO_FLOW
    assert 0.2 < flows.mean() < 0.7
    assert (levels[0][flows] == levels[1][flows]).mean() > 0.2  # only noise is another
    assert (levels[0][flows] == levels[2][flows]).mean() < 0.2  # blood is, too


def test_off_the_scene_shows_the_bits_that_it_showed(scene):
    session = Session(scene, model="kelvinlet")
    off = replace(SETTINGS, colour="off")
    before = session.step(settings=off).image.pixels
    session.step(settings=SETTINGS)
    session.resume(None)
    assert np.array_equal(session.step(settings=off).image.pixels, before)


def test_the_page_gets_the_window_behind_everything_else(scene):
    console = Console(Session(scene, model="kelvinlet"))
    shown = console.step(replace(console.command, image=SETTINGS))
    summary = wire.PassSummary(time_s=0, passes=0, path_mm=None, blind_mm=None)
    positions = np.zeros((5, 3), np.float32)
    sent = wire.frame(shown, number=0, seq=0, guides=frozenset(), summary=summary, positions=positions)
    _, header, payload = wire.read(sent)
    colour, place = shown.image.colour, header["colour"]
    assert (place["row"], place["column"]) == colour.corner
    size = place["rows"] * place["columns"]
    assert np.array_equal(np.frombuffer(payload[-size:], np.int8).reshape(colour.levels.shape), colour.levels)
    assert place["nyquist_cm_s"] == pytest.approx(0.0385 * 3000 / 5) and len(place["outline"]) == 5
    plain = console.step(replace(console.command, image=replace(SETTINGS, colour="off")))
    _, header, payload = wire.read(wire.frame(plain, number=1, seq=0, guides=frozenset(), summary=summary))
    assert header["colour"] is None and len(payload) == header["rows"] * header["columns"]


@pytest.mark.parametrize(
    "options, said",
    [
        (["--doppler=-5,5,20"], "--doppler = '-5,5,20' is no box"),
        (["--doppler=-5,5,20,400"], "reaches beyond the image"),
        (["--prf", "3000"], "belong to --doppler"),
        (["--doppler=-5,5,20,40", "--prf", "0"], "prf"),
        (["--doppler=-5,5,20,40", "--steer", "10"], "convex face"),
        (["--doppler=-5,5,20,40", "--volume", "us.mha"], "give one of them"),
        (["--wide", "--volume", "us.mha"], "--wide is of the generated kidney"),
    ],
)
def test_the_command_line_refuses_what_cannot_be(options, said, tmp_path, capsys):
    assert cli.main(["image", "--voxel", "4", "--out", str(tmp_path / "out"), *options]) == 2
    assert said in capsys.readouterr().err


def test_a_recording_with_colours_replays_to_the_same_pictures(scene, tmp_path):
    pytest.importorskip("mcap", reason="mcap is not installed (pip install 'sonospline[record]')")
    from sonospline.training import Recorder, Recording, replay

    session = Session(scene, model="kelvinlet")
    with Recorder(tmp_path / "flow.mcap", scene) as recorder:
        for settings, dt in ((SETTINGS, 0.1), (None, 0.02), (replace(SETTINGS, prf=2000), 0.03)):
            recorder.add(session.step(settings=settings, dt=dt))
    assert [step.same for step in replay(Recording.read(tmp_path / "flow.mcap"), scene)] == [True] * 3
