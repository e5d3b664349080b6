"""A knob is one entry: what is annotated there reaches the scene message, the page's buttons and its keys."""

import json
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import pytest

from page_driver import Driver, chromium
from simulator_client import Client, Running
from simulator_scenes import SMALL_PAPER
from sonospline.io.records import FieldError
from sonospline.server import client_messages, schema
from sonospline.simulator import (
    Command,
    Console,
    ImageSettings,
    NeedleCommand,
    ProbeCommand,
    SceneFile,
    Session,
    scene_maker,
)
from sonospline.simulator.knobs import Knob, Travel, always, described


class ImageWithSmoothing(ImageSettings, frozen=True, kw_only=True):
    """The scanner's knobs, and a toy."""

    smoothing: Annotated[
        float,
        Knob(
            name="Smoothing", short="Smooth", help="Smoothing", unit="mm", decimals=0, step=1, rate=4, setting=True,
            down="Less smoothing", up="More smoothing", keys=("KeyT", "KeyY"), pad=None,
        ),
        Travel(always(0.0, 4.0), lambda scene: 1.0),
    ] = 1.0  # fmt: skip


class CommandWithSmoothing(Command, frozen=True, kw_only=True):
    """A command with the toy in it."""

    image: ImageWithSmoothing


class CommandMessage(client_messages.CommandMessage, frozen=True, kw_only=True, tag="command"):
    """What the page says of it."""

    image: ImageWithSmoothing

    @property
    def command(self):
        return CommandWithSmoothing(needle=self.needle, probe=self.probe, image=self.image, frozen=self.frozen)


@pytest.fixture
def one_knob_more(monkeypatch):
    monkeypatch.setattr(scene_maker, "Command", CommandWithSmoothing)
    monkeypatch.setitem(client_messages.KINDS, "command", CommandMessage)


@pytest.fixture
def toy_server(one_knob_more):
    running = Running()
    yield running
    running.stop()


def test_every_knob_says_all_there_is_to_know():
    knobs = described(Command)
    assert [f"{group}.{field}" for group, field, _, _ in knobs] == [
        "needle.depth", "needle.u", "needle.v", "needle.angle", "needle.swing", "probe.slide", "probe.sweep",
        "probe.rotate", "probe.fan", "probe.press", "image.gain", "image.depth", "image.frequency", "image.focus",
        "image.transmit",
        *(f"image.tgc{slider}" for slider in range(1, 9)),
        *("image.prf", "image.steer", "image.box_across", "image.box_depth"),
    ]  # fmt: skip
    for _, _, knob, _ in knobs:
        assert all((knob.name, knob.short, knob.help, knob.down, knob.up))
        assert knob.step > 0 < knob.rate
    keys = [code for _, _, knob, _ in knobs for code in knob.keys or ()]
    assert len(keys) == len(set(keys)) == 24
    pads = [knob.pad for _, _, knob, _ in knobs if knob.pad]
    assert len(pads) == len(set(pads))


def test_a_field_without_a_description_is_refused():
    class Bare(ImageSettings, frozen=True, kw_only=True):
        warmth: float = 0.0

    kind = msgspec.defstruct("Odd", [("needle", NeedleCommand), ("probe", ProbeCommand), ("image", Bare)])
    with pytest.raises(TypeError, match=r"image.warmth has no Knob or no Travel; annotate the field with both"):
        described(kind)


def test_one_entry_more_is_in_the_scene_its_start_and_its_limits(one_knob_more):
    console = Console(Session(SceneFile.parse(SMALL_PAPER)))
    knob = console.scene.knobs["image.smoothing"]
    assert (knob.low, knob.high, knob.keys) == (0.0, 4.0, ("KeyT", "KeyY"))
    assert console.command.image.smoothing == 1.0
    with pytest.raises(FieldError, match=r"image.smoothing = 5 is out of range; give 0 to 4 in this scene"):
        console.step(console.command.with_image(smoothing=5.0))
    assert console.step(console.command.with_image(smoothing=3.0)).command.image.smoothing == 3.0


def test_the_scene_message_describes_it_and_a_command_moves_it(toy_server):
    with Client(toy_server) as page:
        page.ready()
        (told,) = [knob for knob in page.scene["knobs"] if knob["id"] == "image.smoothing"]
        assert (told["name"], told["low"], told["high"], told["keys"]) == ("Smoothing", 0, 4, ["KeyT", "KeyY"])
        page.state["image"]["smoothing"] = 2.0
        header, _ = page.frame(page.ask(depth=5.0))
        assert header["state"]["image"]["smoothing"] == 2
        page.state["image"]["smoothing"] = 9.0
        page.ask()
        assert page.text("refused")["message"] == "image.smoothing = 9 is out of range; give 0 to 4 in this scene"


@pytest.fixture
def browser():
    with chromium() as browser:
        yield browser


@pytest.mark.slow
def test_the_page_gives_it_buttons_a_key_and_a_line_of_help(toy_server, browser):
    driver = Driver(browser, toy_server.url("/").replace("ws:", "http:")).live()
    try:
        page = driver.page
        assert page.locator(".dock .stepper.smoothing .name .long").inner_text() == "Smoothing"
        page.keyboard.press("KeyY")
        driver.until("document.querySelector('[data-knob=\"image.smoothing\"]').dataset.value === '2.000'")
        page.locator(".dock .stepper.smoothing").get_by_role("button", name="Less smoothing").click()
        driver.until("document.querySelector('[data-knob=\"image.smoothing\"]').dataset.value === '1.000'")
        page.keyboard.press("?")
        assert page.locator(".help-panel .key.KeyT").get_attribute("class").split() == ["key", "view", "KeyT"]
        assert "smoothing" in page.locator(".help-tables").inner_text().lower()
    finally:
        driver.finish()


def test_the_schema_that_the_page_is_built_with_is_of_these_messages():
    assert Path(schema.FILE).read_text() == schema.text(schema.protocol_schema()), (
        "run python -m sonospline.server.schema"
    )


def test_what_is_said_fits_the_schema(running):
    """Every message of a session, by the types that the schema was made of."""
    with Client(running) as page:
        page.ready()
        header, _ = page.frame(page.ask(depth=9.0))
        kinds = {kind.__struct_config__.tag: kind for kind in schema.server_messages.Said.__args__}
        for text in (page.hello, page.scene):
            kind = kinds[text["type"]]
            assert set(text) == {"type", *kind.__struct_fields__}
            msgspec.convert(text, kind)
        sent = msgspec.convert(header, schema.wire.FrameHeader)
        assert {*header} == {*schema.protocol_schema()["$defs"]["FrameHeader"]["properties"]}
        assert np.isfinite(sent.image_to_reference).all()
    json.dumps(schema.protocol_schema())
