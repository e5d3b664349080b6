"""The keys act again after a pointer chose anything; who came with the keyboard stays where he is."""

import pytest

from page_driver import DEPTH, FOCUSED, LINK, STATUS

pytest_plugins = ["page_fixtures"]


def choose_a_scene(page):
    page.locator("#scene-button").click()
    page.get_by_role("menuitemradio", name="Gel block with a vessel").click()


def leave_the_menu(page):
    page.locator("#scene-button").click()
    page.keyboard.press("Escape")


def type_an_angle(page):
    page.locator("[data-knob$=angle]:visible").click()
    page.keyboard.type("40")
    page.keyboard.press("Enter")


def leave_a_number(page):
    page.locator(".stepper.gain .name:visible").click()
    page.keyboard.press("Escape")


def read_the_help(page):
    page.get_by_role("button", name="Help").click()
    page.get_by_role("dialog").get_by_role("button", name="Close").click()


def leave_the_help(page):
    page.get_by_role("button", name="Help").click()
    page.get_by_role("dialog").wait_for()
    page.keyboard.press("Escape")


WIDGETS = [
    choose_a_scene,
    leave_the_menu,
    type_an_angle,
    leave_a_number,
    read_the_help,
    leave_the_help,
    lambda page: page.get_by_role("radio", name="Kelvinlet").click(),
    lambda page: page.get_by_role("radio", name="Slow").click(),
    lambda page: page.get_by_role("button", name="More gain").click(),
    lambda page: page.get_by_role("button", name="Grid", exact=True).click(),
    lambda page: page.get_by_role("button", name="Undo pass").click(),
    lambda page: page.locator(".track .skin").click(),
    lambda page: page.locator(".track .rail").click(position={"x": 20, "y": 12}),
    lambda page: page.locator(".plot").click(),
    lambda page: page.locator(".view3d").click(position={"x": 20, "y": 200}),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    "widgets", [WIDGETS[:1], pytest.param(WIDGETS[1:], marks=pytest.mark.slow)], ids=["scene", "all"]
)
def test_after_any_widget_was_used_with_the_mouse_down_pushes(drive, widgets):
    driver = drive(script=LINK)
    driver.until("document.querySelector('canvas.view3d') !== null")
    for use in widgets:
        scenes = driver.evaluate("link.scenes") + (use is choose_a_scene)
        use(driver.page)
        driver.until(FOCUSED)
        driver.until(f"link.scenes >= {scenes}")
        driver.until(f"{STATUS} === 'live'")
        driver.answered()
        before = driver.evaluate("link.shown")
        driver.page.keyboard.press("ArrowDown")
        driver.until(f"link.shown > {before}")
        driver.page.keyboard.press("Escape")
    assert driver.page.locator("#scene-menu").is_hidden()


# A page so busy that keys come before its timers.
LATE_TIMERS = """
const timer = window.setTimeout;
window.setTimeout = (run, ms = 0, ...rest) => timer(run, ms + 1000, ...rest);
"""


@pytest.mark.slow
def test_a_key_pressed_right_after_a_click_acts(drive):
    driver = drive("cube", script=LATE_TIMERS)
    driver.page.get_by_role("radio", name="Fast").click()
    assert driver.evaluate(FOCUSED)
    driver.hold("ArrowDown", f"{DEPTH} > 10")


@pytest.mark.slow
def test_the_other_hands_keys_act_while_a_button_is_held(drive):
    driver = drive(script=LINK)
    box = driver.page.locator(".dock .push").bounding_box()
    driver.page.mouse.move(box["x"] + 20, box["y"] + 10)
    driver.page.mouse.down()
    driver.page.keyboard.press("KeyD")
    driver.until(f"{DEPTH} > 1")
    driver.page.mouse.up()
    assert driver.knob("slide") == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Help", "scene"])
def test_who_opens_with_the_keyboard_comes_back_to_the_same_place(drive, name):
    driver = drive()
    page = driver.page
    button = page.locator("#scene-button") if name == "scene" else page.get_by_role("button", name="Help")
    button.focus()
    page.keyboard.press("Enter")
    opened = {
        "scene": "!document.querySelector('#scene-menu').hidden", "Help": "document.querySelector('dialog').open",
    }[name]  # fmt: skip
    driver.until(opened)
    page.keyboard.press("Escape")
    driver.until(f"!({opened})")
    assert button.evaluate("(e) => e === document.activeElement")
