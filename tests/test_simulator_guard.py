"""Who is let in: names, origins and tokens, by the table and over the wire."""

import http.client
import socket
from pathlib import Path
from urllib.parse import quote

import pytest

from simulator_client import Client, Running, websockets
from sonospline.server.guard import Guard
from sonospline.server.server_messages import PROTOCOL

OURS = "127.0.0.1:8765"
TOKEN = "open sesame & more=ü/?#%"

IN = [
    (OURS, None),
    (OURS, f"http://{OURS}"),
    ("localhost:8765", "http://localhost:8765"),
    ("LOCALHOST:8765", "http://localhost:8765"),
    ("localhost:8765", "HTTP://LocalHost:8765"),
    ("[::1]:8765", "http://[::1]:8765"),
    ("localhost:9000", None),  # ssh -L 9000:localhost:8765
    ("localhost:9000", "http://localhost:9000"),
    ("127.0.0.1:1", "http://127.0.0.1:1"),
    ("127.0.0.1", "http://127.0.0.1"),  # --port 80: browsers leave it out
    ("127.0.0.1:80", "http://127.0.0.1"),
    ("127.0.0.1", "http://127.0.0.1:80"),
    ("localhost", "http://localhost"),
    ("[::1]", "http://[::1]"),
    ("localhost", "https://localhost"),  # behind something that speaks TLS
    ("localhost:443", "https://localhost"),
]
OUT = [
    ("", None),
    ("", "http://"),
    ("evil.example", None),
    ("evil.example:8765", "http://evil.example:8765"),  # DNS rebinding: Host and Origin agree
    ("127.0.0.1.evil.example:8765", None),
    ("localhost.evil.example:8765", None),
    ("evil-localhost:8765", None),
    ("127.0.0.1.:8765", None),
    ("localhost.:8765", None),
    ("0.0.0.0:8765", None),
    ("127.1:8765", None),
    ("2130706433:8765", None),
    ("0x7f.1:8765", None),
    ("[::ffff:127.0.0.1]:8765", None),
    ("[::1:8765", None),
    ("::1:8765", None),
    ("[]:8765", None),
    ("127.0.0.1:8765, evil.example", None),  # two Host headers
    ("evil.example, 127.0.0.1:8765", None),
    ("127.0.0.1:8765:8765", None),
    ("127.0.0.1:", None),
    ("127.0.0.1:99999999", None),
    ("127.0.0.1:\u0668\u0667\u0666\u0665", None),
    ("evil@127.0.0.1:8765", None),
    (" 127.0.0.1:8765", None),
    ("127.0.0.1:8765\n", None),
    ("127.0.0.1:8765/", None),
    (OURS, ""),
    (OURS, "null"),
    (OURS, "http://["),
    (OURS, "http://[::1"),
    (OURS, "http://]"),
    (OURS, "http://127.0.0.1:x"),
    (OURS, "http://127.0.0.1:99999999999"),
    (OURS, "http://127.0.0.1"),
    (OURS, "http://127.0.0.1:80"),
    (OURS, "http://127.0.0.1:3000"),  # another server of this machine
    (OURS, "http://localhost:8765"),
    (OURS, "https://127.0.0.1"),
    (OURS, "ws://127.0.0.1:8765"),
    (OURS, "file://127.0.0.1:8765"),
    (OURS, "chrome-extension://127.0.0.1:8765"),
    (OURS, "//127.0.0.1:8765"),
    (OURS, OURS),
    (OURS, "http://evil.example"),
    (OURS, "http://evil.example/?http://127.0.0.1:8765"),
    (OURS, "http://127.0.0.1:8765.evil.example"),
    (OURS, "http://127.0.0.1:8765@evil.example"),
    (OURS, "http://evil.example@127.0.0.1:8765"),
    (OURS, "http://127.0.0.1:8765/"),
    (OURS, "http://127.0.0.1:8765#"),
    (OURS, "http://127.0.0.1:8765 "),
    (OURS, "http://127.0.0.1:8765\n"),
    (OURS, "http://127.0.0.1:8765, http://evil.example"),  # two Origin headers
    (OURS, "http://evil.example, http://127.0.0.1:8765"),
    (OURS, "http://" + "a" * 60_000),
    (OURS, "\ud800"),
    ("\ud800", None),
    ("localhost:443", "http://localhost"),
]


