"""Every action of the page by every hand: keys, mouse, touch, gamepad."""

import numpy as np
import pytest

from page_driver import DEPTH, LINK, SIZES, STATUS

pytest_plugins = ["page_fixtures"]


def test_a_tap_is_one_step_and_slow_is_a_fifth_of_it(drive):
    driver = drive()
    keys = driver.page.keyboard
    keys.press("ArrowDown")
    assert driver.knob("slide") == 0
    driver.until(f"{DEPTH} === 0.5")
    keys.down("Shift")
    keys.press("KeyD")
    keys.up("Shift")
    assert driver.knob("slide") == pytest.approx(0.1)
    keys.press("KeyW")
    keys.press("KeyE")
    keys.press("KeyX")
    assert (driver.knob("sweep"), driver.knob("rotate"), driver.knob("fan")) == (0.5, 1, 1)
    keys.press("KeyB")
    for axis in ("slide", "sweep", "rotate", "fan"):
        driver.until(knob(axis, "v === 0"))
    depth = driver.knob("depth")
    keys.press("BracketLeft")
    keys.press("Equal")
    assert (driver.knob("depth"), driver.knob("gain")) == (depth - 10, 2)
    keys.press("Control+KeyD")  # the browser's own
    assert driver.knob("slide") == 0


@pytest.mark.slow
def test_the_mouse_turns_the_wheel_drags_the_handle_and_types(drive):
    driver = drive()
    page = driver.page
    box = page.locator(".image-pane").bounding_box()
    page.mouse.move(box["x"] + 400, box["y"] + 400)
    page.mouse.wheel(0, 400)
    driver.until(f"{DEPTH} === 2")
    angle = driver.knob("angle")
    handle = page.locator(".handle .ring").bounding_box()
    x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    across = (np.cos(np.radians(angle - 90)), np.sin(np.radians(angle - 90)))
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 5):
        page.mouse.move(x + 4 * k * across[0], y + 4 * k * across[1])
    driver.until(knob("angle", f"Math.abs(v - {angle}) > 1"))
    page.mouse.up()
    field = page.locator("[data-knob$=sweep]:visible")
    field.fill("3.5")
    field.press("Enter")
    driver.until("document.querySelector('.out-of-plane .note').textContent === 'sweep towards you'")
    driver.until("Number(document.querySelector('#read-out-of-plane').dataset.value) > 3")
    page.get_by_role("button", name="Push").click()
    driver.until(f"{DEPTH} === 2.5")
    driver.until("document.activeElement.className.startsWith('image-pane')")  # keys act again


@pytest.mark.slow
def test_touch_lever_pad_and_inset(drive):
    driver = drive(size=SIZES["tablet"], touch=True)
    page = driver.page
    assert page.evaluate("document.body.dataset.layout") == "tablet"
    finger = page.context.new_cdp_session(page)

    def touch(kind, *points):
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in points]})

    def middle(selector):
        box = page.locator(selector).bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    x, y = middle(".lever .knob")
    touch("touchStart", (x, y))
    touch("touchMove", (x, y + 60))
    driver.until(f"{DEPTH} > 5")
    touch("touchEnd")
    driver.settled()
    depth = driver.value("depth")
    x, y = middle(".pad .knob")
    touch("touchStart", (x, y))
    touch("touchMove", (x + 30, y))
    driver.until("document.querySelector('.marks .handle').getAttribute('transform')")
    driver.next_step()
    touch("touchEnd")
    driver.settled()
    assert driver.value("depth") == depth, "letting go stops"
    page.locator(".swap").tap()
    driver.until("document.body.classList.contains('swapped')")
    page.get_by_role("button", name="Grid").tap()
    driver.until("document.querySelector('[data-action=grid]').getAttribute('aria-pressed') === 'true'")
    page.locator(".image-pane").tap()
    driver.until("!document.body.classList.contains('swapped')")
    page.get_by_role("button", name="Freeze").tap()
    driver.until(f"{STATUS} === 'frozen'")


