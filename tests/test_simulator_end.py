"""How a server ends: at once, whatever is in work, by whatever signal, and the next one starts well."""

import contextlib
import json
import random
import re
import signal
import subprocess
import sys
import time

import pytest

from simulator_client import connect
from simulator_scenes import SMALL_PAPER

KILLS = 39
ENDLESS = """
import sys, time
from sonospline import cli
from sonospline.simulator import scene_maker

real = scene_maker.make_scene

def make(spec, **options):
    if spec.name == "endless":
        time.sleep(600)  # as a reader that waits in C: no signal, no exception reaches it
    return real(spec, **options)

scene_maker.make_scene = make
sys.exit(cli.main(["serve", "--port", "0", "--json", "--scene", "small.toml"]))
"""


@contextlib.contextmanager
def serving(folder, *start):
    (folder / "small.toml").write_text(SMALL_PAPER)
    command = [
        sys.executable,
        *(start or ("-m", "sonospline", "serve", "--port", "0", "--json", "--scene", "small.toml")),
    ]
    server = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield server
    finally:
        server.kill()
        server.communicate(timeout=30)


def port_of(server):
    return int(re.search(r":(\d+)/", json.loads(server.stdout.readline())["address"])[1])


def text(page, kind):
    while True:
        message = page.recv(timeout=60)
        if isinstance(message, str) and json.loads(message)["type"] == kind:
            return json.loads(message)


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), pytest.param(signal.SIGINT, 0, marks=pytest.mark.slow)]
)
def test_a_scene_that_is_never_made_holds_up_neither_others_nor_the_end(tmp_path, number, code):
    with serving(tmp_path, "-c", ENDLESS) as server:
        here = f"ws://127.0.0.1:{port_of(server)}/live"
        with connect(here, max_size=2**24) as page, connect(here, max_size=2**24) as other:
            text(page, "scene")
            brought = SMALL_PAPER.replace("Small block", "endless")
            page.send(json.dumps({"type": "open_scene", "name": "endless.toml", "text": brought}))
            text(page, "loading")
            text(other, "scene")
            server.send_signal(number)
            out, err = server.communicate(timeout=30)
    assert server.returncode == code
    assert err == ""
    if code == 0:
        assert json.loads(out)["scene"] == "small"


@pytest.mark.slow
def test_a_text_whose_page_has_left_is_not_made(running, monkeypatch):
    """Two texts wait behind one that takes long; one of them is given up."""
    import threading

    from simulator_client import Client
    from sonospline.simulator import scene_maker

    made, begun, go_on, real = [], threading.Event(), threading.Event(), scene_maker.make_scene

    def make(spec, **options):
        made.append(spec.name)
        begun.set()
        assert go_on.wait(60)
        return real(spec, **options)

    with Client(running) as first, Client(running) as second, Client(running) as third:
        for page in (first, second, third):
            page.ready()
        monkeypatch.setattr(scene_maker, "make_scene", make)
        for name, page in (("one", first), ("two", second), ("three", third)):
            brought = SMALL_PAPER.replace("Small block", name)
            page.send(type="open_scene", name=f"{name}.toml", text=brought)
            assert page.text("loading")["scene"] == f"{name}.toml"
            assert begun.wait(60)
        second.socket.close()
        end = time.monotonic() + 20
        while len(running.server.connections) > 2:
            assert time.monotonic() < end
            time.sleep(0.01)
        go_on.set()
        assert first.text("scene")["name"] == "one"
        assert third.text("scene")["name"] == "three"
    assert made == ["one", "three"]


@pytest.mark.slow
def test_servers_killed_alive_leave_the_next_one_well(tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    chance = random.Random(13)
    for _ in range(KILLS):
        number = chance.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGINT))
        with serving(tmp_path) as server:
            here = f"ws://127.0.0.1:{port_of(server)}/live"
            with contextlib.ExitStack() as pages:
                opened = [pages.enter_context(connect(here, max_size=2**24)) for _ in range(chance.randrange(3))]
                for page in opened[: chance.randrange(3)]:
                    text(page, "scene")
                server.send_signal(number)
                _, err = server.communicate(timeout=30)
        assert server.returncode == {signal.SIGINT: 0, signal.SIGTERM: 143}.get(number, -number)
        assert err == ""
    with serving(tmp_path) as server, connect(f"ws://127.0.0.1:{port_of(server)}/live", max_size=2**24) as page:
        assert text(page, "scene")["name"] == "Small block"
