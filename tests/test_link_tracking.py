"""Poses that come in, from whatever source and in whatever coordinate systems, are where needle and probe go."""

import contextlib
import json
import socket
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonospline as ss
from link_client import LinkClient, eventually
from link_poses import SMALL_BLOCK, turned
from sonospline import igtl
from sonospline.geometry.pose import pose_along
from sonospline.io.pose_sequence import read_pose_sequence
from sonospline.link import LinkServer, PageLink, Scanner, ScannerNames
from sonospline.link.coordinate_frames import CoordinateFrames
from sonospline.link.tool_tracking import ToolTracking
from sonospline.simulator import Console, Runner, SceneFile, make_scene
from sonospline.tracking import Clutch, PoseTrack, frames_of
from sonospline.tracking import LinkClient as PoseClient

PLUS = """
[[CoordinateDefinitions]]
From = "StylusTip"
To = "Stylus"
Matrix = {tip}
[[CoordinateDefinitions]]
From = "TransducerOrigin"
To = "Probe"
Matrix = {face}
[[CoordinateDefinitions]]
From = "Reference"
To = "Ras"
Matrix = {ras}
"""


def names_of(tip, face, ras, more=""):
    rows = {name: [float(x) for x in matrix.ravel()] for name, matrix in (("tip", tip), ("face", face), ("ras", ras))}
    return ScannerNames.parse(
        'Needle = "StylusToReference"\nNeedleTip = "StylusTipToReference"\n' + more + PLUS.format(**rows)
    )


