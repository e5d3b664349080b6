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


@pytest.mark.parametrize(("layout", "deep"), [("desktop", 68), ("compact", 76), ("tablet", 88)])
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
    page.wait_for_timeout(1500)  # the view at rest
    driver.picture(layout)
    if layout == "desktop":
        page.keyboard.press("?")
        page.get_by_role("dialog").wait_for()
        assert driver.evaluate(CLIPPED) == []
        driver.picture("help")
        page.keyboard.press("Escape")