@pytest.mark.slow
def test_a_gamepad_pushes_slides_and_freezes(drive):
    driver = drive()
    driver.evaluate("window.plugged = true")
    driver.evaluate("window.pad.buttons[7] = {pressed: true, value: 1}")
    driver.until(f"{DEPTH} > 3")
    driver.evaluate("window.plugged = false")  # pulled out: everything stops
    driver.settled()
    depth = driver.value("depth")
    driver.evaluate("window.pad.buttons[7] = {pressed: false, value: 0}; window.pad.axes[0] = 1; window.plugged = true")
    driver.until("Number(document.querySelector('[data-knob$=slide]').dataset.value) > 2")
    driver.evaluate("window.pad.axes[0] = 0.1")  # within the dead zone
    driver.settled()
    assert driver.value("depth") == depth
    driver.evaluate("window.pad.buttons[0] = {pressed: true, value: 1}")
    driver.until(f"{STATUS} === 'frozen'")


def knob(axis, test):
    """A question about the value of a stepper."""
    return f"((v) => {test})(Number(document.querySelector('[data-knob$={axis}]').dataset.value))"


def middle(driver, selector):
    box = driver.page.locator(selector).first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag(driver, start, by, steps=4):
    mouse = driver.page.mouse
    mouse.move(*start)
    mouse.down()
    for k in range(1, steps + 1):
        mouse.move(start[0] + by[0] * k / steps, start[1] + by[1] * k / steps)
    mouse.up()


def under_the_pointer(driver):
    """What the pointer would grip in the 3-D view: places by kind, top to bottom and left to right."""
    page = driver.page
    driver.until("document.querySelector('.view3d')")
    box = page.locator(".view3d").bounding_box()
    places = {}
    for y in np.arange(box["y"] + 40, box["y"] + 0.5 * box["height"], 5):
        for x in box["x"] + box["width"] * np.array([0.4, 0.5, 0.6]):
            page.mouse.move(x, y)
            cursor = page.evaluate("document.querySelector('.view3d').style.cursor")
            places.setdefault(cursor, []).append((x, y))
    return places


def recentre(driver):
    driver.settled()
    driver.page.get_by_role("button", name="Recentre").first.click()
    driver.until(f"{knob('sweep', 'v === 0')} && {knob('slide', 'v === 0')}")
    driver.settled()


