"""The live simulator's page in a headless Chromium: what a person sees, and what the library says to it."""

from itertools import pairwise

import numpy as np
import pytest

from page_driver import DEPTH, LINK, MOVED, STATUS, Driver, frame_drawn, serving
from sonospline.simulator import Console, Session
from sonospline.simulator.command import Command, ImageSettings, NeedleCommand, ProbeCommand

pytest_plugins = ["page_fixtures"]

PUSHES = 6
"""Tries until a machine that others use, too, sends every picture."""


def command_of(state):
    return Command(
        needle=NeedleCommand(**state["needle"]),
        probe=ProbeCommand(**state["probe"]),
        image=ImageSettings(**state["image"]),
    )


def test_the_first_image_comes_by_itself(browser):
    """How soon is the claim of benchmarks/the_first_image_comes_within_three_seconds.py."""
    with serving() as address:
        driver = Driver(browser, address).live()
        assert driver.drawn()[1].std() > 5, "the first image is empty"
        driver.finish()


def pushed(drive):
    """A page whose needle was pushed and which was frozen then: at rest, and what it was sent until then."""
    driver = drive("kidney", listen=True)
    driver.until(f"{MOVED} === 0")
    rest, target_at_rest, view = driver.drawn()[1], driver.value("tip-to-target"), driver.view3d()
    driver.page.keyboard.down("KeyF")  # fast
    driver.hold("ArrowDown", f"{DEPTH} > 45")
    driver.page.keyboard.up("KeyF")
    driver.settled()
    driver.page.keyboard.press("Space")
    driver.until(f"{STATUS} === 'frozen'")
    driver.settled()
    number, shown = driver.drawn()
    assert driver.view3d() != view
    assert (shown != rest).mean() > 0.1
    sent = [(h, p) for h, p in driver.frames if h["frame"] <= number]
    return driver, target_at_rest, shown, sent


def skipped(sent):
    """Pictures that a session made and a busy server did not send, or only frozen: nobody knows what they answered."""
    return [
        header["noise"]
        for (before, _), (header, _) in pairwise(sent)
        if header["noise"] > before["noise"] + (not header["state"]["frozen"])
    ]


@pytest.mark.slow
def test_pushing_shows_what_the_library_computes_and_pulling_back_returns_to_rest(drive):
    for _ in range(PUSHES):
        driver, target_at_rest, shown, sent = pushed(drive)
        if not skipped(sent):
            break
    assert not skipped(sent), "the machine is too busy for all pictures of a push to be sent"

    # the same states in the same order: every number and every pixel is the library's
    console = Console(Session("kidney"))
    console.step()  # the server makes a first picture before anybody asks
    for header, _ in sent:
        if not header["state"]["frozen"]:
            frame = console.step(command_of(header["state"]))
    pixels = sent[-1][1]
    np.testing.assert_array_equal(shown, pixels)
    np.testing.assert_array_equal(pixels, frame.image.pixels)
    assert driver.value("tip-to-target") == pytest.approx(frame.readouts.tip_to_target, abs=0.01)
    assert driver.value("moved") == pytest.approx(frame.readouts.moved, abs=0.01)
    assert driver.value("depth") == pytest.approx(frame.readouts.depth, abs=0.01)
    assert driver.value("moved") > 0.02

    driver.page.keyboard.press("Space")
    driver.until(f"{STATUS} === 'live'")
    driver.page.keyboard.press("Home")
    driver.until(f"{DEPTH} === 0")
    driver.settled()
    assert driver.value("moved") == 0
    assert driver.value("tip-to-target") == pytest.approx(target_at_rest, abs=0.001)


@pytest.mark.slow
def test_freeze_holds_image_needle_and_probe(drive):
    driver = drive(script=LINK)
    driver.until("document.querySelector('canvas.view3d') !== null")  # it asks for a frame when it comes
    driver.page.keyboard.press("Space")
    driver.until(f"{STATUS} === 'frozen'")
    driver.answered()  # the server may be at work for the first push, and answer late
    driver.next_step()
    number, pixels = driver.drawn()
    driver.page.keyboard.press("ArrowDown")
    driver.page.keyboard.press("KeyD")
    driver.until("document.querySelector('.notice').innerText.startsWith('Frozen')")
    driver.passed(30)
    assert driver.drawn()[0] == number
    assert (driver.drawn()[1] == pixels).all()
    driver.page.get_by_role("button", name="Frozen").first.click()
    driver.until(frame_drawn(number + 2))
    assert (driver.value("depth"), driver.knob("slide")) == (0, 0)


