"""The page when the link is lost, comes back, or is one of many."""

from page_driver import STATUS, Driver, frame_drawn, serving

pytest_plugins = ["page_fixtures"]


def test_a_lost_server_is_said_and_no_old_number_is_shown(browser):
    with serving("--scene", "gel") as address:
        driver = Driver(browser, address).live()
    driver.until(f"{STATUS} === 'lost'")
    panel = driver.page.get_by_role("alertdialog")
    driver.until("document.querySelector('.lost p').textContent.includes('s old')")
    assert "Trying again" in panel.inner_text()
    assert driver.page.locator("#read-depth").inner_text() == "–"
    assert driver.page.evaluate("document.activeElement.textContent") == "Connect now"
    driver.picture("state-lost")
    driver.context.close()
