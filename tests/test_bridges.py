"""Bridges of the docs, where their client libraries are installed."""

import importlib.util
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from link_client import eventually
from link_poses import turned
from sonospline import igtl
from sonospline.link import LinkServer

ROOT = Path(__file__).parents[1]
BRIDGES = ROOT / "docs" / "bridges"
ROS_PYTHON = Path(os.environ.get("SONOSPLINE_ROS_PYTHON", ROOT / "build" / "ros" / "bin" / "python"))
REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_BRIDGES") == "1"


def absent(what):
    """A client library that the test is about is not there."""
    pytest.fail(f"{what}, and SONOSPLINE_REQUIRE_BRIDGES is set") if REQUIRED else pytest.skip(what)


def program(name):
    spec = importlib.util.spec_from_file_location(name, BRIDGES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_bridge_is_python():
    for file in BRIDGES.glob("*.py"):
        compile(file.read_text(), file.name, "exec")


@pytest.mark.slow
def test_forces_reach_lsl(tmp_path, monkeypatch):
    if importlib.util.find_spec("pylsl") is None:
        absent("pylsl is not installed")
    alone = tmp_path / "lsl_api.cfg"  # asks this machine by its address: a network may carry no multicast
    alone.write_text("[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n")
    monkeypatch.setenv("LSLAPICFG", str(alone))
    import pylsl

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


@pytest.mark.slow
def test_poses_reach_ros():
    """In metres, turned as they were, under their name."""
    if not ROS_PYTHON.is_file():
        absent(f"{ROS_PYTHON} is not there; scripts/setup.sh ros installs it")
    pose = turned(5)
    done = subprocess.run(
        [ROS_PYTHON, ROOT / "tests" / "oracles" / "ros_hears.py", BRIDGES / "ros2_bridge.py", *map(str, pose.ravel())],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "SONOSPLINE_BACKEND": "numpy"},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    heard = json.loads(done.stdout)
    assert heard["frame"] == "Reference"
    np.testing.assert_allclose(heard["place"], pose[:3, 3] / 1000, atol=1e-6)
    np.testing.assert_allclose(Rotation.from_quat(heard["turn"]).as_matrix(), pose[:3, :3], atol=1e-5)
