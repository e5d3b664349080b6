"""Recordings: every frame again bit for bit, kills and full disks survived, what was changed is refused."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sonospline as ss
from simulator_scenes import SMALL
from sonospline import cli
from sonospline.simulator import SceneFile, Session, TissueSettings, make_scene
from sonospline.training import Recorder, Recording, Trace, measure, replay
from sonospline.training import recorder as recorder_module
from sonospline.training.step import step_of

pytest.importorskip("mcap", reason="mcap is not installed (pip install 'sonospline[record]')")
ENTRY = np.array([26.0, 30.0, 0.0])
BREATHING = """
[breathing]
cranial_face = "x-"
organ = ["blood", "vessel wall"]
depth = 0.2
"""


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


def needle(depth):
    return {"needle": ss.Needle(ENTRY, ENTRY + depth * np.array([0.8, 0, 0.6]))}


def pose(sweep):
    return ss.facing((60, 30 + sweep, 0), depth=(0, 0, 1), right=(1, 0, 0))


def attempt(session):
    """Frames of a session that does all there is to do, an undo among it."""
    yield session.step()
    for depth in (5, 10, 15):
        yield session.step(needles=needle(depth), dt=1 / 60)
    undone = session.last
    yield session.step(needles=needle(22), probe_to_reference=pose(2.0), dt=1 / 60)
    session.resume(undone)
    yield session.step(probe_to_reference=pose(-1.0), dt=1 / 30)
    session.switch("elastic")
    yield session.step(needles=needle(18), tissue=TissueSettings(contact="track"), dt=1 / 60)
    yield session.step(needles=needle(16), settings=msgspec.structs.replace(session.last.settings, gain=-3.0), dt=0.1)
    yield session.step(needles={}, dt=1 / 60)


def record(path, scene, frames=attempt):
    session = Session(scene, model="kelvinlet")
    with Recorder(path, scene) as recorder:
        made = []
        for frame in frames(session):
            recorder.add(frame)
            made.append(frame)
    return made


@pytest.fixture(scope="module")
def recorded(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "attempt.mcap"
    return path, record(path, scene)


def test_every_frame_comes_again_to_the_pixel(scene, recorded):
    path, frames = recorded
    recording = Recording.read(path)
    assert recording.whole
    again = list(replay(recording, scene))
    assert [found.same for found in again] == [True] * len(frames)
    for found, frame in zip(again, frames, strict=True):
        assert (found.frame.image.pixels == frame.image.pixels).all()
        assert (found.frame.field.values == frame.field.values).all()
        assert found.frame.target_now.tolist() == frame.target_now.tolist()
    assert [step.number for step in recording.attempt] == list(range(len(frames) - 1))  # what was undone is left out


@pytest.mark.slow
def test_a_patient_who_breathes_is_replayed_by_another_session_to_the_pixel(tmp_path):
    """Breath, hold and release, a needle that leaves a track: whatever another session made first."""
    scene = make_scene(SceneFile.parse(SMALL + BREATHING))

    def breathing(session):
        yield session.step(tissue=TissueSettings(breathing="free"), dt=0.5)
        session.switch("elastic")
        for k, word in enumerate(("free", "free", "held", "held", "free", "none")):
            tissue = TissueSettings(contact="track", breathing=word)
            yield session.step(needles=needle(6.0 + 3 * k), tissue=tissue, dt=0.4)

    frames = record(tmp_path / "breathing.mcap", scene, breathing)
    assert max(frame.readouts.excursion for frame in frames) > 1
    assert all(found.same for found in replay(Recording.read(tmp_path / "breathing.mcap"), scene))


def test_metrics_live_and_from_the_file_are_the_same_bits(scene, recorded):
    path, frames = recorded
    kept = [frame for k, frame in enumerate(frames) if k != 4]  # the one undone
    live = measure(Trace.of_frames([frame.time_s for frame in kept], kept, scene))
    from_file = measure(Recording.read(path).trace())
    assert all(live[name] == from_file[name] or live[name] != live[name] for name in live)
    assert from_file["passes"] == 1 and from_file["needle_path_mm"] > 15


def test_ten_minutes_take_less_than_ten_megabytes(scene, tmp_path, monkeypatch):
    """Needle and probe both in motion at every one of 60 frames a second."""
    clock = iter(np.arange(10**6) / 120)  # asked twice a frame, or so
    monkeypatch.setattr(recorder_module.time, "monotonic", lambda: float(next(clock)))

    def moving(session):
        first, now = session.step(needles=needle(20)), 0.0
        for k in range(600):
            moved, dt = needle(5 + 0.05 * np.sqrt(k)), round(1 / 60 + 1e-4 * float(np.sin(k)), 6)
            now += dt
            yield replace(first, number=k, time_s=now, dt=dt, needles=moved, probe_to_reference=pose(0.1 * np.sqrt(k)))

    record(tmp_path / "a.mcap", scene, moving)
    assert (tmp_path / "a.mcap").stat().st_size < 1e6 * 600 / 3600


RECORDING = """
import sys, time, numpy as np, sonospline as ss
from sonospline.simulator import SceneFile, Session, make_scene
from sonospline.training import Recorder
scene = make_scene(SceneFile.parse(sys.stdin.read()))
session, entry = Session(scene, model="kelvinlet"), np.array([26.0, 30.0, 0.0])
with Recorder(sys.argv[1], scene) as recorder:
    for k in range(10**6):
        needle = ss.Needle(entry, entry + (5 + k % 20) * np.array([0.8, 0, 0.6]))
        recorder.add(session.step(needles={"needle": needle}, dt=1 / 60))
        print(time.time(), k, flush=True)
