"""The page when the link is lost, comes back, or is one of many."""

import pytest

from page_driver import DEPTH, LINK, STATUS, Driver, frame_drawn, serving

pytest_plugins = ["page_fixtures"]


@pytest.mark.slow
def test_a_lost_server_is_said_and_no_old_number_is_shown(browser):
    with serving("--scene", "gel") as address:
        driver = Driver(browser, address).live()
    driver.until(f"{STATUS} === 'lost'")
    panel = driver.page.get_by_role("alertdialog")
    driver.until("document.querySelector('.lost p').textContent.includes('s old')")
    assert "Trying again" in panel.inner_text()
    assert driver.page.locator("#read-depth").inner_text() == "–"
    assert driver.page.evaluate("document.activeElement.textContent") == "Connect now"
    driver.context.close()


# Every text that the insertion depth shows from now on.
SEEN = """() => {
    window.seen = [];
    const depth = document.querySelector("#read-depth");
    const watch = new MutationObserver(() => seen.push(depth.textContent));
    watch.observe(depth, {childList: true, characterData: true, subtree: true});
}"""


@pytest.mark.slow
def test_a_server_that_comes_back_is_found_and_goes_on_where_the_hand_was(browser):
    with serving("--scene", "gel") as address:
        driver = Driver(browser, address, listen=True).live()
        driver.page.keyboard.press("KeyD")
        driver.hold("ArrowDown", f"{DEPTH} > 4")
        driver.settled()
        depth, slide = driver.value("depth"), driver.knob("slide")
    driver.until(f"{STATUS} === 'lost'")
    age = "Number(/is (\\d+) s old/.exec(document.querySelector('.lost p').innerText)?.[1])"
    driver.until(f"{age} >= 0")
    driver.until(f"{age} >= {driver.evaluate(age) + 2}")  # the image grows older
    driver.frames.clear()
    driver.evaluate(SEEN)
    with serving("--scene", "gel", "--port", address.rstrip("/").rsplit(":", 1)[1]):
        driver.until(f"{STATUS} === 'live'")  # by itself
        driver.until(f"{DEPTH} === {depth}")
        assert set(driver.evaluate("seen")) <= {"–", f"{depth:.1f}"}, "no number of another pose"
        assert driver.knob("slide") == slide
        assert driver.page.get_by_role("alertdialog").is_hidden()
        driver.page.keyboard.press("ArrowDown")
        driver.until(f"{DEPTH} === {depth + 0.5}")
        assert driver.frames[0][0]["frame"] < driver.frames[-1][0]["frame"]
    assert all("ERR_CONNECTION_REFUSED" in said for said in driver.complaints), driver.complaints
    driver.context.close()


def reload(driver):
    driver.page.reload()
    driver.live()


def cut(driver):
    driver.evaluate("link.socket.close(4000)")
    driver.until(f"{STATUS} === 'lost'")
    driver.until(f"{STATUS} === 'live'")


# What a person has set and done, but for the clock of the pass.
AIMED_AT = "document.querySelector('.target-ring[hidden]').ariaLabel"
ALL = """() => [
    ...[...document.querySelectorAll("[data-knob]")].filter((e) => e.checkVisibility()).map((e) => e.dataset.value),
    ...[...document.querySelectorAll("output.number")].map((e) => e.dataset.value),
    ...[...document.querySelectorAll(".pass dd")].slice(1).map((e) => e.textContent),
    document.querySelector("[data-model][aria-checked=true]").dataset.model,
    document.querySelector("#scene-button b").textContent,
    document.querySelector(".target-ring[hidden]").ariaLabel,
]"""


@pytest.mark.slow
@pytest.mark.parametrize("leave", [reload, cut])
def test_a_pass_survives(drive, leave):
    """Pose, probe, image, target, model and the metrics of the pass."""
    driver = drive("kidney", script=LINK)
    page = driver.page
    page.keyboard.press("Digit1")
    page.keyboard.press("KeyD")
    page.keyboard.press("Equal")
    page.keyboard.press("KeyX")
    ring = page.get_by_role("button", name="Aim at ").last
    name = ring.get_attribute("aria-label")
    ring.click()
    driver.until(f"{AIMED_AT} === '{name}'")
    driver.hold("ArrowDown", f"{DEPTH} > 3")
    driver.answered()
    driver.settled()
    before = driver.evaluate(ALL)
    leave(driver)
    driver.until(f"{DEPTH} > 3")
    driver.settled()
    assert driver.evaluate(ALL) == before


