"""The server over real sockets: what the protocol says, and what the picture shows."""

import asyncio
import json
import threading
import time

import numpy as np
import pytest

import sonospline as ss
from simulator_client import websockets
from simulator_scenes import SMALL, SMALL_PAPER
from sonospline.server import wire
from sonospline.simulator import Console


def test_hello_scene_and_geometry_are_as_the_protocol_says(page):
    assert page.hello["protocol"] == 5
    assert [scene["id"] for scene in page.hello["scenes"]] == ["small", "kidney", "kidney-wide", "gel", "cube"]
    scene = page.scene
    assert scene["frame"]["out"] == [0, -1, 0]
    assert scene["box"]["low"] == [0, 0, 0]
    assert scene["box"]["high"] == pytest.approx([120, 60, 70])
    assert [model["id"] for model in scene["models"]] == ["paper", "kelvinlet", "elastic"]
    first, last = scene["probe"]["beams"][0], scene["probe"]["beams"][-1]
    assert [*first, *last] == pytest.approx([-19, 0, 0, 1, 19, 0, 0, 1])
    knobs = {knob["id"]: knob for knob in scene["knobs"]}
    assert (knobs["needle.depth"]["low"], knobs["needle.depth"]["high"]) == (0, 80)
    assert knobs["image.gain"]["keys"] == ["Minus", "Equal"]
    assert [target["id"] for target in scene["targets"]] == ["vessel", "beside"]
    assert page.state["needle"]["depth"] == 0
    assert scene["start"] == scene["state"]
    assert [(mesh["name"], mesh["kind"]) for mesh in page.geometry["meshes"]] == [
        ("vessel", "surface"), ("skin", "surface"), ("grid", "lines"),
    ]  # fmt: skip
    offset = 0
    for about in page.geometry["meshes"]:
        points = np.frombuffer(page.payload, "<f4", 3 * about["vertices"], offset).reshape(-1, 3)
        offset += points.nbytes
        indices = np.frombuffer(page.payload, "<u4", about["indices"], offset)
        offset += indices.nbytes
        assert indices.max() == about["vertices"] - 1
        assert np.isfinite(points).all()
    assert offset == len(page.payload)


