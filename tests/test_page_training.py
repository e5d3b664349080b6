"""Exercises on the page: what is read before, what runs, what is not there, and what came of it."""

from pathlib import Path

import numpy as np
import pytest

from page_driver import DEPTH, FOCUSED, LINK, SIZES, serving
from simulator_scenes import SMALL_PAPER

pytest_plugins = ["page_fixtures"]

PHASE = "document.body.dataset.phase"
COURSE = """
name = "Vessel, quickly"
description = "Bring the needle into the vessel."
level = 2
scene = "gel"
target = "vessel"
model = "kelvinlet"
guides = []
target_in = ["blood"]
time_limit_s = 120
most_passes = 2

[start]
u = [-34.0, -30.0]
angle = [20.0, 30.0]
sweep = [4.0, 8.0]

[entry_zone]
u = [-42.0, -22.0]
v = [-10.0, 10.0]

[pass_mark]
final_error_mm = {most = 3.0}
blind_advance_mm = {most = 8.0}
"""


@pytest.fixture(scope="module")
def course(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("course")
    (folder / "quick.toml").write_text(COURSE)
    guided = COURSE.replace("Vessel, quickly", "Vessel, guided")
    (folder / "guided.toml").write_text(guided.replace("[]", '["path", "target", "tip", "numbers", "3-D view"]', 1))
    with serving("--scene", "gel", "--exercises", str(folder)) as address:
        yield address


@pytest.fixture(scope="module")
def two_targets(browser, tmp_path_factory):
    scene = tmp_path_factory.mktemp("scene") / "small.toml"
    scene.write_text(SMALL_PAPER)
    with serving("--scene", str(scene)) as address:
        yield address


def opened(drive, name="Vessel, quickly", **options):
    """A page with the briefing of an exercise."""
    driver = drive("course", script=LINK, **options)
    driver.page.locator("#scene-button").click()
    driver.until("document.querySelectorAll('#scene-menu [role^=menuitem]').length > 5")
    driver.page.get_by_role("menuitemradio", name=name).click()
    driver.until("!document.querySelector('.briefing:not(.sit-down)').hidden")
    return driver


def begun(drive, name="Vessel, quickly", **options):
    """A page in the middle of an attempt, the needle some way in."""
    driver = opened(drive, name, **options)
    driver.page.get_by_role("button", name="Start").click()
    driver.until(f"{PHASE} === 'attempt' && document.body.dataset.status === 'live'")
    driver.page.locator(".image-pane").focus()
    driver.page.keyboard.down("KeyF")
    driver.hold("ArrowDown", "link.shown > 20")
    driver.page.keyboard.up("KeyF")
    return driver


def test_an_exercise_is_read_done_and_shows_nothing_that_it_forbids(drive):
    driver = opened(drive)
    page = driver.page
    briefing = page.get_by_role("region", name="Vessel, quickly").inner_text()
    for said in ("Level 2 of 3: by the image", "2:00 minutes, 2 passes at most", "blind advance at most 8 mm"):
        assert said in briefing
    page.keyboard.press("Escape")
    driver.until(f"{PHASE} === 'practice'")
    page.locator("#scene-button").click()
    page.get_by_role("menuitemradio", name="Vessel, quickly").click()
    page.get_by_role("button", name="Start").click()
    driver.until(f"{PHASE} === 'attempt' && document.body.dataset.status === 'live'")
    assert driver.evaluate(FOCUSED)
    driver.hold("ArrowDown", "link.shown > 5")
    driver.until("Number(document.querySelector('.run .left').dataset.value) < 120")
    for hidden in (".readouts", ".view-pane", ".motion", ".models", "[data-action=reset]", "[data-action=guides]"):
        assert not page.locator(hidden).first.is_visible(), hidden
    for mark in ("tip", "target", "path"):
        assert not driver.evaluate(f"document.querySelector('.marks .{mark} .line').getAttribute('d')"), mark
    page.keyboard.press("u")  # what would be a way around does nothing
    page.keyboard.press("r")
    page.keyboard.press("1")
    driver.hold("ArrowDown", "link.shown > 8")
    page.keyboard.press("Enter")
    driver.until(f"{PHASE} === 'debrief'")


SHOWN = "Number(document.querySelector('.field .now').getAttribute('aria-valuenow'))"


def showing(driver):
    """Wait until the picture on the screen is the one that was asked for; return its header and its pixels."""
    driver.until("link.replayed !== null && link.replayed === link.step")
    number, pixels = driver.drawn()
    return next(header for header, _ in reversed(driver.frames) if header["frame"] == number), pixels


@pytest.mark.slow
def test_a_debrief_replays_every_picture_to_the_bit(drive):
    driver = begun(drive, listen=True)
    page = driver.page
    driver.hold("ArrowUp", "link.shown < 10")
    driver.hold("ArrowDown", "link.shown > 18")
    driver.answered()
    page.keyboard.press("Enter")
    driver.until(f"{PHASE} === 'debrief' && document.querySelectorAll('.happened button').length > 2")
    live = {header["noise"]: pixels for header, pixels in driver.frames if not header["replay"]}
    driver.until("document.querySelector('.path-views canvas').width > 10")
    seen = set()
    for event in ("skin", "turned back", "“on target”"):
        page.locator(".happened").get_by_role("button", name=event, exact=True).click()
        header, pixels = showing(driver)
        assert header["replay"]["same"] and header["target"], "the truth is laid over it"
        if header["noise"] in live:
            np.testing.assert_array_equal(pixels, live[header["noise"]])
            seen.add(event)
    assert "“on target”" in seen
    page.locator(".field .now").focus()
    page.keyboard.press("Home")
    assert showing(driver)[0]["replay"]["time_s"] == 0
    page.keyboard.press("ArrowRight")
    assert showing(driver)[0]["replay"]["time_s"] > 0
    page.get_by_role("button", name="Play").click()
    driver.until(f"{SHOWN} > 0.5")
    page.get_by_role("button", name="Pause").click()
    showing(driver)
    page.get_by_role("button", name="Truth").click()
    driver.until("!document.querySelector('.marks .target .line').getAttribute('d')")
    page.get_by_role("button", name="Blind advance", exact=True).click()
    assert "out of plane by more than half the slice" in page.locator(".about").inner_text()
    page.get_by_label("A comment on this moment").fill("Sweep first")
    page.get_by_role("button", name="Comment at").click()
    driver.until("document.querySelectorAll('.path-views .comments li').length === 1")
    assert "Sweep first" in page.locator(".happened").inner_text()
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    table = Path(download.value.path()).read_text()
    assert download.value.suggested_filename.endswith("-metrics.csv") and "blind_advance_mm,mm," in table
    page.get_by_role("radio", name="Depth").click()
    driver.until("document.querySelectorAll('.lane-names p').length === 1")
    page.get_by_role("button", name="Same start").click()
    driver.until(f"{PHASE} === 'attempt' && document.body.dataset.status === 'live'")
    assert driver.evaluate(FOCUSED)


@pytest.mark.slow
def test_a_guided_one_shows_all_and_comes_back_after_a_reload(drive):
    driver = begun(drive, "Vessel, guided")
    page = driver.page
    assert page.locator(".readouts").is_visible() and page.locator(".view-pane").is_visible()
    driver.settled()  # what a hand that lets go asked for ahead of the picture is taken back
    depth = driver.evaluate(DEPTH)
    assert depth > 15
    page.reload()
    driver.live()
    driver.until(f"{PHASE} === 'attempt' && {DEPTH} === {depth}")
    page.get_by_role("button", name="Give up").click()
    driver.until(f"{PHASE} === 'debrief'")


@pytest.mark.slow
@pytest.mark.parametrize("layout", SIZES)
def test_every_layout_has_room_for_it(drive, layout):
    from test_page_looks import CLIPPED

    touch = layout not in ("desktop", "compact")
    driver = opened(drive, size=SIZES[layout], touch=touch)
    assert driver.evaluate(CLIPPED) == []
    driver.picture(f"briefing-{layout}")
    driver.page.get_by_role("button", name="Start").click()
    driver.until(f"{PHASE} === 'attempt' && document.body.dataset.status === 'live'")
    for button in ("on target", "Give up"):
        box = driver.page.get_by_role("button", name=button).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= SIZES[layout][0], button
    assert driver.evaluate(CLIPPED) == []
    assert driver.evaluate("document.documentElement.scrollHeight <= innerHeight"), "the page scrolls"
    driver.picture(f"attempt-{layout}")
    driver.page.locator(".image-pane").focus()
    driver.hold("ArrowDown", "link.shown > 6")
    driver.page.get_by_role("button", name="on target").click()
    driver.until(f"{PHASE} === 'debrief' && document.querySelectorAll('.happened button').length > 1")
    if layout != "desktop":
        driver.page.locator(".debrief-tabs").get_by_role("radio", name="Path").click()
    driver.page.get_by_label("A comment on this moment").fill("Sweep first, then push")
    driver.page.get_by_role("button", name="Comment at").click()
    driver.until("document.querySelectorAll('.path-views .comments li').length === 1")
    assert driver.evaluate(CLIPPED) == []
    for button in ("Comment at", "Same start", "New start", "CSV", "Next exercise", "Play"):
        box = driver.page.get_by_role("button", name=button).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= SIZES[layout][0], button
        assert not touch or layout == "phone" or box["height"] >= 43.5, button
    calliper, player = (driver.page.locator(part).bounding_box() for part in (".measuring", ".player"))
    assert layout == "phone" or calliper["y"] + calliper["height"] <= player["y"], "the calliper lies over the player"
    driver.picture(f"debrief-{layout}")


@pytest.mark.slow
def test_a_target_is_chosen_by_its_ring_and_a_distance_is_measured_in_mm(drive):
    driver = drive("two_targets")
    page = driver.page
    driver.until("document.querySelectorAll('.target-ring:not([hidden])').length > 0")
    driver.until("document.querySelector('.target-ring:not([hidden])').style.transform !== ''")
    ring = page.locator(".target-ring:visible").first
    name = ring.get_attribute("aria-label").removeprefix("Aim at ")
    ring.focus()
    page.keyboard.press("Enter")
    driver.until(f"document.querySelector('.marks .label').textContent === '{name}'")
    page.get_by_role("button", name="Calliper").click()
    box = page.locator("canvas.picture").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"]
    page.mouse.click(x, y)
    page.mouse.click(x, y + 0.25 * box["height"])
    driver.until("document.querySelector('.measuring output').dataset.value !== ''")
    measured = float(page.locator(".measuring output").get_attribute("data-value"))
    depth = float(page.locator("[data-knob$='image.depth']:visible").get_attribute("data-value"))
    assert measured == pytest.approx(0.25 * depth, rel=0.15), "a quarter of the picture, which shows that depth"
    page.get_by_role("button", name="Calliper").click()
    assert not page.locator(".calliper").is_visible()
