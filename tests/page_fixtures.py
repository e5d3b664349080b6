"""Fixtures of the browser tests: one browser, one server a scene, and pages that must not complain."""

import pytest

from page_driver import Driver, chromium, serving


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def kidney(browser):
    with serving() as address:
        yield address


@pytest.fixture(scope="module")
def gel(browser):
    with serving("--scene", "gel") as address:
        yield address


@pytest.fixture(scope="module")
def cube(browser):
    with serving("--scene", "cube") as address:
        yield address


@pytest.fixture
def drive(browser, request):
    """Open a page, of the gel block where no scene is named; nothing may leave the machine or be complained of."""
    opened = []

    def open_page(scene="gel", **options):
        opened.append(Driver(browser, request.getfixturevalue(scene), **options).live())
        return opened[-1]

    yield open_page
    for driver in opened:
        driver.finish()
