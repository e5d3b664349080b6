"""Nonsense of every kind, the same in every run: a message or a scene text is used, or refused in one line."""

import json
import random
import socket
import threading
import time
from contextlib import suppress

import pytest

from simulator_client import Client, websockets
from simulator_scenes import SMALL, SMALL_PAPER
from sonospline.server import client_messages as messages
from sonospline.server.client_messages import MOST_SEQ, MessageError
from sonospline.simulator import SceneError, SceneFile
from sonospline.simulator.command import Command

EVERY_DAY, SLOWLY = 2_000, 50_000

STATE = {
    "type": "command", "seq": 1, "frozen": False,
    "needle": {"u": -34.0, "v": 0.0, "angle": 38.0, "swing": 0.0, "depth": 10.0},
    "probe": {"slide": 0.0, "sweep": 0.0, "rotate": 0.0, "fan": 0.0},
    "image": {"gain": 0.0, "depth": 30.0, "frequency": 2.0, "focus": 20.0},
}  # fmt: skip
GOOD = [
    STATE, {"type": "drawn", "frame": 3}, {"type": "model", "model": "paper"}, {"type": "scene", "id": "small"},
    {"type": "open_scene", "name": "mine.toml", "text": "name = 'x'"}, {"type": "target", "id": "vessel"},
    {"type": "undo_pass"}, {"type": "reset"}, {"type": "restore"}, {"type": "view", "grid": True, "ahead": 0},
    {"type": "ping"},
]  # fmt: skip
WILD = [
    "1" + "0" * 400, "-1" + "0" * 400, "1" * 5000, "1e999", "-1e999", "1e-999", "NaN", "-Infinity", "-0.0",
    str(2**53), str(2**53 + 1), str(2**63), "true", "null", '""', '"1"', '"\\ud800"', '"\\u0000"', '"\\n\\u001b[31m"',
    '"' + "x" * 60_000 + '"', "[]", "{}", "[" * 900 + "]" * 900, "[" * 20_000, '{"a":' * 900 + "1" + "}" * 900,
    '{"a": 1, "a": 2}', "[1e400]", '"kidney"', "1.5", "0x10", "'", "+1", ".5", "1_000",
]  # fmt: skip


def broken_message(chance):
    """A good message with something wrong in it, or nothing at all."""
    text = json.dumps(chance.choice(GOOD))
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        text = chance.choice((_wild_value, _other_text, _twice, _cut, _swapped))(text, chance)
    return text


def _wild_value(text, chance):
    """Something else in the place of a value."""
    places = [k for k, letter in enumerate(text) if letter == ":"]
    if not places:
        return chance.choice(WILD)
    start = chance.choice(places) + 1
    end = min((k for k in (text.find(",", start), text.find("}", start)) if k > 0), default=len(text))
    return text[:start] + chance.choice(WILD) + text[end:]


def _other_text(text, chance):
    at = chance.randrange(len(text) + 1)
    return text[:at] + chance.choice(('"', "\\", "{", "[", ",", "\0", "\ud800", "é", "🙂", "\\u", "1" * 30)) + text[at:]


def _twice(text, chance):
    start, end = sorted(chance.randrange(len(text) + 1) for _ in range(2))
    return text[:end] + text[start:end] + text[end:]


def _cut(text, chance):
    return text[: chance.randrange(len(text) + 1)]


def _swapped(text, chance):
    name = chance.choice(("seq", "needle", "depth", "type", "frame", "grid", "id", "text", "u"))
    return text.replace(name, chance.choice(("seq", "needle", "x" * 5000, "", "__class__", "type")), 1)


@pytest.mark.parametrize("tries", [EVERY_DAY, pytest.param(SLOWLY, marks=pytest.mark.slow)])
def test_messages_are_read_or_refused_in_one_line(tries):
    chance, read = random.Random(13), 0
    for _ in range(tries):
        text = broken_message(chance)
        try:
            message = messages.parse(messages.KINDS, text)
        except MessageError as error:
            refusal = str(error)
            assert refusal
            assert "\n" not in refusal
            assert len(refusal) < 600, text[:200]
            json.dumps(refusal).encode()
            assert error.seq is None or 0 <= error.seq <= MOST_SEQ
        else:
            read += 1
            if isinstance(message, messages.CommandMessage):
                assert isinstance(message.command, Command)
    assert 0.02 * tries < read < 0.9 * tries


@pytest.mark.parametrize("value", WILD)
def test_each_wild_value_has_one_clear_refusal(value):
    text = json.dumps(STATE).replace('"depth": 10.0', f'"depth": {value}')
    if value in ("1e-999", "-0.0", "1.5") or (value.lstrip("-").isdigit() and len(value) < 400):
        assert messages.parse(messages.KINDS, text).needle.depth == float(value)
        return
    with pytest.raises(
        MessageError, match=r"needle\.depth .*; give a number|is not JSON|twice; give|half a character"
    ) as caught:
        messages.parse(messages.KINDS, text)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"type": "command", "seq": 1, "seq": 2}', "holds 'seq' twice; give each key once"),
        ('{"type": "drawn", "frame": 1' + "0" * 400 + "}", "frame = (a whole number of 401 digits) is out of range"),
        ('{"type": "drawn", "frame": -1}', "frame = -1 is out of range; give a whole number from 0"),
        ('{"type": "target", "id": "\\udfff"}', "id holds half a character (a lone surrogate); give a text"),
        (
            '{"type": "open_scene", "name": "' + "n" * 300 + '", "text": ""}',
            "name has 300 characters; give at most 255",
        ),
        ('{"type": [[[[[[[[[[]]]]]]]]]]}', "type = [[[[...]]]] is not known"),
        ('{"type": "reset", "' + "k" * 5000 + '": 1}', "is not known"),
    ],
)
def test_refusals_name_what_is_wrong_and_stay_short(text, says):
    with pytest.raises(MessageError) as caught:
        messages.parse(messages.KINDS, text)
    assert says in str(caught.value)
    assert len(str(caught.value)) < 240


