"""The server of OpenIGTLink: many clients, slow ones, vanishing ones and those that send garbage."""

import logging
import random
import socket
import struct
import subprocess
import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import igtl_peers
from link_client import LinkClient, eventually
from sonospline import igtl
from sonospline.link import LinkServer
from sonospline.link.outbox import NEWEST_WINS, Outbox, Outgoing

POSE = np.array([[0, -1, 0, 10], [1, 0, 0, -20], [0, 0, 1, 30.5], [0, 0, 0, 1]])


def pose(number, device="NeedleToReference"):
    """A transform that carries a number."""
    matrix = np.eye(4)
    matrix[0, 3] = number
    return igtl.Message(igtl.Transform(matrix), device, igtl.now(), {"TransformStatus": "OK"})


def picture(number, shape=(1, 616, 820)):
    return igtl.Message(igtl.Image.of(np.full(shape, number % 256, np.uint8), np.eye(4)), "Image_Reference")


@pytest.fixture
def server():
    with LinkServer(port=0) as made:
        yield made


def joined(server, count=1):
    assert eventually(lambda: len(server.clients) == count)


def test_header_version_goes_by_what_a_client_has_sent(server):
    with LinkClient(server.port, 2) as new, LinkClient(server.port) as old:
        joined(server, 2)
        server.publish(pose(1))
        for client in (new, old):
            assert client.wait_for("TRANSFORM").metadata == {}
            assert set(client.versions) == {1}
        new.send(igtl.Get("STATUS"))
        assert eventually(lambda: sorted(info.version for info in server.clients) == [1, 2])
        server.publish(pose(2))
        assert new.wait_for("TRANSFORM").metadata == {"TransformStatus": "OK"}
        assert old.wait_for("TRANSFORM").metadata == {}
        assert set(old.versions) == {1}
        assert new.versions[-1] == 2


def test_a_header_of_version_3_is_answered_by_2(server):
    with LinkClient(server.port, 3) as client:
        client.send(igtl.Get("STATUS"), "me")
        client.wait_for("STATUS", "me")
        assert client.versions[-1] == 2


def test_queries(server):
    with LinkClient(server.port) as client:
        joined(server)
        server.publish(pose(1, "ProbeToReference"), pose(2), picture(3, (1, 4, 5)))
        client.wait_for("IMAGE")
        client.send(igtl.Get("TRANSFORM"), "ProbeToReference")
        assert client.wait_for("TRANSFORM").content.matrix[0, 3] == 1
        client.send(igtl.Get("TRANSFORM"))
        assert client.wait_for("TRANSFORM").content.matrix[0, 3] == 2
        client.send(igtl.Get("IMAGE"))
        assert client.next().content.size == (5, 4, 1)
        client.send(igtl.Get("POLYDATA"), "Organ")
        assert client.wait_for("POLYDATA").content == igtl.Nothing("POLYDATA")
        client.send(igtl.Get("CAPABILITY"))
        assert "QTDATA" in client.wait_for("CAPABILITY").content.types


def test_flows_are_started_and_stopped(server):
    tools = igtl.Message(igtl.TrackingData([igtl.Tool("Needle", np.eye(4))]), "Tracker")
    with LinkClient(server.port) as client, LinkClient(server.port) as other:
        joined(server, 2)
        client.send(igtl.Start("TDATA", 10_000), "Tracker")
        assert client.wait_for("RTS_TDATA").content.ok
        client.send(igtl.Stop("TRANSFORM"))
        assert client.wait_for("RTS_TRANS").content.ok
        for number in range(3):
            server.publish(tools, pose(number))
        server.publish(picture(0, (1, 2, 2)))
        seen = [client.next().content.type for _ in range(2)]
        assert seen == ["TDATA", "IMAGE"]  # one in ten seconds, and no transform
        seen = [other.next().content.type for _ in range(4)]
        assert seen == ["TRANSFORM"] * 3 + ["IMAGE"]


def test_a_status_says_that_the_server_lives():
    with LinkServer(port=0, keep_alive_s=0.02) as server, LinkClient(server.port) as client:
        assert all(client.next().content == igtl.Status() for _ in range(3))


