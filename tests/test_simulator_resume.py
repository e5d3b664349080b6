"""A page that was reloaded or lost its socket comes back to its session; nobody else does, and not for ever."""

import socket
import time

import pytest

from simulator_client import Client, Running, websockets
from simulator_scenes import SMALL_PAPER
from sonospline.server import rate_limits, session_pool, speaker
from sonospline.simulator import Console, SceneFile, Session


def back(running, page):
    return Client(running, f"/live?session={page.hello['session']}")


def vanish(page):
    """As a page whose machine goes away: no closing handshake, frames in flight."""
    page.socket.socket.shutdown(socket.SHUT_RDWR)


def until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def nobody_is_connected(running):
    until(lambda: not running.server.connections)


@pytest.mark.parametrize("leave", [lambda page: page.socket.close(), vanish], ids=["reload", "lost socket"])
def test_the_pass_survives(running, leave):
    with Client(running) as page:
        page.ready()
        assert not page.hello["resumed"]
        page.send(type="model", model="kelvinlet")
        page.send(type="target", id="beside")
        page.frame(page.ask(depth=20.0))
        before, _ = page.frame(page.ask(depth=25.0))
        while before["pass"]["path_mm"] != pytest.approx(25):
            before, _ = page.frame()
        leave(page)
    nobody_is_connected(running)
    with back(running, page) as again:
        again.ready()
        assert again.hello["resumed"]
        assert again.hello["session"] == page.hello["session"]
        assert (again.scene["model"], again.scene["target"]) == ("kelvinlet", "beside")
        assert again.state == before["state"]
        header, _ = again.frame()
        assert header["seq"] == 0
        assert header["needle"] == before["needle"]
        assert header["readouts"]["moved"] == pytest.approx(before["readouts"]["moved"], rel=1e-3)
        assert header["pass"]["path_mm"] == before["pass"]["path_mm"]
        deeper, _ = again.frame(again.ask(depth=30.0))
        assert deeper["pass"]["passes"] == 1
        while deeper["pass"]["path_mm"] != pytest.approx(30):
            deeper, _ = again.frame()
        again.send(type="undo_pass")
        while again.frame()[0]["state"]["needle"]["depth"]:
            pass


def test_the_clock_of_the_pass_stands_still_meanwhile():
    now = [100.0]
    console = Console(Session(SceneFile.parse(SMALL_PAPER)), clock=lambda: now[0])
    console.step(console.command.with_needle(depth=10.0))
    now[0] += 2.0
    assert console.step(console.command.with_needle(depth=12.0)).metrics.time_s == 2
    console.pause()
    now[0] += 25.0
    console.pause()
    now[0] += 1.0
    assert console.step(console.command.with_needle(depth=13.0)).metrics.time_s == 2
    now[0] += 1.0
    assert console.step(console.command.with_needle(depth=14.0)).metrics.time_s == 3


def test_a_frozen_session_shows_its_picture_and_its_meshes_again(running):
    with Client(running) as page:
        page.ready()
        page.frame(page.ask(depth=25.0))
        page.state["frozen"] = True
        page.frame(page.ask())
    nobody_is_connected(running)
    with back(running, page) as again:
        again.ready()
        assert again.state["frozen"]
        header, _ = again.frame()
        assert header["state"]["frozen"]
        assert header["mesh"] > 0


def test_a_page_takes_over_from_its_own_socket_that_still_looks_alive(running):
    with Client(running) as page:
        page.ready()
        page.frame(page.ask(depth=15.0))
        with back(running, page) as again:
            again.ready()
            assert again.state["needle"]["depth"] == 15
            with pytest.raises(websockets.ConnectionClosed) as caught:
                while True:
                    page.socket.recv(timeout=20)
            assert caught.value.rcvd.code == speaker.TAKEN_OVER
            again.frame(again.ask(depth=16.0))


@pytest.mark.slow
def test_who_is_kept_gives_way_to_a_newcomer():
    running = Running(sessions=1)
    with Client(running) as page:
        page.ready().frame()
    nobody_is_connected(running)
    with Client(running) as other:
        other.ready().frame()
        with back(running, page) as again, pytest.raises(websockets.ConnectionClosed) as caught:
            again.text("hello")
        assert caught.value.rcvd.code == 1013
    nobody_is_connected(running)
    with back(running, page) as again:
        assert not again.ready().hello["resumed"]
        assert again.hello["session"] != page.hello["session"]
    running.stop()


def test_a_session_is_kept_for_a_while_only(running, monkeypatch):
    monkeypatch.setattr(session_pool, "KEPT_S", 0.05)
    with Client(running) as page:
        page.ready().frame()
    nobody_is_connected(running)
    until(lambda: page.hello["session"] not in running.server.pool._kept)
    with back(running, page) as again:
        assert not again.text("hello")["resumed"]


@pytest.mark.parametrize("key", ["", "x", "%00", "%ff", "a" * 4000, "../../etc/passwd"])
def test_a_key_nobody_has_opens_a_session_as_any_other(running, key):
    with Client(running, f"/live?session={key}") as page:
        hello = page.text("hello")
        assert not hello["resumed"]
        assert len(hello["session"]) > 20


def test_who_was_hung_up_on_does_not_come_back(running):
    with Client(running) as page:
        page.ready()
        for _ in range(rate_limits.MOST_REFUSALS):
            page.socket.send("no")
        with pytest.raises(websockets.ConnectionClosed):
            while True:
                page.socket.recv(timeout=20)
    nobody_is_connected(running)
    with back(running, page) as again:
        assert not again.text("hello")["resumed"]
