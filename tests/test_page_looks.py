"""How the page looks: the layouts, and what people ask of their machine."""

import pytest

from page_driver import DEPTH, SIZES

pytest_plugins = ["page_fixtures"]

# Text may not run out of its box: DejaVu Sans, the widest font a machine may have, is all that CI has.
CLIPPED = """() => {
    const words = "button, b, h1, h2, .name, .label, .value, .note, dd, dt, th, td, input, .panel-head span, .meter";
    const said = (e) => getComputedStyle(e).textOverflow === "ellipsis" && e.title === e.textContent;
    const clipped = (e) => e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1 && !said(e);
    return [...document.querySelectorAll(words)]
        .filter((e) => e.checkVisibility() && !e.closest(".unseen") && clipped(e))
        .map((e) => `${e.className || e.tagName} ${e.textContent || e.value} ${e.scrollWidth} > ${e.clientWidth}`);
}"""


LAYOUTS = [
    pytest.param("desktop", 68, marks=pytest.mark.slow),
    pytest.param("compact", 76, marks=pytest.mark.slow),
    pytest.param("tablet", 88, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("layout", "deep"), LAYOUTS)
def test_pictures_of_all_layouts_show_every_word(drive, layout, deep):
    driver = drive("kidney", size=SIZES[layout], touch=layout == "tablet")
    page = driver.page
    page.locator(".image-pane").focus()
    page.keyboard.down("KeyF")
    driver.hold("ArrowDown", f"{DEPTH} > {deep - 12}")
    page.keyboard.up("KeyF")
    driver.hold("ArrowDown", f"{DEPTH} > {deep}")
    driver.settled()
    assert page.evaluate("document.body.dataset.layout") == layout
    assert page.evaluate("document.documentElement.scrollHeight <= innerHeight"), "the page scrolls"
    assert driver.evaluate(CLIPPED) == []
    if layout == "compact":
        page.keyboard.press("g")
        page.keyboard.press("k")
    driver.view3d_at_rest()
    driver.picture(layout)
    if layout == "desktop":
        page.keyboard.press("?")
        page.get_by_role("dialog").wait_for()
        assert driver.evaluate(CLIPPED) == []
        driver.picture("help")
        page.keyboard.press("Escape")


def inside_the_window(driver, selector):
    """Whether all of an element can be seen without scrolling."""
    return driver.evaluate(
        f"""(() => {{
            const box = document.querySelector("{selector}").getBoundingClientRect();
            const within = box.right <= innerWidth && box.bottom <= innerHeight;
            return box.width > 0 && box.left >= 0 && box.top >= 0 && within;
        }})()"""
    )


# How bright the image is under the notice.
UNDER = """() => {
    const canvas = document.querySelector("canvas.picture");
    const [notice, image] = [document.querySelector(".notice"), canvas].map((e) => e.getBoundingClientRect());
    const scale = canvas.width / image.width;
    const within = (at, most) => Math.min(most, Math.max(0, at)) * scale;
    const [left, right] = [notice.left, notice.right].map((x) => within(x - image.left, image.width));
    const [top, bottom] = [notice.top, notice.bottom].map((y) => within(y - image.top, image.height));
    if (right - left < 1 || bottom - top < 1) return 0;
    const {data} = canvas.getContext("2d").getImageData(left, top, right - left, bottom - top);
    return Math.max(...data.filter((_, k) => k % 4 === 0));
}"""
CORNERS = [
    pytest.param(scene, layout, marks=() if (scene, layout) == ("kidney", "compact") else pytest.mark.slow)
    for scene in ("kidney", "gel", "cube")
    for layout in SIZES
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "layout"), CORNERS)
def test_a_notice_stands_in_the_black_and_names_and_needle_are_whole(drive, scene, layout):
    driver = drive(scene, size=SIZES[layout], touch=layout not in ("desktop", "compact"))
    driver.page.locator(".image-pane").focus()
    driver.page.keyboard.press("Space")
    driver.until("!document.querySelector('.notice').hidden")
    driver.page.locator(".notice").get_by_text("Space or Freeze to go on").wait_for()
    assert driver.evaluate(UNDER) == 0
    assert inside_the_window(driver, ".notice")
    assert driver.evaluate(CLIPPED) == []
    assert driver.evaluate("document.documentElement.scrollHeight <= innerHeight"), "the page scrolls"