@pytest.mark.slow
def test_dragging_the_probe_slides_and_sweeps_its_ring_rotates_and_beside_it_the_view_turns(drive):
    driver = drive()
    driver.until("document.querySelector('.view3d')")
    driver.view3d_at_rest()
    places = under_the_pointer(driver)
    body, ring = places["grab"], places["ew-resize"]
    drag(driver, body[len(body) // 2], (30, 0))
    driver.until(knob("slide", "v > 5"))
    recentre(driver)
    drag(driver, body[len(body) // 2], (0, -12))
    driver.until(knob("sweep", "v > 3"))  # up is away
    recentre(driver)
    assert driver.knob("rotate") == 0
    front = max(ring, key=lambda place: place[1])
    drag(driver, front, (16, 0))
    driver.until(knob("rotate", "v < -5"))  # the ring's front goes with the pointer: anticlockwise, seen from above
    driver.settled()
    turned = driver.knob("rotate")
    assert turned > -60
    assert driver.knob("slide") == 0
    driver.settled()
    view, (x, y) = driver.view3d(), middle(driver, ".view3d")
    drag(driver, (x - 150, y + 120), (60, 0))
    driver.view3d_at_rest(other_than=view)
    assert (driver.knob("slide"), driver.knob("rotate")) == (0, turned)


@pytest.mark.slow
def test_the_mouse_reaches_track_scale_caret_skin_and_buttons(drive):
    driver = drive(script=LINK)
    page = driver.page
    rail = page.locator(".track .rail").bounding_box()
    drag(driver, (rail["x"] + 2, rail["y"] + 12), (rail["width"] / 3, 0))
    driver.until(f"{DEPTH} > 25")
    page.locator(".track .skin").click()
    driver.until(f"{DEPTH} === 0")
    page.get_by_role("button", name="Push", exact=True).click()
    driver.until(f"{DEPTH} === 0.5")
    page.mouse.dblclick(*middle(driver, ".handle .ring"))
    driver.until(f"{DEPTH} === 0")
    assert "placing" not in page.locator(".image-pane").get_attribute("class")

    depth = driver.knob("depth")
    scale = page.locator(".ruler .scale").bounding_box()
    drag(driver, (scale["x"] + 10, scale["y"] + 60), (0, -40))
    assert driver.knob("depth") == depth + 10
    driver.settled()
    focus = driver.knob("focus")
    drag(driver, middle(driver, ".ruler .caret .grab"), (0, 60))
    assert driver.knob("focus") > focus
    ups = {"gain": "More gain", "frequency": "Higher frequency", "fan": "Fan away", "swing": "Swing away"}
    for axis, name in ups.items():
        before = driver.knob(axis)
        page.get_by_role("button", name=name, exact=True).first.click()
        assert driver.knob(axis) > before
    for name in ("Grid", "Displacement", "Probe view", "Guides"):
        button = page.get_by_role("button", name=name, exact=True)
        before = button.get_attribute("aria-pressed")
        button.click()
        assert button.get_attribute("aria-pressed") != before
    page.get_by_role("radio", name="Fast").click()
    slide = driver.knob("slide")
    page.get_by_role("button", name="Slide right", exact=True).first.click()
    assert driver.knob("slide") == slide + 2, "four steps of half a millimetre"
    driver.answered()

    x, y = middle(driver, ".handle .ring")
    page.mouse.dblclick(x + 40, y)
    driver.until("document.querySelector('.image-pane').classList.contains('placing')")
    driver.until(f"Math.abs(document.querySelector('.handle .ring').getBoundingClientRect().x - {x + 40 - 13}) < 3")
    page.get_by_role("button", name="New entry").click()
    driver.until("!document.querySelector('.image-pane').classList.contains('placing')")


@pytest.mark.slow
def test_a_finger_taps_twice_to_pull_out_and_to_choose_an_entry(drive):
    driver = drive(size=SIZES["tablet"], touch=True)
    page = driver.page
    page.get_by_role("button", name="Push", exact=True).tap()
    driver.until(f"{DEPTH} === 0.5")
    pull = page.get_by_role("button", name="Pull", exact=True)
    page.get_by_role("button", name="Push", exact=True).tap()
    driver.until(f"{DEPTH} === 1")
    pull.tap()
    pull.tap()
    driver.until(f"{DEPTH} === 0")
    x, y = middle(driver, ".handle .ring")
    page.touchscreen.tap(x + 45, y)
    page.touchscreen.tap(x + 45, y)
    driver.until("document.querySelector('.image-pane').classList.contains('placing')")
    page.locator(".pace:visible").tap()
    assert page.locator(".pace:visible .value").inner_text() == "Fast"


@pytest.mark.slow
def test_every_button_of_a_gamepad(drive):
    driver = drive()
    driver.evaluate("window.plugged = true")

    def press(button, until):
        driver.evaluate(f"window.pad.buttons[{button}] = {{pressed: true, value: 1}}")
        driver.until(until)
        driver.evaluate(f"window.pad.buttons[{button}] = {{pressed: false, value: 0}}")
        driver.next_step()

    depth, angle = driver.knob("depth"), driver.knob("angle")
    press(5, knob("rotate", "v >= 1"))
    press(4, knob("rotate", "v < 1"))
    press(15, knob("fan", "v >= 1"))
    press(14, knob("fan", "v < 1"))
    press(13, knob("depth", f"v === {depth + 10}"))
    press(12, knob("depth", f"v === {depth}"))
    driver.evaluate("window.pad.axes[2] = 0.9")
    driver.until(knob("angle", f"v > {angle + 0.5}"))
    driver.evaluate("window.pad.axes[2] = 0; window.pad.axes[3] = -0.9")
    driver.until(knob("swing", "v > 0.5"))
    driver.evaluate("window.pad.axes[3] = 0")
    press(7, f"{DEPTH} > 1")
    press(3, f"{DEPTH} === 0")
    press(7, f"{DEPTH} > 1")
    press(1, f"{DEPTH} === 0")
    press(2, "document.querySelector('.image-pane').classList.contains('placing')")
    press(2, "!document.querySelector('.image-pane').classList.contains('placing')")
    press(8, "document.querySelector('[data-model=elastic]').getAttribute('aria-checked') === 'false'")
    press(10, "document.querySelector('[data-pace=slow]').classList.contains('lit')")
    press(11, "document.querySelector('[data-pace=fast]').classList.contains('lit')")
    driver.until("document.querySelector('[data-pace=normal]').classList.contains('lit')")
    driver.evaluate("window.pad.buttons[9] = {pressed: true, value: 1}")
    driver.next_step()
    driver.evaluate("window.pad.buttons[9] = {pressed: false, value: 0}")
    driver.until("document.querySelector('dialog').open")
    press(1, "!document.querySelector('dialog').open")
    press(9, knob("swing", "v === 0"))  # held: reset
