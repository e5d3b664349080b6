"""A server in this process, and a page without a screen, for tests over real sockets."""

import json
import threading
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from simulator_scenes import SMALL_PAPER
from sonospline.server import wire
from sonospline.server.scene_catalog import Entry, SceneCatalog
from sonospline.server.server import Server
from sonospline.simulator import SceneFile

websockets = pytest.importorskip("websockets")
from websockets.sync.client import connect  # noqa: E402


class Running:
    """A server in a thread of this process."""

    def __init__(self, exercises=None, **options):
        catalog = SceneCatalog({"small": Entry(SceneFile.parse(SMALL_PAPER), Path())}, exercises=exercises)
        self.server = self.made(catalog, port=0, **options)
        ready = threading.Event()
        self.thread = threading.Thread(target=self.server.run, args=(lambda address: ready.set(),))
        self.thread.start()
        assert ready.wait(60)
        self.port = self.server.port

    def made(self, catalog, **options):
        return Server(catalog, **options)

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
        self.meshes()
        return self

    def meshes(self):
        """Wait for the geometry, which follows the first frame."""
        header, _ = self.frame()
        assert header["mesh"] == 0
        while True:
            kind, self.geometry, self.payload = self._take()
            if kind == wire.GEOMETRY:
                return

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def ask(self, **needle):
        self.seq += 1
        self.state["needle"].update(needle)
        self.send(type="command", seq=self.seq, **self.state)
        return self.seq

    def frame(self, seq=None, seconds=60, draw=True):
        """The next frame, or the next that contains a state."""
        while True:
            kind, header, payload = self._take(seconds, draw)
            if kind == wire.FRAME and (seq is None or header["seq"] >= seq):
                return header, payload

    def _take(self, seconds=60, draw=True):
        """The next binary message."""
        while isinstance(message := self.socket.recv(timeout=seconds), str):
            pass
        return self._keep(message, draw)

    def _keep(self, message, draw=True):
        kind, header, payload = wire.read(message)
        if kind == wire.FRAME:
            self.frames.append(header["frame"])
            if draw:
                self.send(type="drawn", frame=header["frame"])
        return kind, header, payload

    def __enter__(self):
        self.socket = self._opening.__enter__()
        return self

    def __exit__(self, *problem):
        self._opening.__exit__(*problem)
