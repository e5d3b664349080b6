"""The probe pressed on the page, and a needle that tissue holds: words, numbers, and a hand that does not wind up."""

import pytest

from page_driver import LINK, MOVED, Driver, serving

pytest_plugins = ["page_fixtures"]

PROBE = "Number(document.querySelector('#read-excursion').dataset.probe)"
SHORT = "document.querySelector('#read-excursion').textContent"
NOTICE = "document.querySelector('.notice').textContent"


@pytest.mark.slow
def test_a_key_presses_the_probe_and_its_force_is_read(drive):
    driver = drive("gel")
    page = driver.page
    page.locator(".image-pane").focus()
    driver.until(f"{MOVED} === 0")
    driver.hold("KeyV", f"{PROBE} > 2 && {MOVED} > 1")  # the first press turns it on
    assert driver.evaluate(SHORT).startswith("Probe ") and driver.evaluate(SHORT).endswith(" N")
    page.locator("#tissue-button").click()
    assert page.locator("[data-switch=press]").get_attribute("aria-checked") == "true"
    driver.until("document.querySelector('[data-switch=press]').textContent.endsWith('N on the skin')")
    deep = "Number(document.querySelector('[data-knob=\"probe.press\"]').dataset.value)"
    before = driver.evaluate(deep)
    page.get_by_role("button", name="Press more").click()
    driver.until(f"{deep} > {before}")
    driver.picture("pressed")
    page.locator("#tissue-button").click()
    page.locator(".image-pane").focus()
    page.keyboard.press("i")
    driver.until(f"{MOVED} === 0 && {SHORT} === 'Still'")


@pytest.mark.slow
def test_tissue_holds_a_needle_that_is_turned_and_says_so(browser):
    with serving("--scene", "gel") as address:
        driver = Driver(browser, address, script=LINK).live()
        page = driver.page
        page.locator(".image-pane").focus()
        page.keyboard.press("m")
        driver.until(f"{SHORT} === 'Remembers'")
        driver.hold("ArrowDown", "link.shown > 28")
        driver.hold("ArrowRight", f"{NOTICE}.startsWith('Turns no further')")
        assert "Phantom gel would tear" in driver.evaluate(NOTICE)
        driver.picture("held")
        driver.finish()
