"""Exercises over real sockets: what is on the wire, what is refused, what is kept, and pictures made again."""

import errno
import json
import re
from pathlib import Path

import numpy as np
import pytest

from simulator_client import Client, Running
from simulator_scenes import SMALL_PAPER
from small_exercise import EXERCISE
from sonospline.server import wire
from sonospline.server.exercise_catalog import ExerciseCatalog, ExerciseEntry, read_folder
from sonospline.training import Exercise, Recording, measure
from sonospline.training.attempt_recording import Recordings

pytest.importorskip("mcap")

BLIND = (
    EXERCISE.replace("guides = []", 'guides = []\ntarget_in = ["blood"]')
    + """
swing = [-20.0, 20.0]

[entry_zone]
u = [-36.0, -14.0]
v = [-10.0, 10.0]

[pass_mark]
final_error_mm = {most = 3.0}
passes = {most = 1}
"""
)
COMMENTS = [{"time_s": 0.5, "text": "Sweep first."}, {"time_s": 2.0, "text": "Slower."}]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A server with an exercise by the image, and one with every guide, and the folder of its recordings."""
    folder = tmp_path_factory.mktemp("course")
    (folder / "small.toml").write_text(SMALL_PAPER)
    guided = BLIND.replace("guides = []", 'guides = ["path", "target", "tip", "numbers", "3-D view"]')
    own = {
        name: ExerciseEntry(Exercise.parse(text), folder) for name, text in (("blind", BLIND), ("guided", guided))
    }  # fmt: skip
    running = Running(ExerciseCatalog(own, recordings=Recordings(folder / "kept")))
    yield running, folder / "kept"
    running.stop()


class Trainee(Client):
    """A page that keeps every message."""

    def begin(self, exercise, **options):
        self.said = []
        self.send(type="begin_attempt", exercise=exercise, **options)
        self.scene = self.heard("scene")
        self.said = self.said[-1:]
        self.state = self.scene["state"]
        return self.scene["attempt"]

    def heard(self, kind, until=lambda values: True):
        """The next message of a kind, text or (by number) binary; all that came are kept."""
        while True:
            message = self.socket.recv(timeout=60)
            self.said.append(message)
            if isinstance(message, str):
                values = json.loads(message)
                found = values["type"] == kind
            else:
                number, values, payload = wire.read(message)
                found = number == kind
                if number == wire.FRAME:
                    self.send(type="drawn", frame=values["frame"])
                    self.pixels = wire.read_pixels(values, payload)
            if found and until(values):
                return values

    def come(self, **needle):
        """Ask for a place and wait for its frame."""
        seq = self.ask(**needle)
        return self.heard(wire.FRAME, lambda header: header["seq"] >= seq)

    def push(self, depth):
        """Go into the zone and in, some steps, so that time passes."""
        for share in np.linspace(0.2, 1, 5):
            header = self.come(u=-25.0, v=0.0, depth=float(share * depth))
        return header


@pytest.fixture
def trainee(served):
    with Trainee(served[0]) as client:
        client.ready()
        yield client


def trainee_scene(served):
    """The scene that the exercises share."""
    return next(scene for scene in served[0].server.catalog._made.values() if "middle" in scene.targets)


def numbers_in(message):
    """Every number of a message's texts."""
    text = message if isinstance(message, str) else json.dumps(wire.read(message)[1])
    return {round(float(found), 3) for found in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)}


