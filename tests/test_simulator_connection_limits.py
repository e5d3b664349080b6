"""Connections without end: half-open ones, ones that never read, ones that pile things up; and pages get in."""

import asyncio
import contextlib
import re
import resource
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simulator_client import Client, Running
from simulator_scenes import SMALL_PAPER
from sonospline.server import connection_limits, conversation, protocols, server
from sonospline.server.connection_limits import ConnectionLimits, pending_within

UPGRADE = (
    "GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


class Transport:
    def __init__(self, host, port):
        self.peer, self.aborted = (host, port), False

    def get_extra_info(self, name):
        assert name == "peername"
        return self.peer

    def abort(self):
        self.aborted = True


def until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_the_longest_silent_of_the_busiest_peer_makes_room():
    async def crowd():
        limits = ConnectionLimits(4)
        quiet = Transport("10.0.0.1", 1)
        busy = [Transport("10.0.0.2", port) for port in range(5)]
        for transport in (quiet, *busy[:3]):
            limits.opened(transport)
        limits.requested(busy[0].peer)  # it asked for something: the second is now the longest silent
        for transport in busy[3:]:
            limits.opened(transport)
        assert [transport.aborted for transport in busy] == [False, True, True, False, False]
        assert not quiet.aborted
        assert limits.pending == 4

    asyncio.run(crowd())


def test_neighbours_of_an_ipv6_network_are_one_peer():
    async def crowd():
        limits = ConnectionLimits(2)
        alone, *many = [Transport(host, 1) for host in ("2001:db8:1::1", "2001:db8:2::1", "2001:db8:2::2")]
        for transport in (alone, *many):
            limits.opened(transport)
        assert [transport.aborted for transport in (alone, *many)] == [False, True, False]

    asyncio.run(crowd())


def test_each_stage_has_its_time(monkeypatch):
    for name in ("FIRST_REQUEST_S", "ANSWER_S", "GOODBYE_S"):
        monkeypatch.setattr(connection_limits, name, 0.01)

    async def ended(transport):
        while not transport.aborted:
            await asyncio.sleep(0.001)

    async def stages():
        limits = ConnectionLimits()
        silent, asking, leaving, staying = (Transport("10.0.0.1", port) for port in range(4))
        for transport in (silent, asking, leaving, staying):
            limits.opened(transport)
        limits.requested(asking.peer)
        assert limits.upgraded(leaving.peer) is leaving
        assert limits.upgraded(staying.peer) is staying
        limits.closing(leaving)
        await asyncio.wait_for(asyncio.gather(*map(ended, (silent, asking, leaving))), 10)
        assert not staying.aborted
        assert limits.pending == 0

    asyncio.run(stages())


def test_an_address_that_comes_again_is_another_connection(monkeypatch):
    monkeypatch.setattr(connection_limits, "GOODBYE_S", 0.01)

    async def again():
        limits = ConnectionLimits()
        first, second = Transport("10.0.0.1", 1), Transport("10.0.0.1", 1)
        limits.opened(first)
        assert limits.upgraded(first.peer) is first
        limits.opened(second)
        limits.closing(first)
        while not first.aborted:
            await asyncio.sleep(0.001)
        assert not second.aborted
        assert limits.upgraded(second.peer) is second

    asyncio.run(again())


def test_open_files_bound_guests_and_sessions():
    assert pending_within(None, 8) == connection_limits.MOST_PENDING
    assert pending_within(1024, 8) == connection_limits.MOST_PENDING
    assert pending_within(100, 8) == 28
    with pytest.raises(ValueError, match=r"--sessions = 2000 is more than 1024 open files allow; give at most 952"):
        pending_within(1024, 2000)
    with pytest.raises(ValueError, match=r"--sessions = 1 is more than 16 open files allow; raise the limit"):
        pending_within(16, 1)


def half_open(stack, port, count):
    peers = []
    for number in range(count):
        peer = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=20))
        peer.sendall(b"GET / HT" if number % 2 else b"")
        peers.append(peer)
    return peers


@pytest.mark.parametrize("count", [200, pytest.param(1060, marks=pytest.mark.slow)])
def test_half_open_connections_lock_nobody_out(count):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(hard, 4096) if hard != resource.RLIM_INFINITY else 4096
    if wanted < 2 * count + 200:
        pytest.skip(f"{hard} open files are too few for {count} connections and their server in one process")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), hard))
    running = Running()
    try:
        with contextlib.ExitStack() as stack:
            half_open(stack, running.port, count)
            assert running.get("/healthz") == (200, "ok")
            with Client(running) as page:
                page.ready().frame(page.ask(depth=4.0))
                half_open(stack, running.port, connection_limits.MOST_PENDING + 10)  # whoever has a session keeps it
                page.frame(page.ask(depth=5.0))
            until(lambda: running.server.limits.pending <= connection_limits.MOST_PENDING)
    finally:
        running.stop()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_who_says_nothing_is_ended(running, monkeypatch):
    monkeypatch.setattr(connection_limits, "FIRST_REQUEST_S", 0.1)
    with socket.create_connection(("127.0.0.1", running.port), timeout=20) as peer:
        peer.sendall(b"GET / HTTP/1.1\r\nHost: 127")
        assert ended(peer)


