"""What is asked of the tissue is never far ahead of what is shown, and a place to go to is gone to, not jumped to."""

import numpy as np
import pytest

from page_driver import DEPTH, LINK, SIZES

pytest_plugins = ["page_fixtures"]

MOST_MM = 2 + 1e-6
TRACK = "document.querySelector('.track .goal')"


def centre(driver, selector):
    box = driver.page.locator(selector).first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def along_the_needle(driver, far):
    """A place on the needle's line, seen from its handle."""
    angle = np.radians(driver.knob("angle"))
    x, y = centre(driver, ".handle .ring")
    return (x, y), (x + far * np.cos(angle), y + far * np.sin(angle))


def hold_key(driver):
    driver.page.keyboard.down("ArrowDown")


def hold_button(driver):
    driver.page.mouse.move(*centre(driver, ".dock .push"))
    driver.page.mouse.down()


def pull_the_trigger(driver):
    driver.evaluate("window.plugged = true; window.pad.buttons[7] = {pressed: true, value: 1}")


def turn_the_wheel(driver):
    driver.page.mouse.move(*centre(driver, ".image-pane"))
    for _ in range(20):
        driver.page.mouse.wheel(0, 400)


def drag_the_handle(driver):
    start, end = along_the_needle(driver, 150)
    driver.page.mouse.move(*start)
    driver.page.mouse.down()
    driver.page.mouse.move(*end, steps=4)


def click_the_track(driver):
    box = driver.page.locator(".track .rail").bounding_box()
    driver.page.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 12)


def push_the_lever(driver):
    finger = driver.page.context.new_cdp_session(driver.page)
    x, y = centre(driver, ".lever .knob")
    finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
    finger.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x, "y": y + 90}]})


WAYS = [hold_key, hold_button, pull_the_trigger, turn_the_wheel, drag_the_handle, click_the_track, push_the_lever]


@pytest.mark.slow
@pytest.mark.parametrize("push", WAYS, ids=lambda way: way.__name__)
def test_no_way_of_pushing_runs_ahead_of_a_picture_that_does_not_come(drive, push):
    """As on a server at work on its first push: frames come late, and meanwhile the needle is not pushed blindly."""
    touch = push is push_the_lever
    driver = drive(size=SIZES["tablet"] if touch else SIZES["desktop"], touch=touch, script=LINK)
    driver.page.get_by_role("radio", name="Fast").click() if not touch else driver.page.locator(".pace:visible").tap()
    driver.answered()
    driver.evaluate("link.hold()")
    push(driver)
    driver.until("link.asked.at(-1) > 1.9")
    driver.passed(40)
    assert driver.evaluate("link.asked.at(-1)") <= MOST_MM, "nothing is shown yet"
    driver.evaluate("link.go(); link.delay = 300")
    if push is turn_the_wheel:
        push(driver)
    driver.until(f"{DEPTH} > {3.9 if push is turn_the_wheel else 6}")
    assert driver.evaluate("link.lead") <= MOST_MM


@pytest.mark.slow
def test_letting_go_leaves_the_needle_where_it_is_shown(drive):
    driver = drive(script=LINK)
    driver.answered()
    driver.evaluate("link.delay = 250")
    driver.hold("ArrowDown", f"{DEPTH} > 3")
    driver.answered()
    left = driver.evaluate("[link.released, link.shown]")
    assert left[1] - left[0] <= 0.5 + 1e-6, "at most a tap further"


@pytest.mark.slow
def test_turning_and_sliding_do_not_run_ahead_either(drive):
    driver = drive(script=LINK)
    angle, keys = driver.knob("angle"), driver.page.keyboard
    driver.answered()
    driver.evaluate("link.hold()")
    for key in ("KeyF", "ArrowRight", "KeyD", "KeyW", "KeyE", "KeyX"):
        keys.down(key)
    driver.passed(60)
    assert driver.knob("angle") - angle == pytest.approx(2)
    assert [driver.knob(axis) for axis in ("slide", "sweep", "rotate", "fan")] == pytest.approx([2, 2, 4, 4])


