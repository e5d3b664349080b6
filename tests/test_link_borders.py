"""What a link bears and what it refuses: rates, odd names and images, long lists, clocks that jump, ports in use."""

import contextlib
import dataclasses
import json
import signal
import socket
import struct
import subprocess
import sys

import numpy as np
import pytest
from msgspec.structs import replace

import igtl_peers
import sonospline as ss
from link_client import LinkClient, eventually
from link_poses import SMALL_BLOCK, turned
from simulator_client import connect
from sonospline import cli, igtl
from sonospline.geometry.pose import pose_along
from sonospline.link import LinkServer, PageLink, Scanner, ScannerNames
from sonospline.link.coordinate_frames import CoordinateFrames
from sonospline.link.device_set import device_set_of
from sonospline.link.scene_receiver import scene_of
from sonospline.link.tool_tracking import ToolTracking
from sonospline.simulator import Console, Runner, SceneFile, make_scene
from sonospline.simulator.surfaces import Mesh

DEFINITION, TURNED_ROUND = (
    f'[[CoordinateDefinitions]]\nFrom = "{one}"\nTo = "{other}"\nMatrix = {np.eye(4).ravel().tolist()}\n'
    for one, other in (("NeedleTip", "Needle"), ("Needle", "NeedleTip"))
)


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL_BLOCK))


def drawn(name):
    """A scene's meshes: an organ that is a triangle, and the lines of its grid."""
    look = {"points": np.array([(40.0, 30, 5), (42, 30, 5), (40, 32, 5)]), "colour": "#ff0000", "opacity": 1.0}
    organ = Mesh(name=name, kind="surface", indices=np.array([(0, 1, 2)]), **look)
    return organ, Mesh(name="grid", kind="lines", indices=np.array([(0, 1)]), **look)


@pytest.mark.parametrize("beside_a_page", [False, True])
def test_frames_come_no_more_often_than_asked_for(scene, beside_a_page):
    """Of 40 a second most are sent 25 ms after one another, whatever the machine could do and a hand asks for."""
    names, session, ask = ScannerNames(AcquisitionRate=40), ss.Session(scene, model="kelvinlet"), len
    with contextlib.ExitStack() as stack:
        if beside_a_page:
            link, runner = PageLink(port=0, names=names), Runner(Console(session))
            stack.enter_context(link)
            link.watch(stack.enter_context(runner))

            def ask(stamps):
                image = replace(scene.start.image, gain=float(len(stamps)))
                runner.submit(replace(scene.start, image=image), len(stamps))
        else:
            link = stack.enter_context(Scanner(session, port=0, names=names))
        client, stamps = stack.enter_context(LinkClient(link.server.port)), []
        while len(stamps) < 12:
            stamps.append(igtl.seconds_of(client.wait_for("IMAGE").stamp))
            ask(stamps)
    assert np.median(np.diff(stamps[3:])) > 0.018


def test_a_sound_pose_is_followed_after_any_number_of_refusals(scene):
    pose = np.array(scene.frame.probe_to_reference(scene.start.probe, 0.0))
    pose[:3, 3] += 2 * pose[:3, 0]
    wrong = [np.full((4, 4), np.nan), np.diag([2.0, 1, 1, 1]), np.diag([1.0, 1, -1, 1]), np.zeros((4, 4))]
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        for matrix in wrong * 5:
            rows = np.asarray(matrix, ">f4")[:3].T.tobytes()  # a codec of ours would not send NaN
            client.socket.sendall(framed(b"TRANSFORM", b"ProbeToReference", rows))
        client.send(igtl.Transform(pose), "ProbeToReference")
        while not np.allclose(client.wait_for("TRANSFORM", "ProbeToReference").content.matrix, pose, atol=1e-4):
            pass


def framed(kind, device, body, version=1):
    return struct.pack(">H12s20sQQQ", version, kind, device, 0, len(body), igtl.crc64(body)) + body


@pytest.mark.parametrize("count", [0, 1000])
def test_any_number_of_fiducials(scene, count):
    """Where one of a thousand is the target, it is heard; of none nothing happens."""
    target = scene.frame.origin + 21 * scene.frame.depth
    entries = [igtl.Point(np.zeros(3), f"F-{number}") for number in range(count)]
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        client.send(igtl.Points(entries), "Target_" if count else "Target")
        client.send(igtl.Points([*entries, igtl.Point(target, "Target")]), "List")
        while not np.allclose(client.wait_for("TRANSFORM", "TargetToReference").content.matrix[:3, 3], target):
            pass
        assert scanner.server.clients[0].refused == 0


