"""What the browser tests share: a server, a browser, and a page with everything it said and was sent."""

import base64
import io
import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sonospline.server.server import PAGE

SIZES = {
    "desktop": (1440, 900), "compact": (1024, 768), "tablet": (1180, 820), "portrait": (820, 1180), "phone": (360, 740),
}  # fmt: skip
FOCUSED = "document.activeElement.classList.contains('image-pane')"

# What a page says of itself, in its own words.
DEPTH = "Number(document.querySelector('#read-depth').dataset.value)"
MOVED = "Number(document.querySelector('#read-moved').dataset.value)"
STATUS = "document.body.dataset.status"

REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_BROWSER") == "1"
PATIENCE_S = float(os.environ.get("SONOSPLINE_PATIENCE_S", "180"))
"""Machines are shared: a page that is slow is not a page that is wrong."""

# Compositing without a graphics card goes through the processor anyway; with this Chromium does it ten times faster
# than through a simulated card. The 3-D view keeps its WebGL.
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]

# A link whose messages can be held back, which knows what was asked for and what was shown.
LINK = """
window.link = {delay: 0, held: null, mute: false, asked: [], seq: 0, answered: 0, shown: 0, lead: 0, released: null,
               frame: 0, frames: 0, scenes: 0, step: null, replayed: null};
const Native = link.Native = WebSocket;
window.WebSocket = class extends Native {
    constructor(address) {
        super(address);
        link.socket = this;
    }
    set onmessage(handler) {
        const take = (event) => {
            if (event.data instanceof ArrayBuffer && new DataView(event.data).getUint32(0, true) === 1) {
                const length = new DataView(event.data).getUint32(4, true);
                const text = new TextDecoder().decode(new Uint8Array(event.data, 8, length));
                const {seq, state, frame, replay} = JSON.parse(text);
                Object.assign(link, {answered: seq, shown: state.needle.depth, frozen: state.frozen, frame});
                if (replay) link.step ??= replay.step;
                link.came = replay?.step ?? null;
            }
            const said = typeof event.data === "string" ? JSON.parse(event.data) : {};
            link.key = said.session ?? link.key;
            handler(event);
            link.scenes += said.type === "scene";
        };
        super.onmessage = handler && ((event) => {
            const binary = event.data instanceof ArrayBuffer;
            if (link.held && (binary || link.mute)) link.held.push(() => take(event));
            else if (link.delay) setTimeout(take, link.delay, event);
            else take(event);
        });
    }
    send(text) {
        const {type, seq, needle, step, frame} = JSON.parse(text);
        if (type === "show_step") link.step = step;
        if (type === "drawn" && frame === link.frame) link.replayed = link.came;
        if (type === "command") {
            link.seq = seq;
            link.asked.push(needle.depth);
            link.lead = Math.max(link.lead, Math.abs(needle.depth - link.shown));
        }
        super.send(text);
    }
};
link.hold = (mute = false) => { Object.assign(link, {held: [], mute}); };
link.go = () => { const late = link.held; link.held = null; for (const take of late) take(); };
window.addEventListener("keyup", () => { link.released = link.shown; }, true);
const count = () => { link.frames += 1; requestAnimationFrame(count); };
requestAnimationFrame(count);
"""

PAD = """
window.pad = {id: "stub", index: 0, connected: true, mapping: "standard", timestamp: 0, axes: [0, 0, 0, 0],
              buttons: Array.from({length: 17}, () => ({pressed: false, touched: false, value: 0}))};
window.looks = 0;
navigator.getGamepads = () => (window.looks += 1) && [window.plugged ? window.pad : null, null, null, null];
"""


def alike(a, b):
    """Whether two PNG pictures differ by no more than a browser's blending at a rounded corner."""
    first, second = (np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), int) for data in (a, b))
    return first.shape == second.shape and np.abs(first - second).max() <= 1


def lacking(what):
    """Skip a browser test, saying why; where browser tests are demanded it fails."""
    if REQUIRED:
        pytest.fail(what)
    pytest.skip(what)


@contextmanager
def chromium():
    """A headless Chromium of the system's."""
    if not REQUIRED:
        pytest.importorskip("uvicorn")
    playwright = pytest.importorskip("playwright.sync_api") if not REQUIRED else __import__("playwright.sync_api")
    sync_playwright = getattr(playwright, "sync_api", playwright).sync_playwright
    program = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
    if program is None:
        lacking("Chromium was not found (Debian: apt install chromium)")
    if not (PAGE / "index.html").is_file():
        lacking("the page was not built (./run builds it)")
    with sync_playwright() as player:
        browser = player.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield browser
        browser.close()


@contextmanager
def serving(*options):
    """A simulator in a process of its own; yields its address."""
    with started(*options) as said:
        yield said["address"]


