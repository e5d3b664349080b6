"""A lab on the page: sitting down, the trainer's page at every size, comments in the debrief, tools on the image."""

import pytest

from page_driver import LINK, SIZES, Driver, started
from test_page_looks import CLIPPED, COLOUR

pytest.importorskip("sqlalchemy")
from sonospline.lab import ResultStore

pytest_plugins = ["page_fixtures"]

ENDS = ("above", "below")
PHASE = "document.body.dataset.phase"
NAMELESS = """() => [...document.querySelectorAll("button, input, select, a, output, canvas, [role=img]")]
    .filter((e) => e.checkVisibility() && !e.closest("[aria-hidden=true]"))
    .filter((e) => !(e.getAttribute("aria-label") || e.labels?.length || e.textContent.trim()
        || e.getAttribute("aria-labelledby")))
    .map((e) => e.outerHTML.slice(0, 90))"""
SMALL = """() => [...document.querySelectorAll(".header .button, select, .sets .button, .say .button, .who, .card")]
    .filter((e) => e.checkVisibility()).map((e) => [e.textContent.slice(0, 20), e.getBoundingClientRect().height])
    .filter(([, height]) => height < 43.5)"""


@pytest.fixture(scope="module")
def lab(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with ResultStore(folder / "course.db") as store:
        store.add_participant("K-17", group="Tuesday")
    with started("--scene", "gel", "--lab", "3", "--results", str(folder / "course.db"), "--course", "Tuesday") as said:
        yield said


@pytest.fixture
def visit(browser, lab):
    """Open a page of the lab: the trainer's, or one at a station."""
    opened = []

    def open_page(station=None, **options):
        query = f"?station={station}" if station else lab["trainer"].split("/", 3)[3]
        opened.append(Driver(browser, lab["address"], query=query, script=LINK, **options))
        return opened[-1]

    yield open_page
    for driver in opened:
        driver.finish()


def seated(visit, station=1):
    """A trainee at a station."""
    trainee = visit(station)
    trainee.until("!document.querySelector('.sit-down').hidden")
    trainee.page.locator("#code").fill("K-99")
    trainee.page.get_by_role("button", name="Sit down").click()
    trainee.until("document.querySelector('#code-problem').textContent.includes('has no place here')")
    trainee.page.locator("#code").fill("K-17")
    trainee.page.get_by_role("button", name="Sit down").click()
    trainee.until("document.querySelector('.sit-down').hidden")
    return trainee.live()


@pytest.mark.slow
def test_a_trainer_sets_watches_comments_and_sees_the_result(visit):
    trainee, trainer = seated(visit), visit()
    trainer.until("document.querySelectorAll('.card').length === 3")
    trainer.page.get_by_label("All stations").select_option("vessel-in-plane")
    trainee.until("!document.querySelector('.briefing:not(.sit-down)').hidden")
    trainee.page.get_by_role("button", name="Start").click()
    trainee.until(f"{PHASE} === 'attempt' && document.body.dataset.status === 'live'")
    trainee.page.locator(".image-pane").focus()
    trainee.hold("ArrowDown", "link.shown > 5")
    trainer.until("document.querySelector('.card .word').textContent !== 'practice'")
    trainer.until("document.querySelector('.watched canvas.picture').width > 100")
    trainer.page.get_by_label("A line for the trainee").fill("Sweep first")
    trainer.page.get_by_role("button", name="Say now").click()
    trainee.until("document.querySelector('.notice').textContent.includes('Sweep first')")
    trainer.page.get_by_label("A line for the trainee").fill("Stop when the tip is gone")
    trainer.page.get_by_role("button", name="Comment at").click()
    trainer.until("document.querySelectorAll('.watched .comments li').length === 1")
    trainee.page.keyboard.press("Enter")
    trainee.until(f"{PHASE} === 'debrief' && document.querySelector('.happened .comment')")
    assert "Stop when the tip is gone" in trainee.page.locator(".path-views .comments").inner_text()
    trainer.until("document.querySelectorAll('.standings tbody tr').length === 1")
    trainer.page.get_by_role("button", name="K-17", exact=True).click()
    trainer.until("document.querySelectorAll('.learning-plot path.curve.lit').length === 1")
    trainer.page.get_by_label("All stations").select_option("")
    for number, (layout, size) in enumerate(list(SIZES.items())[:3]):
        shown = trainer if number < 2 else visit(size=size, touch=True)
        shown.page.set_viewport_size({"width": size[0], "height": size[1]})
        shown.until("document.querySelectorAll('.standings tbody tr').length === 1")
        shown.until("document.querySelector('.watched canvas.picture').width > 100")
        assert shown.evaluate(CLIPPED) == [] and shown.evaluate(NAMELESS) == [], layout
        assert shown.evaluate("document.documentElement.scrollHeight <= innerHeight"), f"{layout} scrolls"
        assert layout != "tablet" or shown.evaluate(SMALL) == []
        shown.picture(f"lab-{layout}")


WORDS = "document.querySelector('.notice').innerText"


@pytest.mark.slow
def test_a_trainer_freezes_a_station_and_sees_its_3_d_view(visit):
    trainee, trainer = seated(visit, 2), visit()
    trainer.until("document.querySelectorAll('.card').length === 3")
    trainer.page.get_by_role("button", name="2 K-17").click()
    trainer.page.get_by_role("button", name="3-D view", exact=True).click()
    trainer.until("document.querySelector('.watched-view canvas').width > 100")
    trainee.page.locator(".image-pane").focus()
    trainee.hold("ArrowDown", "link.shown > 5")
    freeze = trainer.page.get_by_role("button", name="Freeze", exact=True)
    freeze.click()
    trainee.until(f"{WORDS}.includes('Frozen by the trainer')")
    trainee.until("document.body.dataset.status === 'frozen'")
    trainee.page.keyboard.press("Space")
    shown = trainee.evaluate("link.shown")
    trainee.page.keyboard.press("ArrowDown")
    trainee.passed(20)
    assert trainee.evaluate("[link.shown, document.body.dataset.status]") == [shown, "frozen"]
    trainer.until("document.querySelector('.card:nth-child(2) .word').textContent === 'frozen'")
    trainer.until("document.querySelector('.watched .note').textContent.startsWith('frozen')")
    for layout, size in list(SIZES.items())[:3]:
        for page, name in ((trainer, "lab-3d"), (trainee, "frozen")):
            page.page.set_viewport_size({"width": size[0], "height": size[1]})
            page.passed(3)
            assert page.evaluate(CLIPPED) == [] and page.evaluate(NAMELESS) == [], (layout, name)
            page.picture(f"{name}-{layout}")
    freeze.click()
    trainee.until("document.body.dataset.status === 'live'")
    trainee.page.locator(".image-pane").focus()
    trainee.hold("ArrowDown", f"link.shown > {shown} + 1")


@pytest.mark.slow
@pytest.mark.parametrize("layout", list(SIZES)[:3])
def test_with_forced_colours_what_is_chosen_in_a_lab_is_the_systems_and_pictures_stay(visit, layout):
    seated(visit, 3)
    driver = visit(size=SIZES[layout], forced_colors="active", touch=layout == "tablet")
    page = driver.page
    driver.until("document.querySelectorAll('.card').length === 3")
    page.get_by_role("button", name="3 K-17").click()
    lock = page.get_by_role("button", name="Lock guides").last
    lock.click()
    driver.until("document.querySelector('.sets [aria-pressed=true]')")
    page.evaluate("document.body.append(Object.assign(document.createElement('i'), {className: 'unseen'}))")

    def colour(selector, name):
        return page.evaluate(COLOUR, [selector, name])[:3]

    def system(name):
        page.evaluate(f"document.querySelector('.unseen').style.color = '{name}'")
        return colour(".unseen", "color")

    assert colour(".card[aria-pressed=true]", "outlineColor") == system("Highlight")
    assert colour(".sets [aria-pressed=true]", "backgroundColor") == system("Highlight")
    assert colour(".card .word", "borderTopColor") == system("CanvasText")
    assert colour(".learning-plot .zero", "stroke") == system("CanvasText")
    for part in ("path", "text"):
        found = [colour(f".learning-plot {part}.limit.{one}", "fill" if part == "text" else "stroke") for one in ENDS]
        assert found == [system("CanvasText")] * 2
    assert colour(".card[aria-pressed=true] .place", "color") == system("CanvasText")
    assert colour(".watched-image", "backgroundColor") == [0, 0, 0]
    assert driver.evaluate(NAMELESS) == []
    driver.picture(f"lab-forced-{layout}")
    lock.click()
    driver.until("!document.querySelector('.sets [aria-pressed=true]')")


@pytest.mark.slow
def test_who_has_no_token_is_asked_for_it(browser, lab):
    driver = Driver(browser, lab["address"], query="trainer.html")
    driver.until("!document.querySelector('.sign-in').hidden")
    driver.page.locator("#token").fill("guess")
    driver.page.get_by_role("button", name="Open the lab").click()
    driver.until("document.querySelector('#token-problem').textContent.includes('missing or wrong')")
    assert driver.page.locator(".card").count() == 0
    driver.context.close()  # the browser itself complains of what was refused


@pytest.mark.slow
def test_the_image_is_mirrored_and_measured_by_keys(drive):
    driver = drive("gel", size=SIZES["compact"])
    page = driver.page
    dot = "Number(document.querySelector('.marks .dot').getAttribute('cx'))"
    middle = "((canvas) => canvas.offsetLeft + canvas.offsetWidth / 2)(document.querySelector('canvas.picture'))"
    assert driver.evaluate(f"{dot} < {middle}")
    page.locator("#scanner-button").click()
    page.get_by_role("menuitemcheckbox", name="Left and right").click()
    assert driver.evaluate(f"{dot} > {middle}")
    assert "matrix(-1" in driver.evaluate("getComputedStyle(document.querySelector('canvas.picture')).transform")
    frequency = "Number(document.querySelector('[data-knob$=\"image.frequency\"]').dataset.value)"
    start = driver.evaluate(frequency)
    page.get_by_role("menuitem", name="Resolution").click()
    driver.until(f"{frequency} > {start}")
    page.keyboard.press("Escape")
    button = page.get_by_role("button", name="Calliper")
    button.focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    for _ in range(4):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowDown")
    measured = float(page.locator(".measuring output").get_attribute("data-value"))
    assert measured == pytest.approx((20**2 + 0.5**2) ** 0.5, abs=1e-3)
    page.keyboard.press("Escape")
    assert not page.locator(".calliper").is_visible()