@pytest.mark.slow
def test_the_track_is_gone_along_and_not_jumped_on(drive):
    driver = drive(script=LINK)
    page = driver.page
    rail = page.locator(".track .rail").bounding_box()
    length = float(page.locator(".track .rail").get_attribute("aria-valuemax"))

    def click(share):
        page.mouse.click(rail["x"] + share * rail["width"], rail["y"] + 12)

    click(0.1)
    driver.until(f"Math.abs({DEPTH} - {0.1 * length}) < 0.2")
    driver.until(f"{TRACK}.hidden")
    steps = np.diff(driver.evaluate("[0, ...link.asked]"))
    assert steps.min() >= 0
    assert steps.max() <= MOST_MM, "no jump"

    click(0.8)
    driver.until(f"{DEPTH} > {0.1 * length + 1}")
    click(0.05)  # a second click changes the way
    driver.until(f"Math.abs({DEPTH} - {0.05 * length}) < 0.2")
    click(0.8)
    driver.until(f"{DEPTH} > {0.05 * length + 1} && !{TRACK}.hidden")
    page.keyboard.press("ArrowUp")  # a key of the needle stops it
    assert driver.evaluate(f"{TRACK}.hidden")
    driver.answered()
    stopped = driver.evaluate("link.shown")
    driver.passed(20)
    assert driver.evaluate("link.shown") == stopped < 0.5 * length
    click(0.8)
    driver.until(f"!{TRACK}.hidden")
    page.keyboard.press("Escape")
    driver.until(f"{TRACK}.hidden")


@pytest.mark.slow
def test_what_is_left_with_a_key_held_stops(drive):
    """Another window, a hidden tab: the key comes up where nobody hears it."""
    driver = drive(script=LINK)
    driver.page.keyboard.down("ArrowDown")
    driver.until(f"{DEPTH} > 1")
    driver.evaluate("window.dispatchEvent(new Event('blur'))")
    driver.answered()
    asked = driver.evaluate("link.asked.at(-1)")
    driver.passed(30)
    assert driver.evaluate("link.asked.at(-1)") == asked


@pytest.mark.slow
def test_a_push_right_after_a_pass_is_undone_starts_at_the_skin(drive):
    driver = drive(script=LINK)
    driver.hold("ArrowDown", f"{DEPTH} > 3")
    driver.answered()
    driver.evaluate("link.hold()")
    driver.page.keyboard.press("KeyU")
    driver.page.keyboard.press("ArrowDown")
    driver.evaluate("link.go()")
    driver.answered()
    driver.until(f"{DEPTH} <= 0.5")
    assert driver.evaluate("link.asked.at(-1)") <= 0.5


@pytest.mark.slow
def test_what_is_limited_is_said(drive):
    driver = drive(script=LINK)
    page = driver.page
    notice = "document.querySelector('.notice').innerText"
    driver.hold("ArrowDown", f"{DEPTH} > 4")
    angle = driver.knob("angle")
    page.locator("[data-knob$=angle]:visible").fill(str(angle + 20))
    page.keyboard.press("Enter")
    driver.until(f"{notice}.startsWith('Turns no further')")
    assert "stops here" not in driver.evaluate(notice)
    page.locator(".image-pane").focus()
    driver.answered()
    assert angle + 5 <= driver.knob("angle") < angle + 20, "short of what was asked for"
    page.keyboard.press("Home")
    driver.until(f"{DEPTH} === 0")
    page.locator("[data-knob$=angle]:visible").fill("90")
    page.keyboard.press("Enter")
    page.locator(".image-pane").focus()
    driver.until("Number(document.querySelector('[data-knob$=angle]').dataset.value) === 90")
    page.get_by_role("radio", name="Fast").click()
    rail = page.locator(".track .rail").bounding_box()
    page.mouse.click(rail["x"] + rail["width"] - 2, rail["y"] + 12)
    driver.until(f"{notice}.startsWith('Leaves the tissue')")
    driver.until(f"{TRACK}.hidden")