@contextmanager
def started(*options):
    """A simulator in a process of its own; yields all that it says at its start."""
    command = [sys.executable, "-m", "sonospline", "serve", "--port", "0", "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.terminate()
            process.wait(20)


class Driver:
    """A page, what it requested, what it complained of, and the frames it was sent."""

    def __init__(
        self,
        browser,
        address,
        *,
        size=(1440, 900),
        touch=False,
        listen=False,
        query="",
        without=None,
        script="",
        **wanted,
    ):
        width, height = size
        asked = {"reduced_motion": "reduce", **wanted}
        self.context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=touch, is_mobile=touch, **asked
        )
        self.context.add_init_script(PAD + script)
        if without:
            self.context.route(without, lambda route: route.abort())
        self.page = self.context.new_page()
        self.page.set_default_timeout(1000 * PATIENCE_S)
        self.complaints, self.requests, self.frames = [], [], []
        self.page.on("console", lambda said: said.type == "error" and self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self._overhear(socket, listen))
        self.address = address
        self.page.goto(address + query)

    def _overhear(self, socket, listen):
        self.requests.append(socket.url)
        if listen:
            socket.on("framereceived", lambda payload: isinstance(payload, bytes) and self._keep(payload))

    def _keep(self, payload):
        if payload[0] != 1:
            return
        length = int.from_bytes(payload[4:8], "little")
        header = json.loads(payload[8 : 8 + length])
        count = header["rows"] * header["columns"]
        pixels = np.frombuffer(payload, np.uint8, count, 8 + length).reshape(header["rows"], header["columns"])
        self.frames.append((header, pixels))

    def live(self):
        """Wait for the first image."""
        self.until("document.body.dataset.status === 'live'")
        return self

    def until(self, expression):
        """Ask again and again, of what may not be there yet, too; the page's own policy forbids Playwright to do so."""
        end = time.monotonic() + PATIENCE_S
        asked = f"(() => {{ try {{ return {expression}; }} catch {{ return false; }} }})()"
        while not self.page.evaluate(asked):
            assert time.monotonic() < end, f"{expression} did not come true"
            self.page.wait_for_timeout(20)

    def evaluate(self, expression):
        return self.page.evaluate(expression)

    def value(self, name):
        """The unrounded value of a read-out."""
        return float(self.page.locator(f"#read-{name}").get_attribute("data-value"))

    def knob(self, axis):
        """The unrounded value of a stepper."""
        return float(self.page.locator(f"[data-knob$={axis}]:visible").get_attribute("data-value"))

    def hold(self, key, until):
        self.page.keyboard.down(key)
        self.until(until)
        self.page.keyboard.up(key)

    def passed(self, frames):
        """Wait for so many animation frames."""
        since = self.evaluate("link.frames")
        self.until(f"link.frames > {since + frames}")

    def answered(self):
        """Wait until what was asked for last is shown."""
        shown = "Number(document.querySelector('canvas.picture').dataset.frame) >= link.frame"
        self.until(f"link.seq === link.answered && {shown}")

    def settled(self):
        """Wait until the read-outs have stood still for half a second, and for ten steps of a slow page."""
        self.page.evaluate(
            """(patience) => new Promise((done, fail) => {
                let [before, since, step] = ["", performance.now(), looks];
                const end = since + patience;
                const numbers = () => [...document.querySelectorAll("output.number")].map((o) => o.dataset.value);
                const look = () => {
                    const now = numbers().join();
                    if (now !== before) [before, since, step] = [now, performance.now(), looks];
                    if (performance.now() - since > 500 && looks > step + 10) done();
                    else if (performance.now() > end) fail(new Error(`${now} after ${looks} looks, not at rest`));
                    else setTimeout(look, 50);
                };
                look();
            })""",
            1000 * PATIENCE_S,
        )

    def drawn(self):
        """The frame on the screen: its number and its grey values."""
        number, columns, data = self.evaluate(
            """() => {
                const canvas = document.querySelector("canvas.picture");
                const {width, height} = canvas;
                const rgba = canvas.getContext("2d").getImageData(0, 0, width, height).data;
                let text = "";
                for (let k = 0; k < rgba.length; k += 4) text += String.fromCharCode(rgba[k]);
                return [Number(canvas.dataset.frame), width, btoa(text)];
            }"""
        )
        return number, np.frombuffer(base64.b64decode(data), np.uint8).reshape(-1, columns)

    def view3d(self):
        """A picture of the 3-D view."""
        return self.page.locator(".view-pane").screenshot()

    def view3d_at_rest(self, other_than=None):
        """A picture of the 3-D view once it stands still, and differs from an earlier one."""
        end = time.monotonic() + PATIENCE_S
        before, now = None, self.view3d()
        while before is None or not alike(now, before) or (other_than and alike(now, other_than)):
            assert time.monotonic() < end, "the 3-D view did not come to rest"
            self.next_step()
            before, now = now, self.view3d()
        return now

    def next_step(self):
        """Wait until the page has looked at its inputs and drawn once more."""
        self.until(f"window.looks > {self.evaluate('window.looks') + 1}")

    def picture(self, name):
        """Keep a picture of the page where pictures are asked for."""
        folder = os.environ.get("SONOSPLINE_SCREENSHOTS")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=Path(folder) / f"{name}.jpg", type="jpeg", quality=82)

    def finish(self):
        """Nothing left the machine, nothing was complained of."""
        own = self.address.split("//")[1].split("/")[0]
        assert {url.split("//")[1].split("/")[0] for url in self.requests} == {own}
        assert self.complaints == [], self.complaints
        self.context.close()


def frame_drawn(number):
    return f"Number(document.querySelector('canvas.picture').dataset.frame) >= {number}"