def headers_of(host, origin):
    return {"host": host} if origin is None else {"host": host, "origin": origin}


@pytest.mark.parametrize(("host", "origin"), IN)
def test_its_own_page_is_let_in(host, origin):
    assert Guard("127.0.0.1", 8765).refusal(headers_of(host, origin), None) is None


@pytest.mark.parametrize(("host", "origin"), OUT)
def test_strangers_are_not(host, origin):
    refusal = Guard("127.0.0.1", 8765).refusal(headers_of(host, origin), None)
    assert "is not this" in refusal
    assert "open http://127.0.0.1:8765/" in refusal
    assert "\n" not in refusal
    assert len(refusal) < 400


def test_there_are_as_many_tricks_as_ever():
    assert len(IN) + len(OUT) >= 47


@pytest.mark.parametrize("given", [None, "", "wrong", TOKEN[:-1], TOKEN + "x", TOKEN.upper(), "\ud800" * 9, "\0" * 9])
def test_a_token_is_the_whole_token(given):
    guard = Guard("0.0.0.0", 80, TOKEN)
    headers = headers_of("myserver", "http://myserver")
    assert guard.refusal(headers, TOKEN) is None
    assert "the token is missing or wrong" in guard.refusal(headers, given)
    assert "is not this page" in guard.refusal(headers_of("myserver", "http://other"), TOKEN)
    assert TOKEN not in guard.refusal(headers_of("myserver", "http://other"), TOKEN)


@pytest.mark.parametrize(
    ("host", "token", "says"),
    [
        ("0.0.0.0", None, r"--host = 0.0.0.0 can be reached by others; give --token of at least 8"),
        ("192.168.1.5", None, r"--host = 192.168.1.5 can be reached by others"),
        ("127.0.0.1", "short", r"--token has 5 characters and can be guessed"),
        ("127.0.0.1", "", r"--token has 0 characters"),
        ("127.0.0.1", "\udcff" * 8, r"is no text a page could send"),
    ],
)
def test_what_would_be_open_to_others_is_refused(host, token, says):
    with pytest.raises(ValueError, match=says):
        Guard(host, 80, token)


@pytest.fixture(scope="module")
def locked():
    running = Running(token=TOKEN)
    yield running
    running.stop()


def status_of(running, path="/live", **headers):
    """How the opening of a WebSocket ends before it is open, and the reason."""
    with pytest.raises(websockets.InvalidStatus) as caught, Client(running, path, additional_headers=headers):
        pass
    response = caught.value.response
    return response.status_code, response.body.decode(), response.headers


@pytest.mark.parametrize("headers", [{"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://["}])
def test_a_foreign_origin_is_turned_away_before_the_socket_opens(running, headers):
    status, reason, _ = status_of(running, **headers)
    assert status == 403
    assert "is not this page" in reason


def test_its_own_origin_is_let_in(running):
    with Client(running, additional_headers={"Origin": f"http://127.0.0.1:{running.port}"}) as client:
        assert client.text("hello")["protocol"] == PROTOCOL


def test_a_token_works_over_the_wire_and_as_the_address_says_it(locked):
    address = locked.server.address
    assert address == f"http://127.0.0.1:{locked.port}/?token={quote(TOKEN, safe='')}"
    with Client(locked, "/live" + address[address.index("?") :]) as client:
        assert client.text("hello")["protocol"] == PROTOCOL
    for query in ("", "?token=wrong", f"?token={quote(TOKEN)}&token=x", "?token=%ff%fe", "?token"):
        status, reason, _ = status_of(locked, "/live" + query)
        assert (status, "token is missing or wrong" in reason) == (403, True)