def ended(peer):
    """Whether the server ends a connection, in whatever way, after whatever else it sends."""
    with contextlib.suppress(ConnectionResetError):
        while peer.recv(65536):
            pass
    return True


def opened(port, receive_buffer=None):
    """A WebSocket that reads nothing but the answer to its handshake."""
    peer = socket.socket()
    if receive_buffer is not None:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    peer.settimeout(20)
    peer.connect(("127.0.0.1", port))
    peer.sendall(UPGRADE.format(port=port).encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += peer.recv(1)
    assert head.startswith(b"HTTP/1.1 101")
    return peer


def frame(first, payload):
    """A masked WebSocket frame."""
    size, mask = len(payload), b"\1\2\3\4"
    head = struct.pack("!BB", first, 0x80 | size) if size < 126 else struct.pack("!BBH", first, 0xFE, size)
    return head + mask + bytes(byte ^ mask[k % 4] for k, byte in enumerate(payload))


@pytest.mark.parametrize(
    "message",
    [
        pytest.param(b'{"type": "undo_pass"}', marks=pytest.mark.slow),
        pytest.param(b'{"type": "ping"}', marks=pytest.mark.slow),
        pytest.param(b"no", marks=pytest.mark.slow),
        None,
    ],
)
def test_a_client_that_never_reads_loses_its_place(monkeypatch, message):
    monkeypatch.setattr(conversation, "UNREAD_S", 0.3 if message is None else 600)  # else by what piles up
    monkeypatch.setattr(server, "PING_S", 1.0 if message is None else 600)
    running = Running(sessions=1)
    running.server.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)  # else the system holds it all
    with opened(running.port, receive_buffer=2048) as peer:
        until(lambda: any(len(connection._flow._flying) == 2 for connection in running.server.connections))
        with contextlib.suppress(OSError):
            while running.server.connections and message is not None:
                peer.sendall(frame(0x81, message))
        until(lambda: not running.server.connections, 60)
        with Client(running) as page:
            page.ready().frame(page.ask(depth=3.0))
    running.stop()


def test_a_place_is_free_at_once_when_the_socket_dies():
    running = Running(sessions=1)
    for end in ("reset", "closed"):
        peer = opened(running.port)
        until(lambda: running.server.connections)
        if end == "reset":
            peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer.close()
        began = time.monotonic()
        until(lambda: not running.server.connections)
        assert time.monotonic() - began < 5
    running.stop()


def test_what_a_proxy_says_of_a_client_does_not_make_it_a_stranger(running, monkeypatch):
    """A header that names another client: the connection is still known as its own, and stays."""
    monkeypatch.setattr(connection_limits, "ANSWER_S", 0.1)
    with Client(running, additional_headers={"X-Forwarded-For": "10.0.0.1"}) as page:
        page.ready()
        until(lambda: running.server.limits.pending == 0)
        page.frame(page.ask(depth=4.0))


@pytest.mark.parametrize(
    ("flood", "bound"),
    [(frame(0x89, b"p" * 125) * 500, "MOST_UNREAD"), (frame(0x01, b"") + frame(0x00, b"") * 500, "MOST_PARTS")],
    ids=["pings whose answers are not read", "a message of empty pieces"],
)
def test_what_piles_up_is_ended(monkeypatch, flood, bound):
    monkeypatch.setattr(protocols, bound, 64 * 1024 if bound == "MOST_UNREAD" else 100)
    running = Running()
    with opened(running.port, receive_buffer=2048) as peer:
        with contextlib.suppress(OSError):  # reset or broken pipe
            while True:
                peer.sendall(flood)
        until(lambda: not running.server.connections)
    running.stop()


@pytest.mark.slow
def test_a_process_with_few_open_files_serves_on(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL_PAPER)
    command = 'ulimit -n 110; exec "$0" -m sonospline serve --port 0 --json --scene small.toml'
    process = subprocess.Popen(["bash", "-c", command, sys.executable], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        port = int(re.search(r":(\d+)/", process.stdout.readline())[1])
        with contextlib.ExitStack() as stack:
            half_open(stack, port, 150)
            with socket.create_connection(("127.0.0.1", port), timeout=30) as peer:
                peer.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
                answer = b""
                while some := peer.recv(4096):
                    answer += some
        assert answer.endswith(b"ok")
        assert len(list(Path(f"/proc/{process.pid}/fd").iterdir())) < 110
    finally:
        process.terminate()
        process.wait(30)
        process.stdout.close()
