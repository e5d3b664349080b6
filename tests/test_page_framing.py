"""Another site in the same browser: it cannot frame the page, nor open its socket, and so fills no places."""

import http.server
import threading
import time

import pytest

from page_driver import PATIENCE_S, STATUS
from simulator_client import Running

pytest_plugins = ["page_fixtures"]

SITE = """<!doctype html><iframe src="{page}"></iframe><script>
window.socket = new Promise((tell) => {{
    const socket = new WebSocket("{live}");
    socket.onopen = () => tell("open");
    socket.onerror = () => tell("refused");
}});
window.image = new Promise((tell) => {{
    const image = new Image();
    image.onload = () => tell("loaded");
    image.onerror = () => tell("refused");
    image.src = "{page}assets/icon.svg";
}});
</script>"""


@pytest.fixture
def another_site():
    """Serve one HTML text under another origin; yields a function that takes it and returns its address."""
    texts = []

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(texts[-1].encode())

        def log_message(self, *said):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Site)
    threading.Thread(target=server.serve_forever).start()

    def publish(text):
        texts.append(text)
        return f"http://localhost:{server.server_port}/"

    yield publish
    server.shutdown()
    server.server_close()


@pytest.mark.slow
def test_another_site_takes_no_place(browser, another_site):
    running = Running(sessions=1)
    context = browser.new_context()
    page, said = context.new_page(), []
    page.on("console", lambda message: said.append(message.text))
    page.goto(another_site(SITE.format(page=running.server.address, live=running.url())), wait_until="load")
    assert page.evaluate("socket") == "refused"
    assert page.evaluate("image") == "refused"
    assert any("frame-ancestors" in text for text in said), said
    assert not running.server.connections
    page.goto(running.server.address)  # its own page is let in
    end = time.monotonic() + PATIENCE_S
    while not page.evaluate(f"{STATUS} === 'live'"):
        assert time.monotonic() < end
    assert len(running.server.connections) == 1
    assert not [text for text in said if "Content Security Policy" in text and "frame-ancestors" not in text]
    context.close()
    running.stop()