def test_a_list_that_would_hold_up_the_others_is_refused():
    seen = []
    with (
        LinkServer(port=0, receive=lambda message, client: seen.append(message) or ()) as server,
        LinkClient(server.port) as client,
    ):
        client.send(igtl.Points([igtl.Point(np.zeros(3))] * 2000))
        client.send(igtl.Image.of(np.zeros((1, 600, 600), np.uint8), np.eye(4)), "Image")
        client.send(igtl.Points([igtl.Point(np.zeros(3))] * 1000))
        assert eventually(lambda: len(seen) == 2)
        assert [message.content.type for message in seen] == ["IMAGE", "POINT"]
        assert server.clients[0].refused == 1


@pytest.mark.parametrize("kind", ["TDATA", "QTDATA"])
def test_poses_come_together_to_who_asks(scene, kind):
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        client.send(igtl.Start(kind, 20))
        tools = {tool.name: tool.matrix for tool in client.wait_for(kind, "TrackerDevice").content.tools}
        alone = client.wait_for("TRANSFORM", "ProbeToReference").content.matrix
    assert set(tools) == {f"{name}ToReference" for name in ("Probe", "Needle", "NeedleTip", "Target")}
    np.testing.assert_allclose(tools["ProbeToReference"], alone, atol=1e-3)


@pytest.mark.slow
def test_an_example_program_asks_the_scanner_for_quaternions(scene, tmp_path):
    """Debian's QuaternionTrackingDataClient: it starts a flow, prints one, and stops it by and by."""
    program = igtl_peers.example("QuaternionTrackingData/QuaternionTrackingDataClient", tmp_path)
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner:
        command = [program, "127.0.0.1", str(scanner.server.port), "100"]
        run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert eventually(lambda: scanner.server.clients and scanner.server.clients[0].received > 1)
    said = run.communicate(timeout=20)[0]
    assert said.count("Quaternion :") >= 4, said
    assert "TargetToReference" in said


def test_what_3d_slicer_takes_for_an_error_is_sent_to_who_asks():
    """Its OpenIGTLinkIO (d7f6aef) has no device for SENSOR and NDARRAY, and says so of each that comes."""
    force = [igtl.Message(content([1.0, 2, 3]), "NeedleForce") for content in (igtl.Sensor, igtl.NumberArray)]
    said = igtl.Message(igtl.String("force"), "NeedleForce")
    with LinkServer(port=0) as server, LinkClient(server.port) as slicer, LinkClient(server.port) as other:
        other.send(igtl.Start("SENSOR", 0))
        assert other.wait_for("RTS_SENSOR").content.ok
        assert eventually(lambda: len(server.clients) == 2)
        server.publish(*force, said)
        assert slicer.next().content.type == "STRING"
        assert [other.next().content.type for _ in range(2)] == ["SENSOR", "STRING"]


def test_a_calibration_and_a_registration_are_given_anew(scene):
    """As 3D Slicer does after a pivot calibration or a registration of fiducials, by PLUS's UpdateTransform."""
    goal = pose_along(scene.frame.origin + 12 * scene.frame.depth, scene.frame.depth)
    tip, registration = turned(2, mm=5), turned(3)
    hand = np.linalg.inv(registration) @ goal @ np.linalg.inv(tip)
    given = {"NeedleTipToNeedle": tip, "RasToReference": np.linalg.inv(registration)}
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        client.send(igtl.Transform(hand), "NeedleToReference")
        wrong = {"AToB": tip, "ImageToProbe": tip, "NeedleTipToNeedle": np.diag([2.0, 1, 1, 1])}
        for number, (name, matrix, status) in enumerate(
            [(*pair, "FAIL") for pair in wrong.items()] + [(*pair, "SUCCESS") for pair in given.items()]
        ):
            rows = " ".join(f"{x:.9g}" for x in np.ravel(matrix))
            xml = f'<Command Name="UpdateTransform" TransformName="{name}" TransformValue="{rows}" />'
            client.send(igtl.String(xml), f"CMD_{number}")
            assert f'Status="{status}"' in client.wait_for("STRING", f"ACK_{number}").content.text, name
        wanted = np.linalg.inv(registration) @ goal
        while not np.allclose(client.wait_for("TRANSFORM", "NeedleTipToReference").content.matrix, wanted, atol=1e-3):
            pass
        target = np.linalg.inv(registration) @ [*scanner.session.last.target_now, 1]
        np.testing.assert_allclose(
            client.wait_for("TRANSFORM", "TargetToReference").content.matrix[:, 3], target, atol=0.1
        )
    assert scanner.session.last.needle.depth == pytest.approx(12, abs=1e-3)