def test_what_an_exercise_forbids_is_not_on_the_wire(served, trainee):
    attempt = trainee.begin("blind")
    assert attempt["exercise"]["guides"] == []
    header = trainee.push(20.0)
    served[0].server.catalog._offered.submit(int).result(60)  # whatever was to be made is made
    header = trainee.heard(wire.FRAME)
    assert header["pass"]["passes"] == 1 and header["pass"]["path_mm"] is None
    frames = [wire.read(message) for message in trainee.said if not isinstance(message, str)]
    assert {kind for kind, _, _ in frames} == {wire.FRAME}, "no meshes"
    for _, found, payload in frames:
        assert [found[part] for part in ("needle", "target", "readouts", "log")] == [None, None, None, []]
        assert len(payload) == -(-found["rows"] * found["columns"] // 4) * 4, "nothing but the picture"
    scene = trainee_scene(served)
    hidden = {round(float(value), 3) for value in scene.targets["middle"]}
    assert not any(hidden <= numbers_in(message) for message in trainee.said)
    trainee.send(type="give_up")
    debrief = trainee.heard("debrief")
    trainee.heard(wire.GEOMETRY)
    assert debrief["ended"] == "given up" and not debrief["passed"]
    assert debrief["course"]["tip"][-1] is not None, "the truth comes with the debrief"


def test_a_guided_one_has_all_of_it(trainee):
    trainee.begin("guided")
    trainee.heard(wire.GEOMETRY)
    header = trainee.push(10.0)
    assert header["needle"] and header["target"] and header["readouts"]["depth"] == 10


def test_an_attempt_ends_in_a_debrief_that_the_recording_bears_out(served, trainee):
    attempt = trainee.begin("blind", seed=7)
    assert (attempt["seed"], attempt["recorded"]) == (7, "")
    seen = {}
    for depth in (5.0, 12.0, 18.0, 24.0):
        header = trainee.come(u=-25.0, v=0.0, depth=depth)
        seen[header["noise"]] = trainee.pixels
    trainee.send(type="on_target")
    debrief = trainee.heard("debrief")
    assert debrief["ended"] == "on target" and debrief["problem"] == ""
    assert [one["kind"] for one in debrief["happened"]][-1] == "end"
    newest = max(served[1].glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    recording = Recording.read(newest)
    assert (recording.whole, recording.header["seed"], len(recording.steps)) == (True, "7", debrief["steps"])
    from_file = measure(recording.trace(), Exercise.parse(BLIND).task)
    told = {metric["name"]: metric["value"] for metric in debrief["metrics"]}
    assert told == {name: None if np.isnan(value) else value for name, value in from_file.items()}
    for step in (debrief["steps"] - 1, 0, *sorted(seen)):  # frames are numbered as steps are
        trainee.send(type="show_step", step=step)
        header = trainee.heard(wire.FRAME, lambda header, step=step: (header["replay"] or {}).get("step") == step)
        assert header["replay"]["same"]
        for needle in (recording.steps[step].needles or {}).values():
            np.testing.assert_allclose(header["needle"]["tip"], needle.tip, atol=1e-3)  # hidden before, now shown
        if step in seen:
            np.testing.assert_array_equal(trainee.pixels, seen[step])
    trainee.ask(depth=3.0)
    assert "an attempt is talked about" in trainee.heard("refused")["message"]
    again = trainee.begin("blind", seed=7)
    assert again["seed"] == 7 and trainee.scene["start"]["needle"]["angle"] == trainee.state["needle"]["angle"]


@pytest.mark.parametrize("what", ["undo_pass", "reset", "restore", "model", "target"])
def test_what_would_be_a_way_around_is_refused(trainee, what):
    trainee.begin("blind")
    trainee.send(type=what, **{"model": {"model": "elastic"}, "target": {"id": "beside"}}.get(what, {}))
    assert trainee.heard("refused")["message"] == "is not part of an exercise; give up first"
    seq = trainee.ask(u=5.0, depth=2.0)
    refused = trainee.heard("refused")
    assert refused["seq"] == seq and "is beside the entry zone; enter at -36 to -14 mm" in refused["message"]


def test_a_page_that_comes_back_goes_on_where_it_was(served):
    running = served[0]
    with Trainee(running) as page:
        page.ready()
        page.begin("blind", seed=3)
        page.push(15.0)
    with Trainee(running, f"/live?session={page.hello['session']}") as again:
        again.said = []
        assert again.heard("hello")["resumed"]
        scene = again.heard("scene")
        assert scene["attempt"]["seed"] == 3 and scene["state"]["needle"]["depth"] == 15
        again.state = scene["state"]
        assert again.come(depth=18.0)["pass"]["passes"] == 1
        again.send(type="on_target")
        first = again.heard("debrief")
        for time_s, text in ((2.0, "Slower."), (0.5, " Sweep first. "), (1.0, "  ")):
            again.send(type="add_comment", time_s=time_s, text=text)
        assert again.heard("comments", lambda said: len(said["comments"]) == 2)["comments"] == COMMENTS
        assert "give 1 to 500" in again.heard("refused")["message"]
    with Trainee(running, f"/live?session={page.hello['session']}") as third:
        third.said = []
        assert third.heard("scene")["attempt"]["seed"] == 3
        assert third.heard("debrief") == first
        assert third.heard("comments")["comments"] == COMMENTS, "kept beside the recording"


def test_a_full_disk_is_said_at_once_and_the_attempt_goes_on(served, trainee, monkeypatch):
    trainee.begin("blind")
    trainee.push(5.0)
    recording = served[0].server.pool.connections[trainee.hello["session"]]._live.stage.recording

    def full(frame):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(recording._recorder, "add", full)
    trainee.ask(depth=8.0)
    assert trainee.heard("notice")["message"] == "The attempt is not recorded: No space left on device"
    assert trainee.come(depth=9.0)["state"]["needle"]["depth"] == 9
    trainee.send(type="on_target")
    debrief = trainee.heard("debrief")
    assert debrief["problem"] == "The attempt is not recorded: No space left on device"
    assert debrief["course"]["depth"][-1] == 9


def test_a_folder_of_exercises_is_read_or_refused_in_one_line(tmp_path):
    with pytest.raises(ValueError, match=r"holds no \.toml file; give a folder of exercises$"):
        read_folder(tmp_path)
    (tmp_path / "mine.toml").write_text(BLIND)
    assert list(read_folder(tmp_path)) == ["mine"]
    (tmp_path / "worse.toml").write_text(BLIND.replace("passes = {most = 1}", "speed = {most = 1}"))
    with pytest.raises(ValueError, match=r"worse\.toml.*speed.*is no metric"):
        read_folder(tmp_path)


def test_an_exercise_that_does_not_fit_is_refused_and_practice_goes_on(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL_PAPER)
    nowhere = Exercise.parse(BLIND.replace('target = "middle"', 'target = "spleen"'))
    running = Running(ExerciseCatalog({"nowhere": ExerciseEntry(nowhere, Path(tmp_path))}))
    try:
        with Trainee(running) as page:
            page.ready()
            page.said = []
            page.send(type="begin_attempt", exercise="nowhere")
            refused = page.heard("refused")
            assert refused["what"] == "begin_attempt" and "is not in its scene" in refused["message"]
            assert page.come(depth=4.0)["state"]["needle"]["depth"] == 4
    finally:
        running.stop()
