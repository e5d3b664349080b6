"""The server over real sockets: the protocol, bad manners, many clients, nothing left behind."""

import asyncio
import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

import sonospline as ss
from simulator_scenes import SMALL
from sonospline import cli
from sonospline.simulator import SceneFile, wire
from sonospline.simulator.connection import IN_FLIGHT, MOST_REFUSALS
from sonospline.simulator.guard import Guard
from sonospline.simulator.library import Entry, Library
from sonospline.simulator.server import Server

websockets = pytest.importorskip("websockets")
from websockets.sync.client import connect  # noqa: E402

SMALL_PAPER = SMALL.replace("[model]\n", '[model]\nuse = "paper"\n')


class Running:
    """A server in a thread of this process."""

    def __init__(self, **options):
        from pathlib import Path

        library = Library({"small": Entry(SceneFile.parse(SMALL_PAPER), Path())})
        self.server = Server(library, port=0, **options)
        ready = threading.Event()
        self.thread = threading.Thread(target=self.server.run, args=(lambda address: ready.set(),))
        self.thread.start()
        assert ready.wait(60)
        self.port = self.server.port

    def url(self, path="/live"):
        return f"ws://127.0.0.1:{self.port}{path}"

    def get(self, path, **headers):
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=20) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            with error:
                return error.code, error.read().decode()

    def stop(self):
        self.server.stop()
        self.thread.join(30)
        assert not self.thread.is_alive()


class Client:
    """A page without a screen."""

    def __init__(self, running, path="/live", **options):
        self._opening = connect(running.url(path), max_size=2**24, compression=None, **options)
        self.seq = 0
        self.frames = []

    def text(self, kind, seconds=60):
        """The next text message of a kind; frames on the way are drawn."""
        while True:
            message = self.socket.recv(timeout=seconds)
            if isinstance(message, str):
                values = json.loads(message)
                if values["type"] == kind:
                    return values
            else:
                self._keep(message)

    def ready(self):
        self.hello = self.text("hello")
        self.scene = self.text("scene")
        self.state = self.scene["state"]
        kind, self.geometry, self.payload = wire.read(self.socket.recv(timeout=60))
        assert kind == wire.GEOMETRY
        return self

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def ask(self, **needle):
        self.seq += 1
        self.state["needle"].update(needle)
        self.send(type="state", seq=self.seq, **self.state)
        return self.seq

    def frame(self, seq=None, seconds=60, draw=True):
        """The next frame, or the next that contains a state."""
        while True:
            message = self.socket.recv(timeout=seconds)
            if isinstance(message, bytes):
                header, payload = self._keep(message, draw)
                if seq is None or header["seq"] >= seq:
                    return header, payload

    def _keep(self, message, draw=True):
        kind, header, payload = wire.read(message)
        assert kind == wire.FRAME
        self.frames.append(header["frame"])
        if draw:
            self.send(type="drawn", frame=header["frame"])
        return header, payload

    def __enter__(self):
        self.socket = self._opening.__enter__()
        return self

    def __exit__(self, *problem):
        self._opening.__exit__(*problem)


@pytest.fixture(scope="module")
def running():
    server = Running(sessions=9)
    yield server
    server.stop()


@pytest.fixture
def page(running):
    with Client(running) as client:
        yield client.ready()


def test_hello_scene_and_geometry_are_as_the_protocol_says(page):
    assert page.hello["protocol"] == 1
    assert [scene["id"] for scene in page.hello["scenes"]] == ["small", "kidney", "gel", "cube"]
    scene = page.scene
    assert scene["frame"]["out"] == [0, -1, 0]
    assert scene["box"]["low"] == [0, 0, 0]
    assert scene["box"]["high"] == pytest.approx([120, 60, 70])
    assert [model["id"] for model in scene["models"]] == ["paper", "kelvinlet", "elastic"]
    assert scene["probe"]["kind"] == "linear"
    assert scene["limits"]["needle"]["depth"] == [0, 80]
    assert [target["id"] for target in scene["targets"]] == ["vessel", "beside"]
    assert page.state["needle"]["depth"] == 0
    assert [mesh["name"] for mesh in scene["meshes"]] == ["vessel", "skin", "grid"]
    offset = 0
    for about, told in zip(page.geometry["meshes"], scene["meshes"], strict=True):
        assert about == {key: told[key] for key in ("name", "vertices", "indices")}
        points = np.frombuffer(page.payload, "<f4", 3 * about["vertices"], offset).reshape(-1, 3)
        offset += points.nbytes
        indices = np.frombuffer(page.payload, "<u4", about["indices"], offset)
        offset += indices.nbytes
        assert indices.max() == about["vertices"] - 1
        assert np.isfinite(points).all()
    assert offset == len(page.payload)