@pytest.mark.slow
def test_the_picture_sent_is_the_librarys(running, page):
    """Pixels, target and mesh of a frame against the library's own, made anew."""
    page.send(type="view", grid=True)
    header, payload = page.frame(page.ask(depth=30.0))
    while not header["mesh"]:  # at most 15 a second
        header, payload = page.frame(page.ask(depth=page.state["needle"]["depth"] + 0.25))
    scene = next(iter(running.server.catalog._made.values()))
    needle = ss.Needle(header["needle"]["entry"], header["needle"]["tip"])
    exact = ss.Insertion(scene.tissue).advance(needle)
    field = ss.GridField.of(exact)
    pose = np.array(header["probe_to_reference"]).reshape(4, 4)
    imager = scene.see(scene.probe, pose)
    expected = imager.render(field, needle, frame=header["noise"], settings=scene.start.image)
    assert (wire.read_pixels(header, payload) == expected.pixels).all()
    plane = expected.plane
    image_to_reference = np.array(header["image_to_reference"]).reshape(4, 4)
    assert image_to_reference[:3, 3] == pytest.approx(plane.points[0])
    last = image_to_reference @ [*(np.array(plane.shape[::-1]) - 1) * header["pixel"], 0, 1]
    assert last[:3] == pytest.approx(plane.points[-1])
    moved = exact.displacement(scene.targets["vessel"][None])[0]
    target = header["target"]
    assert np.subtract(target["now"], target["rest"]) == pytest.approx(moved, abs=0.01)
    offset = -(-header["rows"] * header["columns"] // 4) * 4
    positions = np.frombuffer(payload, "<f4", 3 * header["mesh"], offset).reshape(-1, 3)
    assert header["grid"]
    assert positions == pytest.approx(scene.deformed(field, grid=True), abs=1e-3)
    assert offset + positions.nbytes == len(payload)


def test_pushing_and_pulling_back(page):
    page.frame()
    pushed, _ = page.frame(page.ask(depth=35.0))
    assert pushed["state"]["needle"]["depth"] == 35
    assert pushed["readouts"]["moved"] > 0.2
    assert 0 < pushed["server_ms"] < 60_000
    out, _ = page.frame(page.ask(depth=0.0))
    assert out["readouts"]["moved"] == 0
    assert out["pass"]["passes"] == 1


@pytest.mark.parametrize("ahead", [0, 1])
def test_at_most_two_frames_are_in_flight_and_one_where_the_page_is_slow(page, ahead):
    page.send(type="view", grid=False, ahead=ahead)
    page.frame(page.ask(depth=1.0))  # by then it has heard
    for _ in range(1 + ahead):
        page.frame(draw=False)
    page.ask(depth=3.0)
    with pytest.raises(TimeoutError):
        page.socket.recv(timeout=0.6)
    page.send(type="drawn", frame=page.frames[-1])
    header, _ = page.frame(page.seq)
    assert header["state"]["needle"]["depth"] == 3


@pytest.mark.slow
def test_a_server_at_work_on_a_frame_still_answers_a_ping(page, monkeypatch):
    at_work, go_on = threading.Event(), threading.Event()

    def slow_step(console, command=None, dt=0.0, step=Console.step):
        at_work.set()
        go_on.wait(60)
        return step(console, command, dt)

    monkeypatch.setattr(Console, "step", slow_step)
    seq = page.ask(depth=4.0)
    try:
        assert at_work.wait(60)
        page.send(type="ping")
        assert page.text("pong") == {"type": "pong"}
    finally:
        go_on.set()
    assert page.frame(seq)[0]["state"]["needle"]["depth"] == 4


@pytest.mark.slow
def test_frames_come_in_order_and_at_least_five_a_second(page):
    page.frame()
    end, count = time.monotonic() + 2.0, len(page.frames)
    while time.monotonic() < end:
        page.frame()
    assert len(page.frames) - count >= 8
    assert page.frames == list(range(page.frames[0], page.frames[-1] + 1))


def test_frames_decode_in_an_event_loop_too(running):
    """The asyncio client that the benchmark uses sees the same frames."""

    async def first():
        async with websockets.connect(running.url(), max_size=2**24, compression=None) as socket_:
            async for message in socket_:
                if isinstance(message, bytes) and wire.read(message)[0] == wire.FRAME:
                    return wire.read(message)
        return None

    _, header, payload = asyncio.run(asyncio.wait_for(first(), 60))
    assert wire.read_pixels(header, payload).shape == (header["rows"], header["columns"])


def test_models_targets_undo_reset_restore(page):
    page.send(type="model", model="kelvinlet")
    assert page.text("model")["model"] == "kelvinlet"
    page.send(type="target", id="beside")
    assert page.text("target")["id"] == "beside"
    header, _ = page.frame(page.ask(depth=30.0))
    assert (header["model"], header["target"]["id"]) == ("kelvinlet", "beside")

    def frame_after(**message):
        page.send(**message)
        while True:
            header, _ = page.frame()
            if header["state"]["needle"]["depth"] != depth:
                return header

    depth = 30.0
    assert frame_after(type="undo_pass")["state"]["needle"]["depth"] == 0
    page.frame(page.ask(depth=20.0))
    depth = 20.0
    assert frame_after(type="reset")["pass"]["passes"] == 0
    depth = 0.0
    assert frame_after(type="restore")["state"]["needle"]["depth"] == 20


def test_freezing_holds_until_released(page):
    page.frame(page.ask(depth=10.0))
    page.state["frozen"] = True
    header, _ = page.frame(page.ask(depth=15.0))
    assert header["state"]["frozen"]
    assert header["state"]["needle"]["depth"] == 10
    with pytest.raises(TimeoutError):
        page.socket.recv(timeout=0.5)
    page.state["frozen"] = False
    header, _ = page.frame(page.ask(depth=15.0))
    assert (header["state"]["frozen"], header["state"]["needle"]["depth"]) == (False, 15)


@pytest.mark.slow
def test_another_scene_takes_over_and_a_bad_one_does_not(page):
    page.frame(page.ask(depth=12.0))
    page.send(type="open_scene", name="bad.toml", text=SMALL.replace("lines = 64", "lines = 6"))
    refused = page.text("refused")
    assert (refused["what"], refused["file"], refused["line"]) == ("scene", "bad.toml", 23)
    assert "probe.lines = 6 is out of range; give a whole number from 16 to 512" in refused["message"]
    header, _ = page.frame(page.ask(depth=14.0))
    assert header["state"]["needle"]["depth"] == 14
    page.send(type="open_scene", name="good.toml", text=SMALL_PAPER.replace("Small block", "Another block"))
    assert page.text("loading")["name"] == "good.toml"
    scene = page.text("scene")
    assert (scene["id"], scene["name"]) == ("good.toml", "Another block")
    page.state = scene["state"]
    page.meshes()
    header, _ = page.frame(page.ask(depth=5.0))
    assert header["state"]["needle"]["depth"] == 5


def test_pages_health_and_schema(running):
    assert running.get("/healthz") == (200, "ok")
    status, body = running.get("/")
    assert (status == 503 and "./run" in body) or (status == 200 and "<html" in body)
    status, body = running.get("/api/protocol-schema.json")
    assert (status, json.loads(body)["title"]) == (200, "Protocol")
    status, body = running.get("/api/scene-schema.json")
    assert json.loads(body)["title"] == "Sonospline scene"