def test_a_stalled_client_delays_nobody_and_is_hung_up_on(caplog):
    with (
        LinkServer(port=0, patience_s=0.4) as server,
        LinkClient(server.port, buffer=4096),
        LinkClient(server.port) as good,
    ):
        joined(server, 2)
        seen = []
        for number in range(40):
            server.publish(pose(number), picture(number))
            seen.append(good.wait_for("TRANSFORM").content.matrix[0, 3])
            good.wait_for("IMAGE")
        assert seen == list(range(40))
        assert eventually(lambda: len(server.clients) == 1)
    assert "read nothing" in caplog.text


def test_a_slow_client_gets_the_newest_image_and_every_transform(server):
    with LinkClient(server.port, buffer=4096) as slow:
        joined(server)
        for number in range(60):
            server.publish(pose(number), picture(number))
        transforms, images = [], []
        while len(transforms) < 60 or images[-1] != 59:
            message = slow.next()
            if message.content.type == "TRANSFORM":
                transforms.append(message.content.matrix[0, 3])
            elif message.content.type == "IMAGE":
                images.append(message.content.voxels[0, 0, 0])
        assert transforms == list(range(60))
        assert len(images) < 60
        assert images == sorted(images)
        assert server.clients[0].lost == 0


def test_what_a_slow_client_loses_it_is_told(server, caplog):
    """Its socket takes no more, then 4,096 wait, then the oldest are lost: a STATUS gives their number."""
    with LinkClient(server.port, buffer=4096) as slow:
        joined(server)
        server.publish(picture(0, (20, 616, 820)))
        most = 4096 + 500
        for number in range(most):
            server.publish(pose(number))
            if number % 100 == 0:
                time.sleep(0.002)  # so that the server's own box does not overflow
        numbers, told = [], 0
        while not numbers or numbers[-1] != most - 1:
            message = slow.next()
            if message.content.type == "TRANSFORM":
                numbers.append(int(message.content.matrix[0, 3]))
            elif message.content.type == "STATUS" and message.content.code == 8:
                told += int(message.content.message.split()[0])
        assert numbers == sorted(set(numbers))
        assert told == most - len(numbers) > 0
        assert "messages were lost" in caplog.text


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(["IMAGE", "TRANSFORM"]), st.sampled_from("ab")), max_size=60))
def test_outbox(drawn):
    """It holds what a plain list of all that came would, without older images, but the last ten others."""
    outbox, expected = Outbox(most=10), []
    for number, (kind, device) in enumerate(drawn):
        made = Outgoing(pose(number, device) if kind == "TRANSFORM" else picture(number, (1, 1, 1)))
        outbox.put(made)
        place = [at for at, one in enumerate(expected) if kind in NEWEST_WINS and one.type == kind]
        if place:
            expected[place[0]] = made
        else:
            expected = [*expected, made][-10:]
    assert len(outbox) <= 10
    assert outbox.lost + outbox.replaced + len(outbox) == len(drawn)
    assert list(outbox) == expected
    assert not len(outbox)


def test_sent_messages_are_received_and_answered(caplog):
    seen = []

    def receive(message, client):
        seen.append(message)
        if message.device == "fail":
            raise RuntimeError("no")
        return [igtl.Message(igtl.String("took it"), "answer")]

    with LinkServer(port=0, receive=receive, reads=["TRANSFORM"]) as server, LinkClient(server.port, 2) as client:
        client.send(igtl.String("not read"), "x")
        client.send(igtl.Transform(POSE), "fail")
        client.send(igtl.Transform(POSE), "NeedleToReference", metadata={"TransformStatus": "OK"})
        assert client.wait_for("STRING").content.text == "took it"
        assert [message.device for message in seen] == ["fail", "NeedleToReference"]
        np.testing.assert_array_equal(seen[1].content.matrix, POSE)
        assert seen[1].metadata == {"TransformStatus": "OK"}
        assert server.clients[0].refused == 1
    assert "was not taken: no" in caplog.text