def raw(running, request):
    with socket.create_connection(("127.0.0.1", running.port)) as peer:
        peer.sendall(request)
        peer.settimeout(20)
        answer = b""
        while some := peer.recv(65536):
            answer += some
    return answer


UPGRADE = b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n" \
    b"Sec-WebSocket-Version: 13\r\n\r\n"  # fmt: skip


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        (b"Host: evil.example\r\n", b"403"),
        (b"Host: %s\r\nOrigin: http://%s\r\nOrigin: http://evil.example\r\n", b"400"),
        (b"Host: %s\r\nHost: evil.example\r\n", b"400"),
        (b"Host: %s\r\nOrigin: http://\xff\r\n", b"403"),
    ],
)
def test_tricks_over_the_wire_open_nothing(running, lines, status):
    here = b"127.0.0.1:%d" % running.port
    answer = raw(running, b"GET /live HTTP/1.1\r\n" + lines.replace(b"%s", here) + UPGRADE)
    assert answer.startswith(b"HTTP/1.1 " + status)
    assert b"hello" not in answer


def test_who_is_turned_away_takes_no_place_and_leaves_no_trace(running, caplog):
    for _ in range(20):
        assert status_of(running, Origin="http://evil.example")[0] == 403
    assert not running.server.connections
    assert not caplog.records


PATHS = [
    "/", "/index.html", "/healthz", "/api/scene-schema.json", "/live", "/nothing", "/%00", "/..%2f..%2fetc/passwd",
    "/assets", "/?token=x",
]  # fmt: skip


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("host", [None, "evil.example"])
@pytest.mark.parametrize("method", ["GET", "POST", "HEAD", "BREW"])
def test_every_answer_keeps_other_sites_out(running, path, host, method):
    peer = http.client.HTTPConnection("127.0.0.1", running.port, timeout=20)
    peer.request(method, path, headers={} if host is None else {"Host": host})
    response = peer.getresponse()
    assert (response.status == 421) == (host is not None)
    assert response.status < 500 or (response.status == 503 and not has_page())
    guarded(response.headers)
    peer.close()


def guarded(headers):
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    policy = headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in policy
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy


def test_refused_sockets_and_nonsense_carry_the_headers_too(running, caplog):
    guarded(status_of(running, Origin="http://evil.example")[2])
    answer = raw(running, b"nonsense\r\n\r\n").decode()
    assert answer.startswith("HTTP/1.1 400")
    assert "x-frame-options: DENY" in answer
    here = b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    raw(running, here + b"Upgrade: h2c\r\nConnection: Upgrade, close\r\n\r\n")
    with Client(running) as page, pytest.raises(websockets.ConnectionClosed) as caught:
        page.text("hello")
        page.socket.socket.sendall(b"\x81\x82\0\0\0\0\xff\xff")  # no text
        page.text("never")
    assert caught.value.rcvd.code == 1007
    assert not caplog.records


def test_static_files_carry_the_headers(running):
    if not has_page():
        pytest.skip("the page was not built")
    page = http.client.HTTPConnection("127.0.0.1", running.port, timeout=20)
    page.request("GET", "/")
    script = page.getresponse().read().decode().partition('src="./')[2].partition('"')[0]
    page.request("GET", f"/{script}")
    response = page.getresponse()
    assert response.status == 200
    assert "javascript" in response.headers["Content-Type"]
    guarded(response.headers)
    page.close()


def has_page():
    from sonospline.server import server

    return (Path(server.__file__).parent / "page" / "index.html").is_file()


def test_a_page_can_ask_why_its_socket_does_not_open(running, locked):
    status, reason = locked.get("/live")
    assert (status, "token is missing or wrong" in reason) == (403, True)
    assert locked.get(f"/live?token={quote(TOKEN, safe='')}")[0] == 426
    assert running.get("/live")[0] == 426
