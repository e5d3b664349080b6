"""What a hand asks of the simulator, all of it at once: needle, probe, image, freeze."""

from typing import Annotated, Self

from msgspec.structs import replace

from ..io.records import Record
from .knobs import Knob, Travel, always
from .tissue_settings import TissueSettings


class NeedleCommand(Record, frozen=True, kw_only=True):
    """Where the needle should be: mm and degrees, seen from the skin (see :class:`SkinFrame`)."""

    depth: Annotated[
        float,
        Knob(
            name="Insertion depth", short="Push", help="Pull back, push", unit="mm", step=0.5, rate=10,
            down="Pull back", up="Push", keys=("ArrowUp", "ArrowDown"), pad="triggers",
        ),
        Travel(lambda scene: (0.0, scene.spec.needle.length_mm)),
    ]  # fmt: skip
    u: Annotated[
        float,
        Knob(
            name="Entry along the image", short="Along", help="Entry along the image", unit="mm", step=0.5, rate=20,
            sense="left-right", down="Entry left", up="Entry right",
        ),
        Travel(
            lambda scene: scene.along,
            lambda scene: scene.along[1] / 2 if scene.spec.needle.u is None else scene.spec.needle.u,
        ),
    ]  # fmt: skip
    v: Annotated[
        float,
        Knob(
            name="Entry across the image", short="Across", help="Entry across the image", unit="mm", step=0.5, rate=20,
            sense="near-far", down="Entry towards you", up="Entry away",
        ),
        Travel(lambda scene: scene.across, lambda scene: scene.spec.needle.v),
    ]  # fmt: skip
    angle: Annotated[
        float,
        Knob(
            name="Angle in plane", short="Angle", help="Angle in plane", unit="°", step=0.5, rate=10, sense="turn",
            down="Turn anticlockwise", up="Turn clockwise", keys=("ArrowLeft", "ArrowRight"), pad="right stick across",
        ),
        Travel(always(5.0, 175.0), lambda scene: scene.spec.needle.angle),
    ]  # fmt: skip
    swing: Annotated[
        float,
        Knob(
            name="Swing", short="Swing", help="Swing out of plane", unit="°", step=0.5, rate=10, sense="left-right",
            down="Swing towards you", up="Swing away", keys=("Comma", "Period"), pad="right stick along",
        ),
        Travel(always(-60.0, 60.0), lambda scene: scene.spec.needle.swing),
    ]  # fmt: skip


class ProbeCommand(Record, frozen=True, kw_only=True):
    """Where the probe should be, from its rest pose: mm and degrees."""

    slide: Annotated[
        float,
        Knob(
            name="Slide", short="Slide", help="Slide along image", unit="mm", step=0.5, rate=20, sense="left-right",
            down="Slide left", up="Slide right", keys=("KeyA", "KeyD"), pad="left stick across",
        ),
        Travel(lambda scene: scene.along, lambda scene: scene.spec.probe.slide),
    ] = 0.0  # fmt: skip
    sweep: Annotated[
        float,
        Knob(
            name="Sweep", short="Sweep", help="Sweep across", unit="mm", step=0.5, rate=20, sense="near-far",
            down="Sweep towards you", up="Sweep away", keys=("KeyS", "KeyW"), pad="left stick along",
        ),
        Travel(lambda scene: scene.across),
    ] = 0.0  # fmt: skip
    rotate: Annotated[
        float,
        Knob(
            name="Rotate", short="Rotate", help="Rotate", unit="°", decimals=0, step=1, rate=20, sense="turn",
            down="Rotate anticlockwise", up="Rotate clockwise", keys=("KeyQ", "KeyE"), pad="bumpers",
        ),
        Travel(always(-180.0, 180.0)),
    ] = 0.0  # fmt: skip
    fan: Annotated[
        float,
        Knob(
            name="Fan", short="Fan", help="Fan", unit="°", decimals=0, step=1, rate=20, sense="turn",
            down="Fan towards you", up="Fan away", keys=("KeyZ", "KeyX"), pad="d-pad across",
        ),
        Travel(always(-60.0, 60.0)),
    ] = 0.0  # fmt: skip


class ImageSettings(Record, frozen=True, kw_only=True):
    """The scanner's knobs: dB relative to the scene's own gain, mm, MHz, mm."""

    gain: Annotated[
        float,
        Knob(
            name="Gain", short="Gain", help="Gain", unit="dB", decimals=0, step=2, rate=12, setting=True,
            down="Less gain", up="More gain", keys=("Minus", "Equal"),
        ),
        Travel(always(-30.0, 30.0)),
    ]  # fmt: skip
    depth: Annotated[
        float,
        Knob(
            name="Depth", short="Depth", help="Depth", unit="cm", shown=10, decimals=0, step=10, rate=40, setting=True,
            down="Less depth", up="More depth", keys=("BracketLeft", "BracketRight"), pad="d-pad along",
        ),
        Travel(
            lambda scene: (max(20.0, 0.4 * scene.probe.depth_mm), min(250.0, 1.6 * scene.probe.depth_mm)),
            lambda scene: scene.probe.depth_mm,
        ),
    ]  # fmt: skip
    frequency: Annotated[
        float,
        Knob(
            name="Frequency", short="Freq.", help="Frequency", unit="MHz", step=0.5, rate=2, setting=True,
            down="Lower frequency", up="Higher frequency", keys=("Digit9", "Digit0"),
        ),
        Travel(
            lambda scene: (max(1.0, scene.probe.frequency_mhz / 2), 1.6 * scene.probe.frequency_mhz)
            if scene.synthetic
            else (scene.probe.frequency_mhz,) * 2,
            lambda scene: scene.probe.frequency_mhz,
        ),
    ]  # fmt: skip
    focus: Annotated[
        float,
        Knob(
            name="Focus", short="Focus", help="Focus", unit="cm", shown=10, step=5, rate=20, setting=True,
            down="Focus nearer", up="Focus deeper", keys=("Semicolon", "Quote"),
        ),
        Travel(
            lambda scene: (5.0, max(1.6 * scene.probe.depth_mm, scene.probe.elevation_focus_mm))
            if scene.synthetic
            else (scene.probe.elevation_focus_mm,) * 2,
            lambda scene: scene.probe.elevation_focus_mm,
        ),
    ]  # fmt: skip


class Command(Record, frozen=True, kw_only=True):
    """The whole command, absolute: the newest one counts.

    Examples
    --------
    >>> from sonospline.simulator import Command, ImageSettings, NeedleCommand, ProbeCommand
    >>> command = Command(needle=NeedleCommand(u=40, v=0, angle=120, swing=0, depth=0), probe=ProbeCommand(),
    ...                   image=ImageSettings(gain=0, depth=120, frequency=3.5, focus=65))
    >>> command.with_needle(depth=30).needle.depth
    30
    """

    needle: NeedleCommand
    probe: ProbeCommand
    image: ImageSettings
    tissue: TissueSettings | None = None
    """By default as the scene starts."""
    frozen: bool = False

    def with_needle(self, **changes: float) -> Self:
        """Return the command with some of the needle's numbers changed."""
        return replace(self, needle=replace(self.needle, **changes))

    def with_probe(self, **changes: float) -> Self:
        """Return the command with some of the probe's numbers changed."""
        return replace(self, probe=replace(self.probe, **changes))

    def with_image(self, **changes: float) -> Self:
        """Return the command with some of the image's numbers changed."""
        return replace(self, image=replace(self.image, **changes))

    def with_tissue(self, **changes: str) -> Self:
        """Return the command with some of the tissue's switches changed."""
        return replace(self, tissue=replace(self.tissue or TissueSettings(), **changes))
