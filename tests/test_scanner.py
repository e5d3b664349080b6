"""A simulated scanner on OpenIGTLink: poses come in; images, poses, forces and events go out, at the same places."""

import json
import signal
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import sonospline as ss
from link_client import LinkClient, eventually
from link_poses import SMALL_BLOCK
from sonospline import igtl
from sonospline.link import Scanner, ScannerNames


@pytest.fixture(scope="module")
def scene():
    return ss.Session(ss.simulator.make_scene(ss.simulator.SceneFile.parse(SMALL_BLOCK)), model="kelvinlet").scene


@pytest.fixture
def scanner(scene):
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as made:
        yield made


def needle_pose(scene, depth_mm, slant=0.3):
    """A needle that deep in the middle of the skin, aslant."""
    skin = scene.frame
    along = skin.depth + slant * skin.right
    along /= np.linalg.norm(along)
    pose = np.eye(4)
    pose[:3, 2] = along
    pose[:3, 0] = np.cross(skin.out, along) / np.linalg.norm(np.cross(skin.out, along))
    pose[:3, 1] = np.cross(along, pose[:3, 0])
    pose[:3, 3] = skin.origin + depth_mm * along
    return pose


def test_everything_plus_sends_is_sent(scanner):
    with LinkClient(scanner.server.port, 2) as client:
        client.send(igtl.Get("STATUS"))
        seen = {}
        while not {"Image_Reference", "ProbeToReference", "NeedleToReference", "NeedleTipToReference",
                   "TargetToReference", "Readouts"} <= set(seen):  # fmt: skip
            message = client.next()
            seen[message.device] = message
    image = seen["Image_Reference"].content
    assert image.voxels.dtype == np.uint8
    assert image.voxels.ndim == 3
    assert seen["TargetToReference"].content.matrix[:3, 3] == pytest.approx(scanner.session.last.target_now, abs=1e-3)


def test_poses_that_come_in_move_needle_and_probe(scanner):
    scene = scanner.session.scene
    rest = scene.frame.probe_to_reference(scene.start.probe, 0.0)
    probe = rest.copy()
    probe[:3, 3] += 3 * rest[:3, 0]
    deep = needle_pose(scene, 20)
    with LinkClient(scanner.server.port) as client:
        client.send(igtl.Transform(deep), "NeedleToReference")
        client.send(igtl.Transform(probe), "ProbeToReference")
        while True:
            moved = client.wait_for("TRANSFORM", "ProbeToReference").content.matrix
            tip = client.wait_for("TRANSFORM", "NeedleTipToReference").content.matrix
            if np.allclose(moved, probe, atol=1e-4) and np.allclose(tip, deep, atol=1e-4):
                break
        said = json.loads(client.wait_for("STRING", "Readouts").content.text)
        assert said["depth_mm"] == pytest.approx(20, abs=1e-3)
        client.send(igtl.Transform(needle_pose(scene, -5)), "NeedleToReference")
        while json.loads(client.wait_for("STRING", "Readouts").content.text)["depth_mm"] != 0:
            pass
    assert scanner.session.last.needle is None


def test_what_cannot_be_done_leaves_everything_as_it_is(scanner, caplog):
    scene, before = scanner.session.scene, None
    with LinkClient(scanner.server.port) as client, LinkClient(scanner.server.port) as second:
        client.send(igtl.Transform(needle_pose(scene, 15)), "NeedleToReference")
        assert eventually(lambda: scanner.session.last is not None and scanner.session.last.needle is not None)
        before = scanner.session.last.needle
        second.send(igtl.Transform(needle_pose(scene, 25)), "NeedleToReference")
        client.send(igtl.Transform(np.diag([2.0, 1, 1, 1])), "NeedleToReference")
        client.send(igtl.Transform(np.diag([1.0, 1, -1, 1])), "NeedleToReference")
        client.send(igtl.Transform(np.eye(4)), "Nobody")
        frames = scanner.frames
        assert eventually(lambda: scanner.frames > frames + 3)
        client.send(igtl.Transform(needle_pose(scene, 5000)), "NeedleToReference")  # beyond the tissue
        client.wait_for("STATUS")
    assert scanner.session.last.needle == before
    assert len([record for record in caplog.records if "refused" in record.message]) == 1