class Hand:
    """A clock that a test moves."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL_BLOCK))


@given(st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_a_chain_of_calibrations_is_multiplied_as_plus_does(seed):
    tip, face, ras, needle, probe, reference = (turned(seed + k) for k in range(6))
    tracking = ToolTracking(CoordinateFrames(names_of(tip, face, ras)))
    assert tracking.tip() is None
    for name, pose in (("StylusToTracker", needle), ("ProbeToTracker", probe), ("ReferenceToTracker", reference)):
        tracking.take(name, pose, source="plus")
    to_world = ras @ np.linalg.inv(reference)
    np.testing.assert_allclose(tracking.tip(), to_world @ needle @ tip, atol=1e-9)
    np.testing.assert_allclose(tracking.face(), to_world @ probe @ face, atol=1e-9)
    with pytest.raises(ValueError, match="known already by way of"):
        tracking.take("StylusToReference", np.eye(4), source="plus")


def test_two_sources_for_one_tool_are_refused():
    clock = Hand()
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), clock=clock)
    tracking.take("NeedleToReference", np.eye(4), source="one")
    clock.now += 1.9
    with pytest.raises(ValueError, match="two comes second, NeedleToReference is in the hand of one"):
        tracking.take("NeedleToReference", turned(1), source="two")
    np.testing.assert_array_equal(tracking.tip(), np.eye(4))
    clock.now += 0.2  # the first is silent now
    tracking.take("NeedleToReference", turned(1), source="two")
    tracking.reserve(["ProbeToTracker"], "aurora")
    with pytest.raises(ValueError, match="aurora is the source"):
        tracking.take("ProbeToTracker", np.eye(4), source="page")
    with pytest.raises(ValueError, match="both give ProbeToTracker"):
        tracking.reserve(["ProbeToTracker"], "polaris")
    text = '[[Devices]]\nId = "a"\nTools = ["Probe"]\n[[Devices]]\nId = "b"\nTools = ["Needle", "Probe"]\n'
    with pytest.raises(ValueError, match=r"Devices\[1\].Tools gives ProbeToTracker, which a gives already"):
        ScannerNames.parse(text)
    with pytest.raises(ValueError, match="gives ProbeToTracker"):
        ScannerNames().with_tracker("localhost:1").with_tracker("localhost:2")
    for address in ("localhost", "localhost:", ":5", "localhost:70000", "localhost:١"):
        with pytest.raises(ValueError, match="give host:port"):
            ScannerNames().with_tracker(address)


def test_a_tool_out_of_view_stays_and_is_said_to_be_missing():
    tracking = ToolTracking(CoordinateFrames(ScannerNames()))
    pose = turned(4)
    tracking.take("NeedleToReference", pose, source="plus")
    tracking.take("NeedleToReference", np.zeros((4, 4)), source="plus", seen=False)
    np.testing.assert_allclose(tracking.tip(), pose)
    assert tracking.missing == {"NeedleToReference", "NeedleTipToReference"}
    tracking.take("NeedleToReference", turned(5), source="plus")
    assert not tracking.missing
    for wrong in (np.diag([2.0, 1, 1, 1]), np.full((4, 4), np.nan), np.diag([1.0, 1, -1, 1])):
        with pytest.raises(ValueError, match="NeedleToReference"):
            tracking.take("NeedleToReference", wrong, source="plus")
    np.testing.assert_allclose(tracking.tip(), turned(5))


@pytest.mark.parametrize("stamped", [True, False])
def test_latency_is_made_up_for(stamped):
    """A tool moves and turns steadily; each pose comes 40 ms late, by a clock that is hours off."""
    clock = Hand()
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), latency_s={"plus": 0.04}, clock=clock)

    def truth(now):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_rotvec([0, 0.5 * now, 0]).as_matrix()
        pose[:3, 3] = 30 * now, -10 * now, 5
        return pose

    late = np.random.default_rng(0)
    for number in range(12):
        measured = 100 + number / 60
        clock.now = measured + 0.04 + (late.uniform(0, 4e-3) if stamped else 0)
        tracking.take("NeedleToReference", truth(measured), source="plus", stamp_s=measured - 1e4 if stamped else None)
    found = tracking.tip()
    assert np.linalg.norm(found[:3, 3] - truth(clock.now)[:3, 3]) < (0.15 if stamped else 1e-6)
    assert np.linalg.norm(truth(measured)[:3, 3] - truth(clock.now)[:3, 3]) > 1.2
    clock.now += 10  # the tracker is silent: it is not guessed on for ever
    assert np.linalg.norm(tracking.tip()[:3, 3] - truth(measured)[:3, 3]) < 0.1 * 40


def test_a_track_of_one_pose_stands_still_and_older_poses_are_left_out():
    track = PoseTrack()
    track.add(turned(1), 5.0)
    track.add(turned(2), 4.0)
    np.testing.assert_array_equal(track.at(5.05), turned(1))


@given(st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_a_clutch_never_jumps_and_moves_along_the_hand(seed):
    clutch, hands = Clutch(), [turned(seed + k) for k in range(3)]
    clutch.tool(hands[0])
    clutch.open()
    held = clutch.tool(hands[1])
    np.testing.assert_array_equal(held, hands[0])
    clutch.close()
    np.testing.assert_allclose(clutch.tool(hands[1]), held, atol=1e-9)
    went = clutch.tool(hands[2])
    np.testing.assert_allclose(went[:3, 3] - held[:3, 3], hands[2][:3, 3] - hands[1][:3, 3], atol=1e-9)
    np.testing.assert_allclose(went[:3, :3].T @ went[:3, :3], np.eye(3), atol=1e-9)


def test_a_client_comes_back_and_survives_garbage():
    came, again = [], threading.Event()
    pose = igtl.Message(igtl.Transform(turned(3)), "NeedleToTracker", igtl.now(), {"Status": "MISSING"})

    def take(message):
        came.append(message)
        again.set()
        raise ValueError("refused")

    with contextlib.ExitStack() as stack:
        server = stack.enter_context(LinkServer(port=0))
        client = stack.enter_context(PoseClient("127.0.0.1", server.port, take, reads=("TRANSFORM",)))
        assert eventually(lambda: [one.version for one in server.clients] == [2])
        server.publish(pose)
        assert again.wait(10)
        assert came[-1].metadata == {"Status": "MISSING"}
        server.close()
        assert eventually(lambda: not client.connected)
        again.clear()
        rude = stack.enter_context(socket.create_server(("127.0.0.1", server.port)))
        peer = stack.enter_context(rude.accept()[0])
        broken = bytearray(igtl.encode(pose, 2))
        broken[60] ^= 1
        peer.sendall(broken + igtl.encode(pose))
        assert again.wait(10)  # the message after the broken one is taken
        again.clear()
        peer.sendall(b"\0\1TRANSFORM" + b"\xff" * 200)  # a size that is absurd: hung up on, and tried again
        second = stack.enter_context(rude.accept()[0])
        second.sendall(igtl.encode(pose))
        assert again.wait(10)


@pytest.mark.parametrize("kind", ["TRANSFORM", "TDATA", "QTDATA"])
def test_a_tracker_of_its_own_drives_needle_and_probe(scene, kind):
    """3D Slicer's part in PLUS's simulated ultrasound, in metres: three transforms to the tracker, which move."""
    reference, ras, tip = turned(8), turned(9), turned(10, mm=5)
    goal = pose_along(scene.frame.origin + 18 * scene.frame.depth, scene.frame.depth)
    probe = np.array(scene.frame.probe_to_reference(scene.start.probe, 0.0))
    probe[:3, 3] += 2 * probe[:3, 0]
    back = reference @ np.linalg.inv(ras)
    poses = {
        "StylusToTracker": back @ goal @ np.linalg.inv(tip), "ProbeToTracker": back @ probe,
        "ReferenceToTracker": reference,
    }  # fmt: skip
    for pose in poses.values():
        pose[:3, 3] /= 1000
    with LinkServer(port=0) as slicer:
        more = f'[[Devices]]\nServerPort = {slicer.port}\nTools = ["Stylus", "Probe", "Reference"]\nUnit = "m"\n'
        names = names_of(tip, np.eye(4), ras, more + f'MessageType = "{kind}"\n')
        with (
            Scanner(ss.Session(scene, model="kelvinlet"), port=0, names=names) as scanner,
            LinkClient(scanner.server.port, 2) as client,
        ):
            assert eventually(lambda: len(slicer.clients) == 1)
            while True:
                tools = [igtl.Tool(name, pose) for name, pose in poses.items()]
                turns = [igtl.QuaternionTool.of(name, pose) for name, pose in poses.items()]
                ways = {
                    "TRANSFORM": [igtl.Message(igtl.Transform(pose), name, igtl.now()) for name, pose in poses.items()],
                    "TDATA": [igtl.Message(igtl.TrackingData(tools))],
                    "QTDATA": [igtl.Message(igtl.QuaternionTrackingData(turns))],
                }
                slicer.publish(*ways[kind])
                sent = client.wait_for("TRANSFORM", "StylusTipToReference").content.matrix
                face = client.wait_for("TRANSFORM", "ProbeToReference").content.matrix
                if np.allclose(sent, np.linalg.inv(ras) @ goal, atol=1e-3) and np.allclose(
                    face, np.linalg.inv(ras) @ probe, atol=1e-3
                ):
                    break
            lost = igtl.Message(igtl.Transform(np.eye(4)), "StylusToTracker", igtl.now(), {"Status": "OUT_OF_VIEW"})
            if kind == "TRANSFORM":
                client.send(igtl.Get("STATUS"))
                while client.wait_for("TRANSFORM", "StylusToReference").metadata.get("Status", "OK") == "OK":
                    slicer.publish(lost)
            assert scanner.session.last.needle.depth == pytest.approx(18, abs=0.05)


def points(*entries):
    return igtl.Points(tuple(igtl.Point(np.array(at, np.float32), name) for name, at in entries))


def test_fiducials_become_target_and_entry(scene):
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner,
        LinkClient(scanner.server.port, 2) as client,
    ):
        target = scene.frame.origin + 25 * scene.frame.depth + 3 * scene.frame.right
        entry = scene.frame.origin - 20 * scene.frame.right - 2 * scene.frame.depth
        client.send(points(("F-1", target)), "Target")
        client.send(points(("Entry-1", entry), ("F-3", target + 500)), "Anything")
        while not np.allclose(client.wait_for("TRANSFORM", "TargetToReference").content.matrix[:3, 3], target):
            pass
        waiting = client.wait_for("TRANSFORM", "NeedleTipToReference").content.matrix
        while not np.allclose(waiting[:3, 3], entry + 2 * scene.frame.depth, atol=1e-3):
            waiting = client.wait_for("TRANSFORM", "NeedleTipToReference").content.matrix
        way = target - waiting[:3, 3]
        np.testing.assert_allclose(waiting[:3, 2], way / np.linalg.norm(way), atol=1e-4)
        client.send(points(("vessel", (0, 0, 0))), "Targets")  # what it sent itself
        client.send(points(("Target", (0, 0, 1e4))), "Target")  # outside the tissue
        client.send(igtl.Get("STATUS"))
        client.wait_for("STATUS")
    assert scanner.session.last.target_now == pytest.approx(target, abs=1e-3)
    assert "vessel" in scene.targets
    assert not np.allclose(scene.targets["vessel"], target)  # sessions share scenes


def test_fiducials_move_the_target_of_a_page(scene):
    console = Console(ss.Session(scene, model="kelvinlet"))
    target, entry = scene.frame.origin + 22 * scene.frame.depth, scene.frame.origin - 15 * scene.frame.right
    with PageLink(port=0) as beside, Runner(console) as runner, LinkClient(beside.server.port) as client:
        beside.watch(runner)
        client.wait_for("IMAGE")
        client.send(points(("Target", target), ("Entry", entry)), "List")
        assert eventually(lambda: np.allclose(console.session.last.target_rest, target))
        assert eventually(lambda: np.allclose(console.last.entry, entry, atol=1e-3))
        assert console.last.direction == pytest.approx((target - entry) / np.linalg.norm(target - entry), abs=1e-4)


@pytest.mark.slow
def test_a_segmentation_becomes_a_scene(scene):
    """A ball in a block, on a lattice that is turned: the picture and the model are of it, the other scene is gone."""
    k, j, i = np.indices((40, 50, 60))
    voxels = np.where((k - 20) ** 2 + (j - 20) ** 2 + (i - 30) ** 2 < 100, 7, 3).astype(np.uint8)
    ijk = np.diag([-1.0, -1, 1, 1])
    ijk[:3, 3] = 100, 200, -30
    entries = tuple(
        igtl.LabelEntry("", label, name, owner="Segmentation") for label, name in ((3, "fat"), (7, "liver"))
    )
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner,
        LinkClient(scanner.server.port, 2) as client,
    ):
        client.wait_for("IMAGE")
        client.send(igtl.Image.of(voxels, ijk), "Segmentation")
        client.send(igtl.LabelList(entries))
        while scanner.scene.spec.name != "Segmentation":
            client.wait_for("IMAGE")
        made = scanner.scene
        np.testing.assert_allclose(made.frame.depth, (0, -1, 0), atol=1e-9)
        while client.wait_for("POLYDATA", "liver", 60) is None:
            pass


def test_a_recorded_hand(tmp_path, scene):
    """As PLUS writes it: a pose of a tool that was not seen means nothing, and the file's pixels are left alone."""
    probe = np.array(scene.frame.probe_to_reference(scene.start.probe, 0.0))
    probe[:3, 3] += 4 * probe[:3, 0]
    rows = " ".join(f"{x:.9g}" for x in probe.ravel())
    lines = ["ObjectType = Image", "NDims = 3", "DimSize = 2 2 3"]
    for frame, (text, status) in enumerate(
        ((rows, "OK"), ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "INVALID"), (rows, "OK"))
    ):
        lines += [f"Seq_Frame{frame:04d}_ProbeToReferenceTransform = {text}",
                  f"Seq_Frame{frame:04d}_ProbeToReferenceTransformStatus = {status}",
                  f"Seq_Frame{frame:04d}_Timestamp = {5 + 0.02 * frame}"]  # fmt: skip
    path = tmp_path / "hand.igs.mha"
    path.write_bytes("\n".join([*lines, "ElementDataFile = LOCAL\n"]).encode() + bytes(12))
    sequence = read_pose_sequence(path)
    assert sequence.seen["ProbeToReference"].tolist() == [True, False, True]
    np.testing.assert_allclose(sequence.poses["ProbeToReference"][2], probe, atol=1e-6)
    assert sequence.seconds == pytest.approx(0.04)
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner,
        LinkClient(scanner.server.port, 2) as client,
    ):
        scanner.station.play(sequence, path.name)
        with pytest.raises(ValueError, match="both give ProbeToReference"):
            scanner.station.play(sequence, "another")
        states = set()
        while states != {"OK", "MISSING"}:
            message = client.wait_for("TRANSFORM", "ProbeToReference")
            if np.allclose(message.content.matrix, probe, atol=1e-4):
                states.add(message.metadata.get("Status", "OK"))
                client.send(igtl.Get("STATUS"))
    for wrong in (
        b"NDims = 3\nElementDataFile = LOCAL\n",
        b"\x00\x01",
        b"",
        b"Seq_Frame0_AToBTransform = 1 2\nElementDataFile = LOCAL\n",
    ):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=r"hand\.igs\.mha"):
            read_pose_sequence(path)


