"""Bone stops the needle on the page: in words, for eyes and ears, and a held key does not wind up against it."""

from itertools import pairwise

import pytest

from page_driver import DEPTH, LINK, Driver, serving
from simulator_scenes import write_ribs

pytest_plugins = ["page_fixtures"]
pytestmark = pytest.mark.slow

NOTICE = "document.querySelector('.notice')"
SAID = "document.querySelector('.unseen [role=status]').textContent"
NOTE = "document.querySelector('.readout.depth .note').textContent"
SURFACE_MM = 23
MOST_MM = 2 + 1e-6


@pytest.fixture(scope="module")
def ribs(browser, tmp_path_factory):
    with serving("--scene", str(write_ribs(tmp_path_factory.mktemp("ribs")))) as address:
        yield address


def test_bone_stops_the_needle_and_is_named(drive):
    driver = drive("ribs", script=LINK)
    page = driver.page
    page.get_by_role("radio", name="Fast").click()
    page.locator(".image-pane").focus()
    page.keyboard.down("ArrowDown")
    driver.until(f"!{NOTICE}.hidden && {NOTICE}.innerText.startsWith('Bone: left rib 8')")
    driver.until(f"{SAID} === 'Bone: left rib 8. The needle stops here: pull it back.'")
    driver.until(f"{NOTE} === 'On bone'")
    assert driver.value("depth") == pytest.approx(SURFACE_MM, abs=0.01)
    asked = driver.evaluate("link.asked.length")
    driver.passed(40)  # with the key still down
    assert driver.evaluate("link.lead") <= MOST_MM
    assert driver.evaluate("Math.max(...link.asked)") <= SURFACE_MM + MOST_MM
    assert driver.evaluate("link.asked.length") <= asked + 1, "the key has let go"
    driver.picture("bone")
    page.keyboard.up("ArrowDown")
    page.keyboard.press("ArrowUp")
    driver.until(f"{DEPTH} < {SURFACE_MM - 1.9}")
    driver.until(f"{NOTE}.startsWith('of ')")


def test_a_fresh_servers_first_push_does_not_wind_up(browser):
    """The first push waits for a model to be made, and meanwhile the key is down, at the fast speed."""
    with serving("--scene", "kidney") as address:
        driver = Driver(browser, address, script=LINK).live()
        driver.page.get_by_role("radio", name="Fast").click()
        driver.page.locator(".image-pane").focus()
        driver.hold("ArrowDown", f"{DEPTH} > 20")
        assert driver.evaluate("link.lead") <= MOST_MM
        driver.answered()
        assert driver.evaluate("link.shown - link.released") <= MOST_MM, "let go, it goes on by a tap at most"
        driver.finish()


@pytest.mark.parametrize("late", [50, 300, 1500])
@pytest.mark.parametrize("pace", ["Slow", "Normal", "Fast"])
def test_a_late_server_is_led_by_two_millimetres_at_most(drive, pace, late):
    driver = drive("ribs", script=LINK)
    driver.page.get_by_role("radio", name=pace).click()
    driver.page.locator(".image-pane").focus()
    driver.answered()
    driver.evaluate(f"link.delay = {late}")
    driver.hold("ArrowDown", f"{DEPTH} > {1 if pace == 'Slow' or late > 1000 else 5}")
    assert driver.evaluate("link.lead") <= MOST_MM


def test_a_late_block_does_not_push_a_needle_back_in(drive):
    """Turned back before the server's word of the bone came, the needle comes out and never goes in again."""
    driver = drive("ribs", script=LINK)
    keys = driver.page.keyboard
    driver.hold("ArrowDown", f"{DEPTH} > {SURFACE_MM - 1}")
    driver.answered()
    driver.evaluate("link.delay = 600")
    keys.down("ArrowDown")
    driver.until(f"link.asked.at(-1) > {SURFACE_MM + 0.4}")
    keys.up("ArrowDown")
    since = driver.evaluate("link.asked.length")
    keys.down("ArrowUp")
    driver.until(f"{DEPTH} < {SURFACE_MM - 4}")
    keys.up("ArrowUp")
    asked = driver.evaluate(f"link.asked.slice({since})")
    assert all(after <= before + 1e-6 for before, after in pairwise(asked)), asked