# Buttons that are cut off, too small for a finger, or under something else.
OUT_OF_REACH = """() => [...document.querySelectorAll("button, .lever .knob, .pad .knob")]
    .filter((e) => e.checkVisibility() && !e.closest("dialog"))
    .filter((e) => {
        const {left, right, top, bottom, width, height} = e.getBoundingClientRect();
        const inside = left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
        const there = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
        return !inside || Math.min(width, height) < 43.5 || !(e.contains(there) || there?.contains(e));
    }).map((e) => `${e.className} ${e.textContent}`)"""


@pytest.mark.parametrize("size", [(820, 1180), pytest.param((768, 1024), marks=pytest.mark.slow)])
def test_a_tablet_held_upright_has_a_wide_image_and_every_control_within_reach(drive, size):
    driver = drive("kidney", size=size, touch=True)
    assert driver.evaluate("document.body.dataset.layout") == "tablet"
    assert driver.evaluate(OUT_OF_REACH) == []
    assert driver.evaluate(CLIPPED) == []
    assert driver.page.locator("canvas.picture").bounding_box()["width"] > 0.6 * size[0]
    driver.until("document.querySelector('canvas.view3d') !== null")
    driver.page.locator(".swap").tap()
    driver.until("document.body.classList.contains('swapped')")
    assert driver.page.locator("canvas.view3d").bounding_box()["width"] == pytest.approx(size[0], abs=1)
    driver.page.locator(".image-pane").tap()
    driver.until("!document.body.classList.contains('swapped')")
    if size == SIZES["portrait"]:
        driver.settled()
        driver.picture("portrait")


@pytest.mark.slow
@pytest.mark.parametrize("size", [(720, 450), (512, 384), (360, 740)])
def test_the_help_shows_every_key_at_any_zoom(drive, size):
    driver = drive(size=size)
    driver.page.get_by_role("button", name="Help").click()
    driver.page.get_by_role("dialog").wait_for()
    out = """() => {
        const panel = document.querySelector("dialog").getBoundingClientRect();
        return [...document.querySelectorAll("dialog .keyboard .key")].filter((key) => {
            const {left, right} = key.getBoundingClientRect();
            const {scrollWidth, clientWidth} = key.offsetParent;
            return left < panel.left || right > panel.right || scrollWidth > clientWidth;
        }).map((key) => key.textContent);
    }"""
    assert driver.evaluate(out) == []
    assert driver.evaluate("document.querySelectorAll('dialog .arrows .key').length") == 4
    assert (
        driver.evaluate("getComputedStyle(document.querySelector('dialog .arrows').parentElement).overflow")
        == "visible"
    )


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["desktop", "compact"])
def test_the_names_in_the_plot_stand_apart_and_within_it(drive, layout):
    driver = drive("cube", size=SIZES[layout])
    keys = driver.page.keyboard
    driver.page.get_by_role("radio", name="Fast").click()
    for model in ("1", "2", "3"):
        keys.press(model)
        driver.hold("ArrowDown", f"{DEPTH} > 40")
        driver.hold("ArrowUp", f"{DEPTH} < 20")
    driver.until("document.querySelectorAll('.plot text.live, .plot text.other').length === 3")
    boxes = driver.evaluate(
        """[...document.querySelectorAll(".plot text")].map((e) => e.getBoundingClientRect().toJSON())"""
    )
    panel = driver.evaluate("document.querySelector('.panel.motion').getBoundingClientRect().toJSON()")
    for k, a in enumerate(boxes):
        assert panel["left"] <= a["left"] <= a["right"] <= panel["right"]
        assert panel["top"] <= a["top"] <= a["bottom"] <= panel["bottom"]
        for b in boxes[:k]:
            apart = (
                a["right"] <= b["left"]
                or b["right"] <= a["left"]
                or a["bottom"] <= b["top"] + 3
                or b["bottom"] <= a["top"] + 3
            )
            assert apart, (a, b)


