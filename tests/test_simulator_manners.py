"""The server and bad manners: nonsense, strangers, crowds, and clients that go away; nothing is left behind."""

import asyncio
import contextlib
import json
import random
import socket
import threading
import time

import pytest

from simulator_client import Client, Running, websockets
from simulator_scenes import SMALL_PAPER
from sonospline.server import rate_limits
from sonospline.server.client_messages import MessageError
from sonospline.server.connection import Connection
from sonospline.server.conversation import hang_up
from sonospline.server.live_session import MOST_ACTIONS
from sonospline.server.outbox import Outbox
from sonospline.server.rate_limits import MOST_MESSAGES_S, MOST_REFUSALS, REFUSALS_S, RateLimits
from sonospline.server.scene_catalog import SceneCatalog
from sonospline.server.server_messages import ModelMessage
from sonospline.server.speaker import GOING_AWAY, Verdict


@pytest.fixture(scope="module")
def patient_page(running):
    """One page for all the bad messages, fewer than ``MOST_REFUSALS``: it survives them."""
    with Client(running) as client:
        yield client.ready()


def nan_state(page):
    state = json.loads(json.dumps(page.state))
    state["needle"]["depth"] = float("nan")
    return json.dumps({"type": "command", "seq": page.seq + 1, **state})


def without(page, part):
    state = {key: value for key, value in page.state.items() if key != part}
    return json.dumps({"type": "command", "seq": page.seq + 1, **state})


@pytest.mark.parametrize(
    ("message", "what", "says"),
    [
        (lambda page: "push!", "message", "is not JSON"),
        (lambda page: "[" * 30_000, "message", "is not JSON"),
        (lambda page: "[1]", "message", "is no JSON object"),
        (lambda page: '{"type": "launch"}', "message", "type = 'launch' is not known; send one of command"),
        (lambda page: '{"type": ["state"]}', "message", "is not known"),
        (lambda page: b"\x00\x01", "message", "is binary"),
        (nan_state, "command", "needle.depth = nan is not finite"),
        (lambda page: without(page, "probe"), "command", "probe is missing; give a table of slide"),
        (lambda page: '{"type": "command", "seq": true}', "command", "seq = True is of the wrong kind"),
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


def test_states_out_of_order_or_beyond_limits_are_refused(page):
    page.frame(page.ask(depth=12.0))
    page.send(type="command", seq=page.seq, **page.state)
    refused = page.text("refused")
    assert (refused["what"], refused["seq"]) == ("command", page.seq)
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


def test_a_scene_from_outside_reads_no_file_elsewhere(page):
    text = 'name = "spy"\n[tissue]\nsource = "volume"\nfile = "../../secret.mha"\n'
    page.send(type="open_scene", name="spy.toml", text=text)
    assert "lies outside the folder the server was started in" in page.text("refused")["message"]


@pytest.mark.slow
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

    async def fill():
        outbox = Outbox(4)
        connection = Connection(SceneCatalog(), outbox)
        for _ in range(4):
            connection.sender.say(ModelMessage(model="paper"))
        assert not connection.verdict.done()
        connection.sender.say(ModelMessage(model="paper"))
        assert connection.verdict.result().reason == "messages are not read"
        assert len(outbox.texts()) == 4

    asyncio.run(fill())


def test_a_client_that_vanishes_leaves_nothing(running):
    sessions = [thread for thread in threading.enumerate() if thread.name == "sonospline-session"]
    client = Client(running).__enter__().ready()
    client.frame(client.ask(depth=9.0))
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
        with pytest.raises(websockets.ConnectionClosed) as caught:
            while True:
                page.frame()
        assert (caught.value.rcvd.code, caught.value.rcvd.reason) == (1001, "idle")
    running.stop()


@pytest.mark.slow
def test_rough_use_leaves_the_server_well(tmp_path):
    """Seconds of what benchmarks/ten_minutes_of_use_leave_memory_flat.py does for ten minutes."""
    from soak import soak

    scene = tmp_path / "small.toml"
    scene.write_text(SMALL_PAPER)
    result = soak(str(scene), 6.0, visit_s=1.5)
    assert result["visits"] >= 3
    assert result["frames"] > 20
    assert (result["out_of_order"], result["refused"], result["faults"]) == (0, [], [])
    assert result["threads"]["after"] <= result["threads"]["before"]


def test_messages_in_a_row_are_answered_in_a_row(running):
    with Client(running) as page:
        page.text("scene")
        for _ in range(MOST_MESSAGES_S // 2):
            page.send(type="ping")
        for _ in range(MOST_MESSAGES_S // 2):
            page.text("pong")


def test_the_rate_is_counted_over_a_second_and_refusals_over_ten(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(rate_limits.time, "monotonic", lambda: now[0])
    client = RateLimits()
    for _ in range(MOST_MESSAGES_S):
        client.count_message()
    now[0] += 0.99
    with pytest.raises(MessageError, match=f"came too fast; send at most {MOST_MESSAGES_S} a second"):
        client.count_message()
    now[0] += 0.01
    client.count_message()
    assert [client.count_refusal() for _ in range(MOST_REFUSALS)] == [False] * (MOST_REFUSALS - 1) + [True]
    now[0] += REFUSALS_S
    assert not client.count_refusal()


def test_commands_do_not_pile_up_behind_a_page_that_draws_nothing(running, page):
    """Paced by the rate that is let in, for one second and a bit more."""
    page.frame(page.ask(depth=5.0))
    for _ in range(2):
        page.frame(draw=False)
    runner = running.server.pool.connections[page.hello["session"]]._live._runner
    while runner.waiting < MOST_ACTIONS:
        page.send(type="undo_pass")
        time.sleep(1.1 / MOST_MESSAGES_S)
    page.send(type="undo_pass")
    assert "say which frames were drawn" in page.text("refused")["message"]
    assert runner.waiting <= MOST_ACTIONS
    page.send(type="drawn", frame=page.frames[-1])
    page.frame(page.ask(depth=6.0))


@pytest.mark.slow
def test_threads_and_places_stay_flat(running):
    """Clients that come, ask and leave in every way, one after the other."""
    with Client(running) as page:
        page.ready()
        page.send(type="open_scene", name="x.toml", text=SMALL_PAPER)
        page.text("scene")
        others = len(running.server.connections) - 1
    chance, threads = random.Random(13), None
    for number in range(60):
        client = Client(running).__enter__()
        for what in chance.sample(("scene", "state", "other scene", "nothing"), 2):
            if what == "scene":
                client.text("scene")
            elif what == "other scene":
                client.send(type="open_scene", name="x.toml", text=SMALL_PAPER)
        if chance.random() < 0.5:
            client.socket.socket.shutdown(socket.SHUT_RDWR)
        with contextlib.suppress(Exception):
            client.__exit__(None, None, None)
        if number == 20:
            until(lambda: len(running.server.connections) <= others)
            threads = server_threads()
    until(lambda: len(running.server.connections) <= others)
    assert sorted(server_threads()) == sorted(threads)


def server_threads():
    """Names of the threads that are not the clients'."""
    names = [thread.name for thread in threading.enumerate()]
    return [name for name in names if "recv_events" not in name and "keepalive" not in name]


def until(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_client_that_is_gone_when_it_is_hung_up_on_is_no_fault():
    """A page that is loaded anew takes its session over while its old socket breaks."""
    gone = pytest.importorskip("starlette.websockets").WebSocketDisconnect

    class Broken:
        async def close(self, code, reason):
            raise gone(1006)

    asyncio.run(hang_up(Broken(), Verdict(GOING_AWAY, "idle")))
