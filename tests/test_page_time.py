"""Time on the page: breath that moves the target, a capsule that breaks, the force felt, and models without time."""

import pytest

from page_driver import DEPTH, LINK, MOVED, SIZES, Driver, serving

pytest_plugins = ["page_fixtures"]

FORCE = "Number(document.querySelector('#read-force').dataset.value)"
BREATH = "Number(document.querySelector('#read-excursion').dataset.value)"
NOTICE = "document.querySelector('.notice').textContent"
SAID = "document.querySelector('.unseen [role=status]').textContent"


@pytest.mark.slow
def test_breathing_moves_the_target_with_the_needle_out(drive):
    driver = drive("kidney")
    page = driver.page
    page.locator(".image-pane").focus()
    driver.until(f"{MOVED} === 0 && document.querySelector('canvas.picture').width > 512")  # as fine as it is shown
    rest = driver.drawn()[1]
    page.keyboard.press("t")
    driver.until(f"{MOVED} > 3 && {BREATH} > 4")
    assert driver.evaluate(DEPTH) == 0
    assert (driver.drawn()[1] != rest).mean() > 0.1
    assert page.locator("#tissue-button").inner_text().startswith("Tissue\nBreath")
    page.keyboard.press("h")
    driver.until("document.querySelector('#read-excursion').textContent.startsWith('Held')")
    page.keyboard.press("t")
    driver.until(f"{BREATH} === 0 && {MOVED} === 0")  # the breath that is drawn is drawn out
    driver.picture("breathing")


@pytest.mark.slow
def test_a_capsule_breaks_and_the_hand_feels_it(browser):
    """Notice and voice say so, the bar is the force, and the plot has both ways of it."""
    with serving("--scene", "kidney") as address:
        driver = Driver(browser, address, script=LINK).live()
        page = driver.page
        page.locator(".image-pane").focus()
        page.keyboard.press("m")
        driver.until("document.querySelector('#read-excursion').textContent === 'Remembers'")
        page.get_by_role("radio", name="Force").click()
        page.locator(".image-pane").focus()
        page.keyboard.down("ArrowDown")
        driver.until(f"{NOTICE}.startsWith('Punctured') && {NOTICE}.includes('skin at ')")
        tented = driver.evaluate(FORCE)
        driver.until(f"{NOTICE}.includes('renal capsule at ')")
        page.keyboard.up("ArrowDown")
        driver.until(f"{SAID}.startsWith('Punctured renal capsule at ')")
        driver.answered()
        assert tented > 0.3 and driver.evaluate(FORCE) > 0.3
        width = "parseFloat(document.querySelector('.force-bar .fill').style.width)"
        bar, felt = driver.evaluate(f"[{width}, {FORCE}]")  # at once: the force still falls
        assert bar == pytest.approx(10 * felt, abs=0.1)
        assert driver.evaluate("document.querySelectorAll('.plot .event').length") >= 2
        driver.picture("force")
        driver.hold("ArrowUp", f"{FORCE} < -0.3")  # friction now holds it back
        driver.until("[...document.querySelectorAll('.plot text')].some((e) => e.textContent.startsWith('\\u2212'))")
        driver.finish()


@pytest.mark.slow
def test_models_without_time_say_so_and_stay_comparable(drive):
    driver = drive("kidney")
    page = driver.page
    page.locator(".image-pane").focus()
    page.keyboard.press("t")
    driver.until(f"{BREATH} > 2")
    page.get_by_role("radio", name="Kelvinlet").click()
    driver.until(f"document.querySelector('#read-excursion').textContent === 'No time' && {MOVED} === 0")
    page.locator("#tissue-button").click()
    switch = page.get_by_role("menuitemcheckbox", name="Needle remembers")
    assert switch.get_attribute("aria-disabled") == "true"
    assert "Kelvinlet knows no time" in switch.inner_text()
    switch.click(force=True)  # dimmed, but it says why
    driver.until(f"{NOTICE}.includes('Kelvinlet knows no time')")
    page.keyboard.press("Escape")
    page.get_by_role("radio", name="Force").click()
    driver.until("document.querySelector('.plot .none')?.textContent === 'Kelvinlet knows no force'")
    driver.until("document.querySelector('.readout.force .note')?.textContent === 'not in this model'")
    page.get_by_role("radio", name="Elastic").click()
    driver.until(f"{BREATH} > 2")  # the switch was left on


@pytest.mark.slow
def test_the_menu_is_worked_by_keys_alone(drive):
    driver = drive("kidney", size=SIZES["compact"])
    page = driver.page
    page.locator("#tissue-button").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("End")
    page.keyboard.press("ArrowUp")  # the last one is the probe
    page.keyboard.press("Space")
    relax = page.get_by_role("menuitemcheckbox", name="Tissue relaxes")
    driver.until("document.querySelector('[data-switch=relax]').getAttribute('aria-checked') === 'true'")
    assert relax.evaluate("(e) => document.activeElement === e")
    assert page.get_by_role("menuitemcheckbox", name="Needle remembers").get_attribute("aria-checked") == "true"
    page.keyboard.press("Escape")
    assert page.locator("#tissue-menu").is_hidden()
    assert driver.evaluate("document.activeElement.id") == "tissue-button"
    page.locator(".image-pane").focus()
    page.keyboard.press("m")
    driver.until("!document.querySelector('#tissue-button').classList.contains('lit')")


def test_a_scene_that_does_not_breathe_says_so(drive):
    driver = drive("gel")
    driver.page.locator(".image-pane").focus()
    driver.page.keyboard.press("t")
    driver.until(f"{NOTICE}.includes('This scene does not breathe')")
    assert driver.evaluate(BREATH) == 0