@pytest.mark.slow
@pytest.mark.parametrize(
    "size", [(720, 450), pytest.param((512, 384), marks=pytest.mark.slow)], ids=["of 1440 x 900", "of 1024 x 768"]
)
def test_at_200_percent_the_right_column_scrolls_and_the_image_does_not(drive, size):
    driver = drive(size=size)
    page = driver.page
    assert driver.evaluate("document.body.dataset.layout") == "compact"
    whole = driver.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert whole == list(size), "the page scrolls"
    for part in ("canvas.picture", ".readouts", ".handle .ring", ".header .help", "#scene-button"):
        assert inside_the_window(driver, part), part
    for button in ("Push", "Fan away", "Recentre", "Probe view", "Freeze"):
        image = page.locator("canvas.picture").bounding_box()
        page.get_by_role("button", name=button, exact=True).scroll_into_view_if_needed()
        page.get_by_role("button", name=button, exact=True).click()
        assert page.locator("canvas.picture").bounding_box() == image
    assert driver.evaluate(CLIPPED) == []


# The colours an element is drawn with, as numbers.
COLOUR = """([selector, property]) =>
    getComputedStyle(document.querySelector(selector))[property].match(/[\\d.]+/g).map(Number)"""


@pytest.mark.slow
def test_with_forced_colours_the_marks_are_the_systems_and_the_image_stays_black(drive):
    driver = drive(size=SIZES["compact"], forced_colors="active")
    page = driver.page

    def colour(selector, name):
        return page.evaluate(COLOUR, [selector, name])[:3]

    def system(name):
        page.evaluate(f"document.querySelector('.unseen').style.color = '{name}'")
        return colour(".unseen", "color")

    assert colour(".image-pane", "backgroundColor") == [0, 0, 0]
    assert colour(".handle .ring", "stroke") == colour(".marks .tip .line", "stroke") == system("Highlight")
    assert colour(".marks .target .line", "stroke") == colour(".marks .label", "fill") == system("LinkText")
    assert colour(".marks .target .halo", "stroke") == system("Canvas")
    assert (
        colour(".segments .lit", "backgroundColor") == colour(".dock .push", "backgroundColor") == system("Highlight")
    )


@pytest.mark.slow
def test_more_contrast_and_less_motion_are_heard(drive):
    driver = drive(contrast="more")
    assert driver.page.evaluate(COLOUR, [".stepper", "borderTopColor"]) == [0x66, 0x71, 0x7D]
    assert driver.page.evaluate("getComputedStyle(document.querySelector('.button')).transitionDuration") in (
        "0s",
        "0s, 0s",
    )
    moving = drive(reduced_motion="no-preference")
    assert "0.08s" in moving.page.evaluate("getComputedStyle(document.querySelector('.button')).transitionDuration")


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["desktop", "tablet"])
def test_a_left_hand_has_the_needle_on_its_side(drive, layout):
    driver = drive(size=SIZES[layout], touch=layout == "tablet")
    page = driver.page
    place = ".rail-column" if layout == "tablet" else ".dock .group"
    needle, probe = f"{place}.needle", f"{place}.probe"

    def left_to_right():
        return page.locator(needle).bounding_box()["x"] - page.locator(probe).bounding_box()["x"]

    assert left_to_right() > 0
    page.get_by_role("button", name="Help").click()
    page.get_by_role("switch", name="Left-handed").click()
    page.get_by_role("button", name="Close").click()
    assert left_to_right() < 0
    assert driver.evaluate(CLIPPED) == []
    page.reload()
    driver.live()
    assert left_to_right() < 0, "the page remembers"


@pytest.mark.slow
@pytest.mark.parametrize("size", [SIZES["tablet"], SIZES["portrait"], (768, 1024), (900, 600), (720, 450)])
def test_time_gain_compensation_is_at_hand_in_every_layout(drive, size):
    """All sliders and grey maps can be brought into the window, and a slider moves the picture's gain."""
    driver = drive(size=size, touch=size[1] > 700)
    page = driver.page
    page.locator(".scanner > .button:visible").click()
    sliders = page.locator(".scanner .menu:visible [data-slider]")
    assert sliders.count() == 8
    for entry in (sliders.nth(0), sliders.nth(7), page.locator(".scanner .menu:visible .maps button").last):
        entry.scroll_into_view_if_needed()
        box = entry.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
        assert 0 <= box["y"] < box["y"] + box["height"] <= size[1]
    driver.picture(f"tgc-{size[0]}")
    sliders.nth(7).fill("6")
    page.get_by_role("menuitem", name="Level").locator("visible=true").click()
    assert sliders.nth(7).input_value() == "0"
    page.keyboard.press("Escape")
    page.locator(".scanner .menu:visible").wait_for(state="detached")
    assert driver.evaluate(CLIPPED) == []