def test_half_a_header_is_not_waited_for():
    with LinkServer(port=0, patience_s=0.1) as server, LinkClient(server.port) as client:
        client.socket.sendall(igtl.encode(igtl.Message(igtl.Status()))[:29])
        assert client.is_hung_up_on()


def test_a_client_is_answered_in_the_highest_version_it_has_sent():
    """As PLUS does: one that sends 3 and then 1 gets 2, the highest that is sent here, and its metadata."""
    pose = igtl.Message(igtl.Transform(np.eye(4)), "NeedleToReference", igtl.now(), {"Status": "OK"})
    with LinkServer(port=0) as server, LinkClient(server.port, 3) as client:
        client.send(igtl.Get("STATUS"), "new")
        client.wait_for("STATUS", "new")
        client.version = 1
        client.send(igtl.Get("STATUS"), "old")
        client.wait_for("STATUS", "old")
        server.publish(pose)
        assert client.wait_for("TRANSFORM").metadata == {"Status": "OK"}
        assert client.versions[-1] == 2


@pytest.mark.parametrize("jump_s", [-3600.0, 3600.0])
def test_a_tracker_that_begins_anew_is_followed_at_once(jump_s):
    """Its clock is another after that, or its stamps run backwards: poses with latency go on all the same."""
    now = [100.0]
    tracking = ToolTracking(CoordinateFrames(ScannerNames()), latency_s={"plus": 0.02}, clock=lambda: now[0])
    for number in range(30):
        now[0] += 0.02
        at = np.eye(4)
        at[0, 3] = number
        since = jump_s if number >= 5 else 0.0
        tracking.take("NeedleToReference", at, source="plus", stamp_s=5000 + now[0] + since)
        assert abs(tracking.tip()[0, 3] - number) <= 1.1, number


def test_a_scene_that_is_left_leaves_no_organs_behind(scene):
    """Clients hear of empty surfaces, and so do those that ask: the new scene's come with its own names."""
    first, second = (dataclasses.replace(scene, draw=lambda name=name: drawn(name)) for name in ("liver", "spleen"))
    with Scanner(ss.Session(first, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        assert len(client.wait_for("POLYDATA", "liver").content.points) == 3
        scanner.load(second)
        while len(client.wait_for("POLYDATA", "liver").content.points):
            pass
        client.send(igtl.Get("POLYDATA"), "liver")
        assert len(client.wait_for("POLYDATA", "liver").content.points) == 0
        assert len(client.wait_for("POLYDATA", "spleen").content.points) == 3


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f'Image = "{"ü" * 15}"', "Image = 'ü+' names no device; give 1 to 20 bytes"),
        ('Image = ""', "Image = '' names no device"),
        (r'Events = "a\u0007"', "Events = .* names no device"),
        ('Probe = "NeedleToReference"', "Needle = 'NeedleToReference' is what Probe is called"),
        ('Events = "Readouts"', "Readouts = 'Readouts' is what Events is called"),
        ('[[Devices]]\nTools = ["StylusWithALongName"]', "StylusWithALongNameToTracker, which no message can carry"),
        ('[[Devices]]\nTools = ["Probe", "Probe"]', "gives ProbeToTracker, which TrackerDevice gives already"),
        ("AcquisitionRate = nan", "AcquisitionRate = nan is not finite; give a number from 1 to 120"),
        ("MeshRate = -1", "MeshRate = -1 is out of range"),
        ('ImageOrientation = "XY"', "ImageOrientation = 'XY' is not known; choose one of MF"),
        (DEFINITION + DEFINITION, r"CoordinateDefinitions\[1\] gives NeedleTipToNeedle again; leave it out"),
        (DEFINITION + TURNED_ROUND, r"CoordinateDefinitions\[1\] gives NeedleToNeedleTip again; leave it out"),
    ],
)
def test_names_that_cannot_be_are_refused(text, line):
    with pytest.raises(ValueError, match=line) as refused:
        ScannerNames.parse(text)
    assert len(str(refused.value).splitlines()) == 1


