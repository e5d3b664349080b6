"""The live simulator's latency in a browser without a screen: pose sent to its frame drawn, as the page measures it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .._extras import require

# Compositing without a graphics card goes through the processor anyway; with this Chromium does it ten times faster
# than through a simulated card. The 3-D view keeps its WebGL.
ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing")
_VIEW = {"width": 1440, "height": 900}
_LISTEN = """
window.entries = [];
new PerformanceObserver((list) => {
    for (const {name, startTime, duration} of list.getEntries())
        if (name === "pose to drawn") window.entries.push([startTime, duration]);
}).observe({entryTypes: ["measure"]});
"""
_PATIENCE_MS = 60_000
_WARM_UP_MS = 1000.0


class NoBrowserError(RuntimeError):
    """There is none to measure in."""


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield the system's Chromium, without a screen, as Playwright has it.

    Raises
    ------
    NoBrowserError
        Chromium, or Playwright, is not installed.
    """
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        raise NoBrowserError("Chromium was not found (Debian: apt install chromium)")
    try:
        sync_api = require("playwright.sync_api")
    except ImportError as error:
        raise NoBrowserError(str(error)) from None
    with sync_api.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=program, args=list(ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


def pose_to_drawn_ms(address: str, seconds: float) -> list[float]:
    """Push the needle by keyboard for half the time and pull it back for the other; return what each pose took."""
    with chromium() as browser:
        page = browser.new_page(viewport=_VIEW)
        page.set_default_timeout(_PATIENCE_MS)
        page.add_init_script(_LISTEN)
        page.goto(address)
        page.locator("body[data-status=live]").wait_for()
        page.wait_for_timeout(1000)  # the 3-D view comes after the first image
        begun = page.evaluate("performance.now()")
        for key in ("ArrowDown", "ArrowUp"):
            page.keyboard.down(key)
            page.wait_for_timeout(500 * seconds)
            page.keyboard.up(key)
        entries = page.evaluate("window.entries")
    return [duration for start, duration in entries if start > begun + _WARM_UP_MS]
