"""Bridges of the docs, where their client libraries are installed."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from link_client import eventually
from sonospline import igtl
from sonospline.link import LinkServer

BRIDGES = Path(__file__).parents[1] / "docs" / "bridges"


def program(name):
    spec = importlib.util.spec_from_file_location(name, BRIDGES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_bridge_is_python():
    for file in BRIDGES.glob("*.py"):
        compile(file.read_text(), file.name, "exec")


@pytest.mark.slow
def test_forces_reach_lsl():
    pylsl = pytest.importorskip("pylsl", reason="a library of its own")
    text = '{"force_n": [0.5, -0.25, 1.5], "axial_n": 1.25}'
    with LinkServer(port=0) as server, program("lsl_bridge").bridge("127.0.0.1", server.port):
        [info] = pylsl.resolve_byprop("source_id", f"sonospline-127.0.0.1-{server.port}", timeout=20)
        inlet = pylsl.StreamInlet(info)
        inlet.open_stream(timeout=20)
        assert eventually(lambda: len(server.clients) == 1)

        def arrived():
            server.publish(igtl.Message(igtl.String(text), "NeedleForce", igtl.now()))
            return inlet.pull_sample(timeout=0.5)[0]

        assert eventually(lambda: np.allclose(arrived() or 0, (0.5, -0.25, 1.5, 1.25)), 20)
