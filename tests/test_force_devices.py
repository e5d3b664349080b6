"""Devices by their protocols: what goes over the wire, and what becomes of NaN, silence, strangers and nonsense."""

import json
import logging
import math
import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from builds import needs_core
from force_hands import shaft
from sonospline import _extras
from sonospline.link import (
    Coupling,
    DeviceLimits,
    DeviceState,
    FakeDevice,
    ForceLoop,
    HaplyInverse,
    PageDevice,
    UdpDevice,
)
from sonospline.link.device import DeviceThread
from sonospline.link.udp_device import FORCE, MAGIC, STATE
from test_force_loop import until

EXCHANGE = [
    json.loads(line) for line in (Path(__file__).parent / "haply_inverse_exchange.jsonl").read_text().splitlines()
]

# --- Haply's Inverse service ---


@contextmanager
def service(serve):
    """A WebSocket server of this machine in a thread; its address."""
    server = pytest.importorskip("websockets.sync.server")
    with server.serve(serve, "127.0.0.1", 0) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        try:
            yield f"ws://127.0.0.1:{running.socket.getsockname()[1]}"
        finally:
            running.shutdown()
            thread.join()


def read(device):
    """The next state, which may take the server a moment."""
    found = []
    assert until(lambda: found.append(device.read()) or found[-1] is not None)
    return found[-1]


def test_the_written_exchange_replays_against_the_adapter():
    answers, done = [], threading.Event()

    def serve(socket):
        for line in EXCHANGE:
            if "service" in line:
                socket.send(json.dumps(line["service"]))
            if "answer" in line or "end" in line:
                answers.append(json.loads(socket.recv(timeout=5)))
        done.set()

    with service(serve) as address:
        device = HaplyInverse(address)
        for line in EXCHANGE:
            if "answer" not in line:
                continue
            state = read(device)
            place = [math.nan if x is None else x for x in line["position_mm"]]
            assert state.position_mm == pytest.approx(place, nan_ok=True)
            assert state.velocity_mm_s == pytest.approx(line.get("velocity_mm_s", [0, 0, 0]))
            if "force_n" in line:
                device.write(device.limits.within(tuple(line["force_n"])))
        assert repr(device) == f"HaplyInverse(Inverse3 04BA at {address}, at most 3 N)"
        device.close()
        device.close()
        assert done.wait(5)
    assert answers == [line.get("answer", line.get("end")) for line in EXCHANGE if "answer" in line or "end" in line]


@needs_core
def test_the_loop_drives_an_inverse3_and_lets_go_when_the_service_ends():
    """The service pushes the grip on by 0.5 mm with each command, and closes after some."""
    felt = []

    def serve(socket):
        for k in range(120):
            where = {"x": 0.0, "y": 0.0, "z": min(0.0005 * k, 0.02)}
            socket.send(json.dumps({"inverse3": [{"device_id": "04BA", "state": {"cursor_position": where}}]}))
            command = json.loads(socket.recv(timeout=5))["inverse3"][0]["commands"]["set_cursor_force"]["values"]
            felt.append(command["z"])
            threading.Event().wait(0.002)

    with service(serve) as address, ForceLoop(Coupling(delay_ms=2.0)) as loop:
        loop.attach(HaplyInverse(address))
        while not loop.fault:
            loop.publish(shaft())
            threading.Event().wait(0.01)
        assert "the service has ended the connection" in loop.fault
    assert felt[0] == 0
    assert min(felt) < -0.5


@pytest.mark.parametrize(
    ("first", "given", "match"),
    [
        ("{", {}, "sent '{', which is no JSON; is it the port"),
        ("[1]", {}, "no state; is it the port"),
        ('{"inverse3": []}', {}, "knows no Inverse3; connect one"),
        ('{"inverse3": [{"device_id": "A"}, {"device_id": "B"}]}', {}, "device_id is missing: 2 devices .* A, B"),
        ('{"inverse3": [{"device_id": "A"}]}', {"device_id": "B"}, "device_id = 'B' is not there; give one of A"),
    ],
)
def test_a_service_that_does_not_fit_is_refused_in_a_line(first, given, match):
    with service(lambda socket: socket.send(first)) as address, pytest.raises(ValueError, match=match):
        HaplyInverse(address, **given)