def broken_scene(chance):
    text = SMALL
    for _ in range(chance.choice((1, 1, 2, 4))):
        lines = text.split("\n")
        k = chance.randrange(len(lines))
        key, equals, _ = lines[k].partition(" = ")
        lines[k] = chance.choice((
            key + equals + chance.choice(WILD), key + equals + chance.choice(("0x" + "f" * 5000, "1979-05-27", "inf")),
            _cut(lines[k], chance), _other_text(lines[k], chance), lines[k] + "\n" + lines[k], "[" + "a." * 40 + "a]",
            "x = " + "[" * 40,
        ))  # fmt: skip
        text = "\n".join(lines)
    return text


@pytest.mark.parametrize("tries", [500, pytest.param(10_000, marks=pytest.mark.slow)])
def test_scene_texts_are_read_or_refused_in_one_line(tries):
    chance, read = random.Random(13), 0
    for _ in range(tries):
        text = broken_scene(chance)
        try:
            SceneFile.parse(text, file="mine.toml")
        except SceneError as error:
            assert "\n" not in str(error)
            assert len(str(error)) < 600, text
            assert error.line is None or 1 <= error.line <= text.count("\n") + 1
        else:
            read += 1
    assert 0 < read < 0.9 * tries


def sessions():
    """How many sessions run."""
    return sum(thread.name == "sonospline-session" for thread in threading.enumerate())


@pytest.mark.parametrize("tries", [45, pytest.param(600, marks=pytest.mark.slow)])
def test_nonsense_over_the_wire_leaves_the_server_well(running, tries):
    chance, tried = random.Random(13), 0
    before = sessions()
    while tried < tries:
        with Client(running) as page, suppress(websockets.ConnectionClosed):
            page.text("scene")
            for _ in range(15):
                tried += 1
                page.socket.send(broken_message(chance).encode(errors="replace").decode()[:65_000])
            page.send(type="ping")
            page.text("pong")
    with Client(running) as page:
        header, _ = page.ready().frame(page.ask(depth=8.0))
        assert header["state"]["needle"]["depth"] == 8
    end = time.monotonic() + 20
    while sessions() > before:
        assert time.monotonic() < end
        time.sleep(0.01)


REQUESTS = [
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET /live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n",
    b"POST /healthz HTTP/1.1\r\nHost: localhost\r\nContent-Length: 10\r\n\r\n0123456789",
    b"GET /live?session=x&token=y HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
    b"5\r\nhello\r\n0\r\n\r\n",
    b"GET /assets/../../x HTTP/1.0\r\n\r\n",
]
PIECES = [
    b"\r\n", b"\n", b"\0", b"%00", b"%ff", b"Host: x\r\n", b"Content-Length: -1\r\n", b"Expect: 100-continue\r\n",
    b"A" * 70_000, b"Sec-WebSocket-Key: x\r\n", b"Upgrade: h2c\r\n", b"Sec-WebSocket-Protocol: ,,,\r\n", b"\xfc",
    b"Sec-WebSocket-Extensions: permessage-deflate\r\n", b"Origin: http://[\r\n", b"X-Forwarded-For: 1.2.3.4\r\n",
]  # fmt: skip


def broken_request(chance):
    request = bytearray(chance.choice(REQUESTS))
    for _ in range(chance.choice((0, 1, 1, 2, 4, 8))):
        at = chance.randrange(len(request))
        match chance.randrange(4):
            case 0:
                request[at] = chance.randrange(256)
            case 1:
                request[at:at] = chance.choice(PIECES)
            case 2:
                del request[at : at + chance.randrange(10)]
            case 3:
                request += request[at:]
    return bytes(request)


@pytest.mark.parametrize("tries", [60, pytest.param(2_000, marks=pytest.mark.slow)])
def test_nonsense_instead_of_requests_leaves_the_server_well(running, caplog, tries):
    chance, said = random.Random(13), set()
    for _ in range(tries):
        with socket.create_connection(("127.0.0.1", running.port), timeout=20) as peer, suppress(ConnectionError):
            peer.sendall(broken_request(chance))
            with suppress(OSError):  # it is gone already
                peer.shutdown(socket.SHUT_WR)
            answer = peer.recv(64)
            assert not answer or answer.startswith(b"HTTP/1.1 ")
            said.add(answer[9:12].decode())
    assert {"400", "421"} <= said <= {"", "101", "200", "400", "403", "404", "405", "421", "426", "503"}
    assert running.get("/healthz") == (200, "ok")
    assert not caplog.records


def test_a_scene_text_beyond_all_bounds_holds_nobody_up(running):
    with Client(running) as page, Client(running) as other:
        page.ready()
        page.send(type="open_scene", name="a.toml", text="a" + ".a" * 31_500 + " = 1")
        refused = page.text("refused")
        assert (refused["file"], refused["line"]) == ("a.toml", 1)
        assert refused["message"] == "is not TOML: a key has more than 8 parts; give fewer"
        page.send(type="open_scene", name="b.toml", text=SMALL_PAPER)
        page.text("scene")
        other.ready().frame(other.ask(depth=3.0))