def test_the_picture_sent_is_the_librarys(running, page):
    """Pixels, target and mesh of a frame against the library's own, made anew."""
    page.send(type="view", grid=True)
    header, payload = page.frame(page.ask(depth=30.0))
    while not header["mesh"]:  # at most 15 a second
        header, payload = page.frame(page.ask(depth=page.state["needle"]["depth"] + 0.25))
    world = running.server.library._worlds["small"]
    needle = ss.Needle(header["needle"]["entry"], header["needle"]["tip"])
    exact = ss.Insertion(world.tissue).advance(needle)
    field = ss.GridField.of(exact)
    pose = np.array(header["probe_to_reference"]).reshape(4, 4)
    imager = world.see(world.probe, pose)
    expected = imager.render(field, needle, frame=header["noise"], gain_db=0.0)
    assert (wire.read_pixels(header, payload) == expected.pixels).all()
    plane = expected.plane
    image_to_reference = np.array(header["image_to_reference"]).reshape(4, 4)
    assert image_to_reference[:3, 3] == pytest.approx(plane.points[0])
    last = image_to_reference @ [*(np.array(plane.shape[::-1]) - 1) * header["pixel"], 0, 1]
    assert last[:3] == pytest.approx(plane.points[-1])
    moved = exact.displacement(world.targets["vessel"][None])[0]
    target = header["target"]
    assert np.subtract(target["now"], target["rest"]) == pytest.approx(moved, abs=0.01)
    offset = -(-header["rows"] * header["columns"] // 4) * 4
    positions = np.frombuffer(payload, "<f4", 3 * header["mesh"], offset).reshape(-1, 3)
    assert header["grid"]
    assert positions == pytest.approx(world.deformed(field, grid=True), abs=1e-3)
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


def test_at_most_two_frames_are_in_flight(page):
    for _ in range(IN_FLIGHT):
        page.frame(draw=False)
    page.ask(depth=3.0)
    with pytest.raises(TimeoutError):
        page.socket.recv(timeout=0.6)
    page.send(type="drawn", frame=page.frames[-1])
    header, _ = page.frame(page.seq)
    assert header["state"]["needle"]["depth"] == 3
    assert IN_FLIGHT == 2


def test_frames_come_in_order_and_at_least_five_a_second(page):
    page.frame()
    end, count = time.monotonic() + 2.0, len(page.frames)
    while time.monotonic() < end:
        page.frame()
    assert len(page.frames) - count >= 8
    assert page.frames == list(range(page.frames[0], page.frames[-1] + 1))


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
    assert header["frozen"]
    assert header["state"]["needle"]["depth"] == 10
    with pytest.raises(TimeoutError):
        page.socket.recv(timeout=0.5)
    page.state["frozen"] = False
    header, _ = page.frame(page.ask(depth=15.0))
    assert (header["frozen"], header["state"]["needle"]["depth"]) == (False, 15)


@pytest.fixture(scope="module")
def patient_page(running):
    """One page for all the bad messages: it survives them."""
    with Client(running) as client:
        yield client.ready()


def nan_state(page):
    state = json.loads(json.dumps(page.state))
    state["needle"]["depth"] = float("nan")
    return json.dumps({"type": "state", "seq": page.seq + 1, **state})


def without(page, part):
    state = {key: value for key, value in page.state.items() if key != part}
    return json.dumps({"type": "state", "seq": page.seq + 1, **state})


@pytest.mark.parametrize(
    ("message", "what", "says"),
    [
        (lambda page: "push!", "message", "is not JSON"),
        (lambda page: "[" * 30_000, "message", "is not JSON"),
        (lambda page: "[1]", "message", "is no JSON object"),
        (lambda page: '{"type": "launch"}', "message", "type = 'launch' is not known; send one of state"),
        (lambda page: '{"type": ["state"]}', "message", "is not known"),
        (lambda page: b"\x00\x01", "message", "is binary"),
        (nan_state, "state", "needle.depth = nan is not finite"),
        (lambda page: without(page, "probe"), "state", "probe is missing; give a table of slide"),
        (lambda page: '{"type": "state", "seq": true}', "state", "seq = True is of the wrong kind"),
        (lambda page: '{"type": "drawn", "frame": 999999}', "drawn", "frame = 999999 is not in flight"),
        (lambda page: '{"type": "model", "model": "magic"}', "model", "choose one of paper"),
        (lambda page: '{"type": "target", "id": "moon"}', "target", "choose one of vessel"),
        (lambda page: '{"type": "scene", "id": "castle"}', "scene", "choose one of small"),
        (lambda page: '{"type": "restore"}', None, None),
    ],
)
def test_bad_messages_are_refused_and_the_session_goes_on(patient_page, message, what, says):
    page = patient_page
    page.frame(page.ask(depth=12.0))
    page.socket.send(message(page))
    if what is None:
        assert "no reset" in page.text("notice")["message"]
    else:
        refused = page.text("refused")
        assert refused["what"] == what
        assert says in refused["message"]
        assert "\n" not in refused["message"]
    header, _ = page.frame(page.ask(depth=13.0))
    assert header["state"]["needle"]["depth"] == 13
    time.sleep(0.55)  # 20 refusals in 10 s would be one too many


def test_states_out_of_order_or_beyond_limits_are_refused(page):
    page.frame(page.ask(depth=12.0))
    page.send(type="state", seq=page.seq, **page.state)
    refused = page.text("refused")
    assert (refused["what"], refused["seq"]) == ("state", page.seq)
    assert "out of order" in refused["message"]
    page.ask(u=900.0)
    assert "needle.u = 900 is out of range; give -60 to 60" in page.text("refused")["message"]
    header, _ = page.frame(page.ask(u=-34.0))
    assert header["state"]["needle"]["depth"] == 12


def test_too_many_refusals_close_the_connection(page):
    for _ in range(MOST_REFUSALS):
        page.socket.send("no")
    with pytest.raises(websockets.ConnectionClosed) as caught:
        while True:
            page.socket.recv(timeout=20)
    assert caught.value.rcvd.code == 1008


def test_an_oversized_message_closes_the_connection(running):
    with Client(running) as page:
        page.ready()
        page.socket.send("x" * 70_000)
        with pytest.raises(websockets.ConnectionClosed) as caught:
            while True:
                page.socket.recv(timeout=20)
    closing = caught.value.rcvd  # lost where the system resets a socket that was left with unread bytes
    assert closing is None or closing.code == 1009
    with Client(running) as page:
        page.ready().frame()


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
    while not isinstance(page.socket.recv(timeout=20), bytes):
        pass  # geometry
    header, _ = page.frame(page.ask(depth=5.0))
    assert header["state"]["needle"]["depth"] == 5


def test_a_scene_from_outside_reads_no_file_elsewhere(page):
    text = 'name = "spy"\n[tissue]\nsource = "volume"\nfile = "../../secret.mha"\n'
    page.send(type="open_scene", name="spy.toml", text=text)
    assert "lies outside the folder the server was started in" in page.text("refused")["message"]


@pytest.mark.parametrize("headers", [{"Origin": "http://evil.example"}, {"Origin": "null"}])
def test_a_foreign_origin_is_turned_away(running, headers):
    with Client(running, additional_headers=headers) as client:
        with pytest.raises(websockets.ConnectionClosed) as caught:
            client.text("hello")
        assert caught.value.rcvd.code == 1008
        assert "is not this page" in caught.value.rcvd.reason


def test_its_own_origin_is_let_in(running):
    origin = f"http://127.0.0.1:{running.port}"
    with Client(running, additional_headers={"Origin": origin}) as client:
        assert client.text("hello")["protocol"] == 1


def test_a_foreign_host_is_turned_away(running):
    assert running.get("/healthz", Host="evil.example")[0] == 421
    with socket.create_connection(("127.0.0.1", running.port)) as raw:
        raw.sendall(
            b"GET /live HTTP/1.1\r\nHost: evil.example\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        raw.settimeout(10)
        answer = b""
        with contextlib.suppress(TimeoutError):
            while b"Host evil.example" not in answer and (some := raw.recv(4096)):
                answer += some
    assert b"Host evil.example is not this server" in answer  # the reason in the closing frame
    assert b"hello" not in answer


def test_pages_health_and_schema(running):
    assert running.get("/healthz") == (200, "ok")
    status, body = running.get("/")
    assert (status == 503 and "make run" in body) or (status == 200 and "<html" in body)
    status, body = running.get("/api/scene-schema.json")
    assert json.loads(body)["title"] == "Sonospline scene"


def test_eight_clients_and_one_too_many():
    before = set(threading.enumerate())
    running = Running(sessions=8)
    with contextlib.ExitStack() as stack:
        pages = [stack.enter_context(Client(running)).ready() for _ in range(8)]
        for number, page in enumerate(pages):
            page.ask(depth=5.0 + number)
        for number, page in enumerate(pages):
            header, _ = page.frame(page.seq)
            assert header["state"]["needle"]["depth"] == 5.0 + number
        with Client(running) as ninth, pytest.raises(websockets.ConnectionClosed) as caught:
            ninth.text("hello")
        assert caught.value.rcvd.code == 1013
        assert "8 sessions are open" in caught.value.rcvd.reason
    end = time.monotonic() + 20
    while running.server.connections and time.monotonic() < end:
        time.sleep(0.02)
    assert not running.server.connections
    with Client(running) as again:
        again.ready().frame()
    running.stop()
    left = set(threading.enumerate()) - before
    assert not [thread for thread in left if thread.name.startswith("sonospline")]


def test_a_client_that_does_not_read_is_hung_up_on():
    """Its answers fill the socket, then the outbox; then that is enough."""
    from sonospline.simulator.connection import Connection

    async def fill():
        outbox = asyncio.Queue(4)
        connection = Connection(Library(), outbox)
        for _ in range(4):
            connection._tell({"type": "model", "model": "paper"})
        assert not connection.deaf
        connection._tell({"type": "model", "model": "paper"})
        assert connection.deaf
        assert outbox.qsize() == 4

    asyncio.run(fill())


def test_a_client_that_vanishes_leaves_nothing(running):
    sessions = [thread for thread in threading.enumerate() if thread.name == "sonospline-session"]
    client = Client(running).__enter__().ready()
    client.frame(client.ask(depth=9.0), draw=False)
    client.socket.socket.shutdown(socket.SHUT_RDWR)  # as a machine that goes away
    client.socket.socket.close()
    end = time.monotonic() + 20
    while time.monotonic() < end:
        left = [thread for thread in threading.enumerate() if thread.name == "sonospline-session"]
        if len(left) <= len(sessions):
            break
        time.sleep(0.02)
    assert len(left) <= len(sessions)
    with contextlib.suppress(Exception):
        client.__exit__(None, None, None)


def test_an_idle_session_is_closed():
    running = Running(idle_s=0.5)
    with Client(running) as page:
        page.ready()
        with pytest.raises(websockets.ConnectionClosed) as caught:
            while True:
                page.frame()
        assert (caught.value.rcvd.code, caught.value.rcvd.reason) == (1001, "idle")
    running.stop()


def test_a_token_is_demanded_where_others_can_reach():
    with pytest.raises(ValueError, match=r"--host = 0.0.0.0 can be reached by others; give --token"):
        Guard("0.0.0.0", 80)
    guard = Guard("0.0.0.0", 80, "long enough")
    headers = {"host": "myserver:80", "origin": "http://myserver:80"}
    assert guard.refusal(headers, "long enough") is None
    assert guard.refusal(headers, None) == "the token is missing or wrong"
    assert guard.refusal(headers, "wrong enough") == "the token is missing or wrong"


def test_a_token_works_over_the_wire():
    running = Running(token="open sesame")
    with Client(running) as client, pytest.raises(websockets.ConnectionClosed) as caught:
        client.text("hello")
    assert caught.value.rcvd.code == 1008
    with Client(running, "/live?token=open%20sesame") as client:
        assert client.text("hello")["protocol"] == 1
    running.stop()


def test_a_busy_port_is_one_clear_line(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert cli.main(["serve", "--port", str(port)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"--port = {port} on 127.0.0.1 is in use; give another one" in said


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--host", "0.0.0.0"], "give --token of at least 8 characters"),
        (["--scene", "castle"], "--scene = 'castle' is not known; give kidney, gel, cube, or a .toml file"),
        (["--scene", "none.toml"], "none.toml' cannot be read"),
        (["--port", "70000"], "--port = 70000 is out of range"),
        (["--labels", "a.nii", "--volume", "b.mha"], "--labels and --volume were both given"),
        (["--labels", "none.nii"], "--labels = 'none.nii' does not exist"),
        (["--names", "a.csv"], "--names belongs to --labels"),
        (["--idle", "0"], "--idle = 0"),
        (["--sessions", "0"], "--sessions = 0 is too small"),
    ],
)
def test_bad_options_are_one_clear_line(options, says, capsys):
    assert cli.main(["serve", *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


def test_the_verb_prints_its_address_and_ends_on_control_c(tmp_path):
    import signal

    (tmp_path / "small.toml").write_text(SMALL_PAPER)
    command = [sys.executable, "-m", "sonospline", "serve", "--port", "0", "--json", "--scene", "small.toml"]
    server = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    address = json.loads(server.stdout.readline())["address"]
    port = int(address.rsplit(":", 1)[1].rstrip("/"))
    with connect(f"ws://127.0.0.1:{port}/live", max_size=2**24) as page:
        assert json.loads(page.recv(timeout=60))["scene"] == "small"
        server.send_signal(signal.SIGINT)
        out, err = server.communicate(timeout=30)
    assert server.returncode == 0
    assert err == ""
    assert json.loads(out)["scene"] == "small"


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


def test_rough_use_leaves_the_server_well(tmp_path):
    """Seconds of what benchmarks/ten_minutes_of_use_leave_memory_flat.py does for ten minutes."""
    from sonospline.benchmark.soak import soak

    scene = tmp_path / "small.toml"
    scene.write_text(SMALL_PAPER)
    result = soak(str(scene), 6.0, visit_s=1.5)
    assert result["visits"] >= 3
    assert result["frames"] > 20
    assert (result["out_of_order"], result["refused"], result["faults"]) == (0, [], [])
    assert result["threads"]["after"] <= result["threads"]["before"]


def test_the_live_benchmark_measures_and_judges(tmp_path, capsys):
    scene = tmp_path / "small.toml"
    scene.write_text(SMALL_PAPER.replace("length_mm = 80.0", "length_mm = 120.0"))
    out = tmp_path / "bench"
    assert cli.main(["bench", "--live", "--scene", str(scene), "--seconds", "3", "--out", str(out), "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert results == json.loads((out / "live.json").read_text())
    assert results["out_of_order"] == 0
    assert results["latency"]["server_ms"]["frames"] > 5
    figures = {claim["claim"]: claim for claim in results["claims"]}
    median = figures["pose to encoded frame, median, ms"]
    assert median["figure"] == results["latency"]["server_ms"]["median"]
    assert median["kept"] == (median["figure"] <= 20)
    assert "| server ms |" in (out / "live.md").read_text()