def test_bad_messages_are_skipped_with_one_line(server, caplog):
    """Wrong checks, unknown types, versions of the future: skipped; the client goes on, and one line is written."""
    sound = igtl.encode(igtl.Message(igtl.Get("STATUS"), "me"))
    wrong = bytearray(igtl.encode(pose(1)))
    wrong[-1] ^= 1
    future = struct.pack(">H12s20sQQQ", 9, b"TRANSFORM", b"x", 0, 3, 0) + b"abc"
    unknown = struct.pack(">H12s20sQQQ", 1, b"NOVELTY", b"x", 0, 0, 0)
    caplog.set_level(logging.WARNING)
    with LinkClient(server.port) as client:
        for _ in range(20):
            client.socket.sendall(bytes(wrong) + future + unknown)
        client.socket.sendall(sound)
        client.wait_for("STATUS", "me")
        assert server.clients[0].refused == 60
    assert len([record for record in caplog.records if "refused" in record.message]) == 1


def test_who_comes_again_and_again_has_one_line_and_so_has_what_fails_here(caplog):
    def receive(message, client):
        raise RuntimeError("no")

    unknown = struct.pack(">H12s20sQQQ", 1, b"NOVELTY", b"x", 0, 0, 0)
    with LinkServer(port=0, receive=receive, clients=1) as server:
        for _ in range(10):
            assert eventually(lambda: not server.clients)
            with LinkClient(server.port) as client:
                client.socket.sendall(unknown)
                client.send(igtl.Transform(POSE), "fail")
                client.send(igtl.Get("STATUS"), "me")
                client.wait_for("STATUS", "me")
                with LinkClient(server.port) as second:
                    assert second.is_hung_up_on()
    refused, failed = caplog.records
    assert "refused" in refused.message and refused.exc_info is None
    assert "was not taken: no" in failed.message and failed.exc_info[0] is RuntimeError


def test_a_client_that_announces_too_much_is_hung_up_on(server):
    with LinkClient(server.port) as client, LinkClient(server.port) as other:
        joined(server, 2)
        client.socket.sendall(struct.pack(">H12s20sQQQ", 1, b"IMAGE", b"x", 0, 1 << 60, 0))
        assert client.is_hung_up_on()
        other.send(igtl.Get("STATUS"), "me")
        other.wait_for("STATUS", "me")


def test_a_message_that_does_not_end_is_not_waited_for():
    with LinkServer(port=0, patience_s=0.2) as server, LinkClient(server.port) as client:
        client.socket.sendall(igtl.encode(pose(1))[:70])
        assert client.is_hung_up_on()
        assert eventually(lambda: not server.clients)


def test_one_client_too_many(caplog):
    with LinkServer(port=0, clients=1) as server, LinkClient(server.port) as first:
        joined(server)
        with LinkClient(server.port) as second:
            assert second.next().content.code == 11
            assert second.is_hung_up_on()
        first.send(igtl.Get("STATUS"), "me")
        first.wait_for("STATUS", "me")


def test_a_client_that_sends_too_fast_waits():
    """Of 250 messages at 100 a second the last is read after two seconds, at the earliest."""
    seen = []
    with LinkServer(port=0, messages_s=100, receive=lambda message, client: seen.append(message) or ()) as server:
        with LinkClient(server.port) as client:
            began = time.monotonic()
            client.socket.sendall(b"".join(igtl.encode(pose(number)) for number in range(250)))
            assert eventually(lambda: len(seen) == 250)
            assert time.monotonic() - began >= 1.9
        assert [message.content.matrix[0, 3] for message in seen] == list(range(250))


