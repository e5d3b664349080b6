"""How the page looks: the layouts, and what people ask of their machine."""

import pytest

from page_driver import DEPTH, SIZES

pytest_plugins = ["page_fixtures"]

# Text may not run out of its box: DejaVu Sans, the widest font a machine may have, is all that CI has.
CLIPPED = """() => {
    const words = "button, h1, h2, .name, .label, .value, .note, dd, dt, th, td, input, .panel-head span, .meter";
    const clipped = (e) => e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1;
    return [...document.querySelectorAll(words)]
        .filter((e) => e.checkVisibility() && !e.closest(".unseen") && clipped(e))
        .map((e) => `${e.className || e.tagName} ${e.textContent || e.value} ${e.scrollWidth} > ${e.clientWidth}`);
}"""


LAYOUTS = [
    ("desktop", 68),
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


@pytest.mark.parametrize("size", [(720, 450), (512, 384)], ids=["of 1440 x 900", "of 1024 x 768"])
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