def test_clutch_by_command(scene):
    deep = pose_along(scene.frame.origin + 12 * scene.frame.depth, scene.frame.depth)
    further = pose_along(scene.frame.origin + 20 * scene.frame.depth, scene.frame.depth)
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner,
        LinkClient(scanner.server.port) as client,
    ):

        def depth():
            return json.loads(client.wait_for("STRING", "Readouts").content.text)["depth_mm"]

        def command(number, text):
            client.send(igtl.String(text), f"CMD_{number}")
            return client.wait_for("STRING", f"ACK_{number}").content.text

        client.send(igtl.Transform(deep), "NeedleToReference")
        while depth() != pytest.approx(12, abs=1e-3):
            pass
        assert "SUCCESS" in command(1, '<Command Name="Clutch" Tool="Needle" Open="TRUE" />')
        client.send(igtl.Transform(further), "NeedleToReference")
        assert eventually(lambda: np.allclose(scanner.station.tracking.moving.get("NeedleToReference"), further))
        assert {round(depth(), 3) for _ in range(3)} == {12}
        assert "SUCCESS" in command(2, '<Command Name="Clutch" Tool="Needle" Open="FALSE" />')
        client.send(
            igtl.Transform(pose_along(scene.frame.origin + 23 * scene.frame.depth, scene.frame.depth)),
            "NeedleToReference",
        )
        while depth() != pytest.approx(15, abs=1e-3):
            pass
        assert "FAIL" in command(3, '<Command Name="Clutch" Tool="Probe" Open="perhaps" />')
        assert frames_of("ToolToTracker") == ("Tool", "Tracker")