def test_needle_and_its_tip_may_have_one_name():
    assert ScannerNames.parse('Needle = "NeedleTipToReference"').Needle == "NeedleTipToReference"


@pytest.mark.slow
@pytest.mark.parametrize("mirrored", [False, True])
def test_an_image_of_any_lattice_becomes_a_scene(mirrored):
    """Of 16 bits, big-endian and in LPS, with steps of three lengths, left-handed or not: a ball is where it was."""
    k, j, i = np.indices((30, 40, 50))
    voxels = np.where(4 * (k - 15) ** 2 + (j - 20) ** 2 + (i - 25) ** 2 < 100, 7, 3).astype(np.int16)
    ijk = np.diag([1.0 if mirrored else -1.0, -1.2, 2.5, 1])
    ijk[:3, 3] = 100, 200, -30
    body = bytearray(igtl.Image.of(voxels, np.diag([-1, -1, 1, 1]) @ ijk).packed())
    body[4:6] = 1, 2  # big-endian, LPS
    body[72:] = voxels.astype(">i2").tobytes()
    image = igtl.decode(framed(b"IMAGE", b"Seg", bytes(body))).content
    np.testing.assert_allclose(image.ijk_to_reference, ijk, atol=1e-4)
    assert (np.linalg.det(ijk) > 0) != mirrored
    made = scene_of(image, {3: "fat", 7: "liver"}, np.eye(4), name="Seg")
    [liver] = [mesh for mesh in made.meshes if mesh.name == "liver"]
    np.testing.assert_allclose(liver.points.mean(axis=0), (ijk @ (25, 20, 15, 1))[:3], atol=0.05)
    np.testing.assert_allclose(np.ptp(liver.points, axis=0), (20, 24, 25), rtol=0.15)
    np.testing.assert_allclose(made.frame.depth, (0, -1, 0), atol=1e-9)


def test_every_address_of_a_machine_is_itself_in_a_device_set():
    for host in ("0.0.0.0", "::"):
        assert 'ServerAddress="localhost"' in device_set_of(ScannerNames(), host, 18944)
    assert 'ServerAddress="10.0.0.7"' in device_set_of(ScannerNames(), "10.0.0.7", 18944)


def has_ipv6():
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6):
            return True
    except OSError:
        return False


@pytest.mark.skipif(not has_ipv6(), reason="this machine has no address ::1")
def test_ipv6():
    with LinkServer(port=0, host="::1") as server, socket.create_connection(("::1", server.port)) as client:
        client.sendall(igtl.encode(igtl.Message(igtl.Get("STATUS"), "me")))
        framer = igtl.Framer()
        while (found := framer.next()) is None:
            framer.feed(client.recv(1 << 16))
        assert found[0].type == "STATUS"
        assert server.clients[0].address.startswith("::1")


@pytest.mark.parametrize("verb", [["link", "--scene", "gel", "--model", "kelvinlet", "--port"], ["serve", "--link"]])
def test_a_port_in_use_is_one_clear_line(verb, capsys):
    """A link that is started twice."""
    with LinkServer(port=0) as first:
        assert cli.main([*verb, str(first.port)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"port = {first.port} on 127.0.0.1 is in use; give another one, or 0 for any free one" in said


def test_an_address_that_is_no_machines_is_said():
    with pytest.raises(ValueError, match=r"on 256\.1\.1\.1 cannot be listened on"):
        LinkServer(port=0, host="256.1.1.1")


@pytest.mark.slow
def test_the_page_is_served_beside_a_link(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL_BLOCK)
    (tmp_path / "names.toml").write_text('Image = "Image_Lab"')
    options = ["--port", "0", "--json", "--scene", "small.toml", "--link", "0", "--link-names", "names.toml"]
    command = [sys.executable, "-m", "sonospline", "serve", *options]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as server:
        try:
            said = json.loads(server.stdout.readline())
            with connect(said["address"].replace("http", "ws") + "live", max_size=2**24) as page:
                page.recv(timeout=60)
                with LinkClient(said["link"]) as client:
                    assert client.wait_for("IMAGE", "Image_Lab", 60).content.voxels.any()
        finally:
            server.send_signal(signal.SIGINT)
            server.communicate(timeout=30)
    assert server.returncode == 0