def test_models_undo_reset_and_new_entry(drive):
    driver = drive()
    keys, page = driver.page.keyboard, driver.page
    page.get_by_role("radio", name="Paper spline").click()
    driver.until("document.querySelector('[data-model=paper]').getAttribute('aria-checked') === 'true'")
    keys.down("KeyF")
    driver.hold("ArrowDown", f"{DEPTH} > 20")
    keys.up("KeyF")
    driver.settled()
    depth, moved = driver.value("depth"), driver.value("moved")
    keys.press("Digit2")
    driver.until(f"Math.abs({MOVED} - {moved}) > 1e-3")
    driver.settled()
    assert driver.value("depth") == depth, "a switch keeps the pose"
    assert page.locator(".plot path.other").count() == 1, "the old curve stays"

    keys.press("KeyU")
    driver.until(f"{DEPTH} === 0 && {MOVED} === 0")
    keys.press("KeyN")
    entry = driver.page.locator(".handle").get_attribute("transform")
    keys.press("ArrowRight")
    driver.until(f"document.querySelector('.handle').getAttribute('transform') !== '{entry}'")
    keys.press("ArrowDown")
    driver.until(f"{DEPTH} === 0.5")
    keys.press("KeyD")
    keys.press("KeyR")
    driver.until(f"{DEPTH} === 0")
    assert driver.knob("slide") == 0
    page.get_by_role("button", name="Undo reset").click()
    driver.until(f"{DEPTH} === 0.5")
    assert driver.knob("slide") == 0.5


def test_a_broken_scene_is_refused_beside_the_image_and_the_session_goes_on(drive):
    driver = drive()
    text = 'name = "Broken"\n[tissue]\nsource = "gel block"\n[needle]\nlength_mm = -1.2\n'
    driver.page.locator("input[type=file]").set_input_files(
        {"name": "broken.toml", "mimeType": "text/plain", "buffer": text.encode()}
    )
    sheet = driver.page.locator(".sheet")
    sheet.wait_for()
    assert "broken.toml. Gel block with a vessel keeps running." in sheet.inner_text()
    assert "-1.2" in sheet.locator("pre").inner_text()
    driver.until(frame_drawn(driver.drawn()[0] + 3))
    sheet.get_by_role("button", name="Choose a scene").click()
    driver.page.get_by_role("menuitemradio", name="The paper's cube").click()
    driver.until("document.querySelector('#scene-button b').textContent.includes('cube')")
    driver.live()


@pytest.mark.slow
def test_help_and_what_screen_readers_hear(drive):
    driver = drive()
    page = driver.page
    page.keyboard.press("?")
    dialog = page.get_by_role("dialog", name="Controls")
    dialog.wait_for()
    assert "Pull back to the skin" in dialog.inner_text()
    page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    page.keyboard.press("ArrowDown")  # the image has the focus again
    driver.until(f"{DEPTH} === 0.5")
    nameless = driver.evaluate(
        """() => [...document.querySelectorAll("button, input, [role=slider], [tabindex='0']")]
            .filter((e) => !(e.hidden || e.labels?.length || e.textContent.trim()
                || e.getAttribute("aria-label") || e.getAttribute("aria-labelledby")))
            .map((e) => e.outerHTML.slice(0, 120))"""
    )
    assert nameless == []
    assert page.get_by_role("heading", level=1).count() == 1


@pytest.mark.slow
def test_latency_is_measured_by_sequence_numbers(drive):
    driver = drive()
    driver.page.get_by_role("radio", name="Kelvinlet").click()
    driver.page.locator(".image-pane").focus()
    driver.page.keyboard.down("ArrowDown")
    driver.until(
        "document.querySelector('.latency').dataset.value > 0 && document.querySelector('.latency').textContent !== '–'"
    )
    driver.page.keyboard.up("ArrowDown")
    assert 0 < float(driver.page.locator(".latency").get_attribute("data-value")) < 10_000