def rascal(port, rng):
    """Connect, send something wrong or half of something right, and vanish."""
    with socket.create_connection(("127.0.0.1", port)) as rude:
        match rng.randrange(4):
            case 0:
                rude.sendall(rng.randbytes(rng.randrange(400)))
            case 1:
                data = bytearray(igtl.encode(pose(1)))
                data[rng.randrange(58)] = rng.randrange(256)
                rude.sendall(bytes(data) * 3)
            case 2:
                rude.sendall(igtl.encode(pose(1))[: rng.randrange(106)])
            case 3:
                rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def check_rascals(turns):
    threads = threading.active_count()
    with LinkServer(port=0, clients=64, patience_s=0.5) as server, LinkClient(server.port) as good:
        rng = random.Random(3)
        joined(server)
        for turn in range(turns):
            rascal(server.port, rng)
            if turn % 10 == 0:
                server.publish(pose(turn))
                assert good.wait_for("TRANSFORM").content.matrix[0, 3] == turn
        joined(server)
        assert server.clients[0].sent >= turns // 10
    assert eventually(lambda: threading.active_count() == threads)


def test_rude_clients_do_no_harm():
    check_rascals(40)


@pytest.mark.slow
def test_very_many_rude_clients_do_no_harm():
    check_rascals(400)


def test_port_in_use(server):
    with pytest.raises(ValueError, match=f"port = {server.port} on 127.0.0.1 is in use"):
        LinkServer(port=server.port)
    with pytest.raises(ValueError, match="port = 70000"):
        LinkServer(port=70_000)


def test_closing_hangs_up_and_frees_the_port():
    server = LinkServer(port=0)
    with LinkClient(server.port) as client:
        joined(server)
        server.close()
        server.close()
        server.publish(pose(1))
        assert client.is_hung_up_on()
    LinkServer(port=server.port).close()


def test_pyigtl_is_a_client():
    pyigtl = pytest.importorskip("pyigtl") if not igtl_peers.REQUIRED else __import__("pyigtl")
    seen = []

    def receive(message, client):
        seen.append(message)
        return ()

    with LinkServer(port=0, receive=receive) as server:
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", server.port)
        try:
            joined(server)
            ours = pose(42)
            for _ in range(20):  # it keeps the last of each device, and looks every ten milliseconds
                server.publish(ours, picture(7, (1, 30, 40)))
                if (message := client.wait_for_message("NeedleToReference", timeout=1)) is not None:
                    break
            assert message.matrix[0, 3] == 42
            assert client.wait_for_message("Image_Reference", timeout=5).image.shape == (1, 30, 40)
            client.send_message(pyigtl.TransformMessage(POSE, device_name="ProbeToReference"))
            assert eventually(lambda: any(message.device == "ProbeToReference" for message in seen))
        finally:
            client.stop()


@pytest.mark.slow
def test_an_example_program_receives(tmp_path):
    """Debian's ReceiveClient prints what it is sent; it ends when it is hung up on."""
    program = igtl_peers.example("Receiver/ReceiveClient", tmp_path)
    with LinkServer(port=0) as server:
        run = started(program, server.port)
        joined(server)
        server.publish(
            pose(42), picture(7, (1, 30, 40)), igtl.Message(igtl.String("touched bone"), "Events"),
            igtl.Message(igtl.Status(13, "later", "Starting"), "Scanner"),
            igtl.Message(igtl.Points([igtl.Point((1, 2, 3.5), "stone")]), "Targets"),
        )  # fmt: skip
        time.sleep(1)
    said = run.communicate(timeout=20)[0]
    for words in ("1, 0, 0, 42", "(40, 30, 1)", "touched bone", "Starting", "stone", "3.5"):
        assert words in said, said


@pytest.mark.slow
def test_an_example_program_asks_for_tracking_data(tmp_path):
    """Debian's TrackingDataClient starts a flow of TDATA, prints some, and stops it."""
    program = igtl_peers.example("TrackingData/TrackingDataClient", tmp_path)
    with LinkServer(port=0) as server:
        run = started(program, server.port, "1000")
        joined(server)
        for _ in range(100):
            server.publish(igtl.Message(igtl.TrackingData([igtl.Tool("Needle", POSE)]), "Tracker", igtl.now()))
            time.sleep(0.01)
    said = run.communicate(timeout=20)[0]
    assert said.count("Needle") >= 5, said  # it counts its ten with what else it is sent
    assert "0, -1, 0, 10" in said
    assert "Sending STP_TDATA" in said


def started(program, port, *arguments):
    return subprocess.Popen(
        [program, "127.0.0.1", str(port), *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