"""


def killed(path, seconds):
    """A process that records is killed some time after its first step; the steps it had made a second before."""
    run = subprocess.Popen(
        [sys.executable, "-c", RECORDING, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    run.stdin.write(SMALL)
    run.stdin.close()
    first = run.stdout.readline()
    assert first
    time.sleep(seconds)
    end = time.time()
    os.kill(run.pid, signal.SIGKILL)
    steps = [first, *run.stdout.read().splitlines()]
    run.stdout.close()
    run.wait()
    made = [line.split() for line in steps if len(line.split()) == 2]
    return sum(float(at) < end - 1 for at, _ in made)


MOMENTS = np.linspace(0, 3, int(os.environ.get("SONOSPLINE_KILLS", "8")))
"""Thirty kills take five minutes; all of them passed."""


@pytest.mark.parametrize("seconds", [1.7, *(pytest.param(s, marks=pytest.mark.slow) for s in MOMENTS)])
def test_a_kill_loses_a_second_at_most(seconds, scene, tmp_path):
    path = tmp_path / "killed.mcap"
    least = killed(path, seconds)
    recording = Recording.read(path) if least else None
    if recording is not None:
        assert len(recording.steps) >= least
        assert not recording.whole
        assert all(found.same for found, _ in zip(replay(recording, scene), range(5), strict=False))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_file_cut_anywhere_opens_or_is_refused_in_one_line(data, recorded, tmp_path_factory):
    path, _ = recorded
    content = path.read_bytes()
    cut = tmp_path_factory.mktemp("cut") / "cut.mcap"
    cut.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    try:
        recording = Recording.read(cut)
    except ValueError as error:
        assert str(error).startswith("cut.mcap ") and "\n" not in str(error)
    else:
        assert not recording.whole
        assert len(recording.steps) <= len(Recording.read(path).steps)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_file_changed_by_hand_is_refused_or_reads_the_same(data, recorded, tmp_path_factory):
    path, _ = recorded
    content = bytearray(path.read_bytes())
    at = data.draw(st.integers(8, len(content) - 9))
    content[at] ^= data.draw(st.integers(1, 255))
    changed = tmp_path_factory.mktemp("changed") / "changed.mcap"
    changed.write_bytes(bytes(content))
    try:
        recording = Recording.read(changed)
    except ValueError as error:
        assert str(error).startswith("changed.mcap") and "\n" not in str(error)
    else:
        assert recording.steps == Recording.read(path).steps  # what was changed is of the index, which is not read


def test_a_full_disk_is_said_and_what_was_kept_stays(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "_KEPT_S", 0.0)  # every step is kept at once
    session = Session(scene, model="kelvinlet")
    recorder = Recorder(tmp_path / "full.mcap", scene)
    recorder.add(session.step())
    limits, before = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / "full.mcap").stat().st_size + 1500, limits[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            for depth in range(1, 20):
                recorder.add(session.step(needles=needle(depth), dt=1 / 60))
        session.step(needles=needle(30))  # the session goes on
        with pytest.raises(OSError, match="File too large"):
            recorder.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert 1 < len(Recording.read(tmp_path / "full.mcap").steps) < 20


def test_what_cannot_be_recorded_or_replayed_is_refused_in_one_line(scene, recorded, tmp_path):
    path, _ = recorded
    recording = Recording.read(path)
    session = Session(scene, model="kelvinlet")
    session.step()
    with pytest.raises(FileExistsError):
        Recorder(path, scene)
    with Recorder(tmp_path / "late.mcap", scene) as late, pytest.raises(ValueError, match=r"begin with .* first step$"):
        late.add(session.step())
    with pytest.raises(ValueError, match=r"is closed; make another"):
        late.add(session.last)
    other = make_scene(SceneFile.parse(SMALL.replace("voxel_mm = 1.0", "voxel_mm = 1.5")))
    with pytest.raises(ValueError, match=r"is not the one of the recording, .* give that one$"):
        replay(recording, other)
    (tmp_path / "no.mcap").write_bytes(b"not MCAP at all")
    with pytest.raises(ValueError, match=r"^no.mcap is no MCAP file"):
        Recording.read(tmp_path / "no.mcap")
    with pytest.raises(ValueError, match=r"^late.mcap holds no step"):
        Recording.read(tmp_path / "late.mcap")


def test_a_recording_of_another_format_is_refused(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "FORMAT", "0")
    record(tmp_path / "old.mcap", scene, lambda session: [session.step()])
    monkeypatch.undo()
    with pytest.raises(ValueError, match=r"^old.mcap is a recording of format '0'; this version reads 1 and 2: "):
        Recording.read(tmp_path / "old.mcap")


def test_a_recording_of_the_format_before_is_read(scene, recorded, tmp_path, monkeypatch):
    path, frames = recorded
    monkeypatch.setattr(recorder_module, "FORMAT", "1")

    def timed(frame, *of):
        return msgspec.structs.replace(step_of(frame, *of), time_s=frame.time_s)

    monkeypatch.setattr(recorder_module, "step_of", timed)
    with Recorder(tmp_path / "before.mcap", scene) as recorder:
        for frame in frames:
            recorder.add(frame)
    old, new = Recording.read(tmp_path / "before.mcap"), Recording.read(path)
    assert old.steps == new.steps and old.header["format"] == "1"


def test_the_verb_checks_every_pixel_and_prints_the_metrics(tmp_path, capsys):
    session = Session("cube", model="kelvinlet")
    path = tmp_path / "cube.mcap"
    with Recorder(path, session.scene) as recorder:
        recorder.add(session.step())
        for depth in (10, 20, 30):
            needles = {"needle": ss.Needle((50, 50, 0), (50, 50, depth))}
            recorder.add(session.step(needles=needles, dt=1 / 60))
    assert cli.main(["replay", str(path), "--out", str(tmp_path / "out"), "--json", "--quiet"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["steps"], report["same"], report["whole"], report["unlike"]) == (4, 4, True, "")
    assert report["metrics"]["needle_path_mm"] == pytest.approx(30)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["cine.gif", "cine.igs.mha", "metrics.json"]
    assert cli.main(["replay", str(path), "--no-frames"]) == 0
    assert "needle_path_mm" in capsys.readouterr().out
    assert cli.main(["replay", str(tmp_path / "none.mcap")]) == 1


def test_an_independent_reader_opens_it(recorded):
    """The index-based reader of the library, as Foxglove has it: topic, schema and JSON of each message."""
    from mcap.reader import make_reader

    path, frames = recorded
    with path.open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages(topics=["/steps"]))
    assert len(messages) == len(frames)
    schema, channel, message = messages[-1]
    assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
    assert json.loads(message.data)["number"] == frames[-1].number
    assert b'"probe_to_reference"' in schema.data