def test_commands_of_plus(scanner):
    with LinkClient(scanner.server.port) as client:

        def ask(number, text):
            client.send(igtl.String(text), f"CMD_{number}")
            return ElementTree.fromstring(client.wait_for("STRING", f"ACK_{number}").content.text).attrib

        client.wait_for("IMAGE")
        assert ask(1, '<Command Name="RequestChannelIds" />')["Message"] == "OutputChannel"
        assert ask(2, '<Command Name="RequestDeviceIds" />')["Message"] == "VideoDevice,TrackerDevice,CaptureDevice"
        typed = '<Command Name="RequestDeviceIds" DeviceType="{}" />'  # as PlusRemote asks
        assert ask(20, typed.format("VirtualCapture"))["Message"] == "CaptureDevice"
        assert ask(21, typed.format("VirtualVolumeReconstructor")) == {"Status": "SUCCESS", "Message": ""}
        assert ask(3, '<Command Name="Version" />')["Message"].startswith("Sonospline")
        parameter = '<Command Name="{}" UsDeviceId="VideoDevice"><Parameter Name="{}" Value="{}" /></Command>'
        assert ask(4, parameter.format("SetUsParameter", "DepthMm", 30))["Status"] == "SUCCESS"
        assert 'Value="30"' in ask(5, parameter.format("GetUsParameter", "DepthMm", ""))["Message"]
        assert ask(6, parameter.format("SetUsParameter", "DepthMm", 3000))["Status"] == "FAIL"
        assert ask(7, parameter.format("SetUsParameter", "Voltage", 30))["Status"] == "FAIL"
        assert 'Value="50"' in ask(8, parameter.format("GetUsParameter", "GainPercent", ""))["Message"]
        assert eventually(lambda: scanner.wanted.settings is not None and scanner.session.last.settings.depth == 30)
        pose = " ".join(str(number) for number in needle_pose(scanner.session.scene, 10).ravel())
        move = f'<Command Name="UpdateTransform" TransformName="NeedleToReference" TransformValue="{pose}" />'
        assert ask(9, move)["Status"] == "SUCCESS"
        assert eventually(lambda: scanner.session.last.needle is not None)
        found = ask(10, '<Command Name="GetTransform" TransformName="ProbeToReference" />')
        assert 'name="ProbeToReference"' in found["Message"]
        assert "not found" in ask(11, '<Command Name="GetTransform" TransformName="XToY" />')["Message"]
        assert ask(12, '<Command Name="StartRecording" />')["Status"] == "FAIL"


def test_names():
    names = ScannerNames.parse('Image = "Image_Tracker"\nAcquisitionRate = 15')
    assert (names.Image, names.AcquisitionRate, names.Probe) == ("Image_Tracker", 15, "ProbeToReference")
    for text, line in (
        ("Colour = 1", "Colour"),
        ('Image = "' + "x" * 21 + '"', "Image"),
        ("AcquisitionRate = 0", "Rate"),
        ('Needle = "stylus"', "names no coordinate systems"),
        ('Needle = "NeedleToTracker"', "is to Tracker, and Probe to Reference"),
        ('TransformNames = ["x"]', r"TransformNames\[0\]"),
        ('CoordinateDefinitions = [{From = "NeedleTip", To = "Needle", Matrix = [1, 2]}]', "has 2 numbers"),
    ):
        with pytest.raises(ValueError, match=line):
            ScannerNames.parse(text)


@pytest.mark.slow
def test_the_verb_serves_until_it_is_interrupted():
    command = [
        sys.executable,
        "-m",
        "sonospline",
        "link",
        "--scene",
        "gel",
        "--model",
        "kelvinlet",
        "--port",
        "0",
        "--json",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        port = json.loads(process.stdout.readline())["port"]
        with LinkClient(port) as client:
            assert client.wait_for("IMAGE", "Image_Reference", 60).content.voxels.any()
        process.send_signal(signal.SIGINT)
        rest = process.communicate(timeout=30)[0]
    assert process.returncode == 0
    assert json.loads(rest)["frames"] > 0