@pytest.mark.slow
def test_a_key_held_over_a_reload_pushes_no_further(drive):
    driver = drive(script=LINK)
    driver.page.keyboard.down("ArrowDown")
    driver.until(f"{DEPTH} > 3")
    reload(driver)
    driver.passed(30)
    assert driver.evaluate("link.asked") == []
    driver.page.keyboard.up("ArrowDown")


@pytest.mark.slow
def test_a_frozen_session_is_frozen_after_a_reload(drive):
    driver = drive(script=LINK)
    driver.hold("ArrowDown", f"{DEPTH} > 2")
    driver.answered()
    driver.page.keyboard.press("Space")
    driver.until("link.frozen")  # the page says so at once, the session once it has heard of it
    driver.page.reload()
    driver.until(f"{STATUS} === 'frozen' && {DEPTH} > 2")
    driver.page.keyboard.press("Space")
    driver.live()


@pytest.mark.slow
def test_a_session_that_goes_on_in_another_page_is_not_taken_back(drive):
    driver = drive(script=LINK)
    driver.evaluate("() => { window.other = new link.Native(link.socket.url.split('?')[0] + '?session=' + link.key); }")
    driver.until(f"{STATUS} === 'lost'")
    button = driver.page.get_by_role("button", name="Start a new session")
    button.wait_for()
    assert "goes on in another page" in driver.page.locator(".lost p").inner_text()
    button.click()
    driver.live()


@pytest.mark.slow
def test_a_server_at_work_is_busy_and_a_mute_one_is_lost(drive):
    """Frames that do not come are no lost connection: the server still gives signs of life."""
    driver = drive(script=LINK)
    driver.answered()
    driver.evaluate("link.hold()")
    notice = "document.querySelector('.notice').innerText"
    driver.until(f"{notice}.includes('Busy') && {notice}.includes('4 s old')")
    assert driver.evaluate(STATUS) == "live"
    driver.evaluate("link.go()")
    driver.until("document.querySelector('.notice').hidden")
    driver.evaluate("link.hold(true)")
    driver.until(f"{STATUS} === 'lost'")
    assert "no answer" in driver.page.locator(".lost p").inner_text()
    driver.evaluate("link.go()")
    driver.until(f"{STATUS} === 'live'")


TABS = 8
# How many sessions a server still has room for: sockets that are greeted rather than turned away.
GREETED = """() => Promise.all(Array.from({length: COUNT}, () => new Promise((done) => {
    const socket = new WebSocket(new URL("live", location.href.replace("http", "ws")));
    socket.onmessage = () => done(socket);
    socket.onclose = () => done(null);
}))).then((all) => {
    for (const socket of all) socket?.close();
    return all.filter((socket) => socket !== null).length;
})"""


@pytest.mark.slow
def test_eight_tabs_work_a_ninth_is_turned_away_and_closing_them_makes_room(browser):
    """Frozen tabs ask nothing of the machine, and none draws in 3-D: eight at once are heavy for two cores."""

    def open_tab():
        tab = Driver(browser, address, size=(400, 300), without="**/view-*.js")
        tab.page.locator(".image-pane").focus()
        return tab

    with serving("--scene", "cube", "--sessions", str(TABS)) as address:
        tabs = []
        for _ in range(TABS):
            tabs.append(open_tab().live())
            assert tabs[-1].drawn()[1].std() > 5
            tabs[-1].page.keyboard.press("Space")
            tabs[-1].until(f"{STATUS} === 'frozen'")
        ninth = open_tab()
        ninth.until(f"document.querySelector('.lost p').textContent.includes('{TABS} sessions are open')")
        tabs[0].page.keyboard.press("Space")
        tabs[0].until(frame_drawn(tabs[0].drawn()[0] + 2))
        tabs[0].context.close()
        ninth.live()  # by itself, now that there is room
        for tab in [ninth, *tabs[1:]]:
            tab.context.close()
        last = Driver(browser, address, query="healthz")
        assert last.evaluate(GREETED.replace("COUNT", str(TABS))) == TABS
        last.context.close()