def test_no_service_another_machine_and_a_missing_package_are_each_a_line(monkeypatch):
    pytest.importorskip("websockets")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match="no Inverse service answers at ws://127"):
            HaplyInverse(f"ws://127.0.0.1:{free.getsockname()[1]}")
    with pytest.raises(ValueError, match=r"address = '10\.0\.0\.2' is another machine; give 127"):
        HaplyInverse("ws://10.0.0.2:10001")
    monkeypatch.setattr(_extras, "present", lambda module: False)
    with pytest.raises(_extras.MissingExtraError, match=r"websockets is not installed; run: pip install"):
        HaplyInverse()


# --- UDP ---


@contextmanager
def udp():
    device = UdpDevice(port=0)
    hand = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    hand.connect(("127.0.0.1", device.port))
    hand.settimeout(5)
    try:
        yield device, hand
    finally:
        device.close()
        hand.close()


def test_a_state_comes_in_56_bytes_and_its_force_goes_back_in_32():
    assert (STATE.size, FORCE.size) == (56, 32)
    with udp() as (device, hand):
        assert repr(device) == f"UdpDevice(udp 127.0.0.1:{device.port}, at most 3 N)"
        hand.send(STATE.pack(MAGIC, 5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
        assert read(device) == DeviceState((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        device.write((0.0, -0.5, 0.25))
        assert FORCE.unpack(hand.recv(100)) == (MAGIC, 5, 0.0, -0.5, 0.25)
        device.close()
        assert FORCE.unpack(hand.recv(100)) == (MAGIC, 5, 0.0, 0.0, 0.0)  # no force is left


def test_nonsense_and_messages_that_come_late_are_left_out():
    with udp() as (device, hand):
        for number in (2**32 - 1, 0, 2, 1):  # numbers go on from zero
            hand.send(STATE.pack(MAGIC, number, number, 0, 0, 0, 0, 0))
        hand.send(b"")
        hand.send(b"x" * 56)
        hand.send(STATE.pack(MAGIC, 3, 3, 0, 0, 0, 0, 0)[:-1])
        assert read(device).position_mm[0] == 2
        assert device.read() is None


def test_a_second_hand_is_left_out_with_one_line(caplog):
    with udp() as (device, hand), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        hand.send(STATE.pack(MAGIC, 1, 1, 0, 0, 0, 0, 0))
        assert read(device).position_mm[0] == 1
        with caplog.at_level(logging.WARNING, "sonospline.link"):
            for number in (1, 2, 3):
                other.sendto(STATE.pack(MAGIC, number, 9, 0, 0, 0, 0, 0), ("127.0.0.1", device.port))
                device.read()
        hand.send(STATE.pack(MAGIC, 2, 2, 0, 0, 0, 0, 0))
        assert read(device).position_mm[0] == 2
    assert [record.message.count("comes second") for record in caplog.records] == [1]


def test_a_port_that_is_taken_and_a_host_elsewhere_are_each_a_line():
    with udp() as (device, _), pytest.raises(OSError, match=rf"port = {device.port} on 127.0.0.1 is taken"):
        UdpDevice(port=device.port)
    with pytest.raises(ValueError, match=r"host = '0\.0\.0\.0' is another machine"):
        UdpDevice(host="0.0.0.0")


@needs_core
def test_a_hand_behind_udp_that_sends_nan_or_stops_has_its_force_faded():
    with udp() as (device, hand), ForceLoop(Coupling(delay_ms=1.0)) as loop:
        loop.attach(device)
        for k in range(150):
            loop.publish(shaft())
            hand.send(STATE.pack(MAGIC, k, 0, 0, min(0.1 * k, 10), 0, 0, 0))
            felt = FORCE.unpack(hand.recv(100))[4]
            threading.Event().wait(0.001)
        assert felt < -0.5
        needle = loop.reading.needle_mm
        hand.send(STATE.pack(MAGIC, 150, math.nan, 0, 10, 0, 0, 0))
        assert until(lambda: loop.reading.state == "force is gone: the device says nothing finite since 20 ms")
        assert loop.reading.force_n == (0, 0, 0)
        assert np.isnan(loop.reading.needle_mm) or loop.reading.needle_mm == pytest.approx(needle, abs=0.1)
        loop.publish(shaft())
        hand.send(STATE.pack(MAGIC, 151, 0, 0, 10, 0, 0, 0))
        assert until(lambda: loop.reading.state != "force is gone: the device says nothing finite since 20 ms")


# --- the page, limits, and hands that are not there ---


def test_a_page_shows_a_bar_and_rumbles_when_a_membrane_gives_way():
    page = PageDevice(full_n=3.0)
    assert page.read() is None
    page.receive((1, 2, 3))
    assert page.read().position_mm == (1, 2, 3)
    assert page.read() is None  # each pose once
    page.write((0.0, 0.0, -2.7))
    page.shown()
    steady = page.shown()
    assert (steady.bar, steady.rumble_strong, steady.rumble_weak) == (pytest.approx(0.9), pytest.approx(0.9), 0)
    page.write((0.0, 0.0, -0.6))
    assert page.shown().rumble_weak == pytest.approx(0.7)
    page.close()
    assert page.shown().force_n == (0, 0, 0)


@pytest.mark.parametrize("force", [(math.nan, 0, 0), (math.inf, 0, 0), (1e200, 1e200, 0)])
def test_no_device_is_asked_for_what_is_no_force(force):
    assert DeviceLimits(2.0).within(force) == (0, 0, 0)


def test_a_device_is_asked_for_its_most_in_the_same_direction():
    assert DeviceLimits(2.0).within((3.0, 0.0, -4.0)) == pytest.approx((1.2, 0.0, -1.6))
    with pytest.raises(ValueError, match="force_n = 0 is out of range"):
        DeviceLimits(0)


def test_virtual_time_is_the_same_every_time():
    runs = []
    for _ in range(2):
        device = FakeDevice((0, 0, 0), hands=3, delay_ms=[0, 2, 5], jitter_ms=1.0, loss=0.1, quantum_mm=0.01, seed=4)
        device.renew(shaft())
        runs.append(device.move(lambda t: (0, 0, 20 * t), seconds=0.3))
    assert np.array_equal(runs[0].forces_n, runs[1].forces_n)
    assert repr(runs[0]).startswith("Felt(300 ticks, 3 hands, at most ")


def test_a_hand_without_tissue_goes_where_it_wants_to_be():
    device = FakeDevice((0, 0, 0), mass_kg=0.2, damping_n_s_mm=0.02)
    felt = device.move(lambda t: (0.0, 3.0, 4.0), seconds=1.0)
    assert felt.positions_mm[-1, 0] == pytest.approx([0, 3, 4], abs=1e-3)
    assert not felt.forces_n.any()


class Odd:
    """A device that fails as no document says."""

    name, limits, closed = "odd", DeviceLimits(3.0), False

    def read(self):
        raise OverflowError("int too large to convert to float")

    def write(self, force_n):
        pass

    def close(self):
        self.closed = True


def test_whatever_a_device_raises_it_is_closed_and_said(caplog):
    device = Odd()
    thread = DeviceThread(device, lambda state: None, lambda: (0.0, 0.0, 0.0))
    assert until(lambda: not thread.alive)
    assert device.closed and thread.fault == "odd: int too large to convert to float"
