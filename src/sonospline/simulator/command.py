"""What a hand asks of the simulator, all of it at once: needle, probe, image, freeze."""

from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias, get_args

from msgspec.structs import replace

from .._shown import shown
from ..io.records import FieldError, Record, about
from ..ultrasound.display import GREY_MAPS, TGC_SLIDERS
from .knobs import Knob, Travel, Words, always
from .tissue_settings import TissueSettings

Mode = Literal["fundamental", "harmonic"]
Colour = Literal["off", "flow"]
if TYPE_CHECKING:
    GreyMap: TypeAlias = str
else:
    GreyMap = Literal[tuple(GREY_MAPS)]

DEEPEST_MM = 18.0
"""How deep a probe may be pressed, and a fifth of the tissue at most: beyond it what lies beside its face folds."""


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
    press: Annotated[
        float,
        Knob(
            name="Press", short="Press", help="Press on the skin", unit="mm", step=0.5, rate=5,
            down="Press less", up="Press more", keys=("KeyC", "KeyV"),
        ),
        Travel(lambda scene: (0.0, max(0.0, min(DEEPEST_MM, scene.deep / 5) - scene.spec.probe.press_mm))),
    ] = 0.0  # fmt: skip


def _slider(number: int) -> Knob:
    where = {1: " at the face", TGC_SLIDERS: " at the bottom"}.get(number, "")
    return Knob(
        name=f"TGC {number}{where}", short=f"TGC {number}", help=f"Time-gain compensation, slider {number}{where}",
        unit="dB", decimals=0, step=1, rate=12, setting=True, down=f"Less of slider {number}",
        up=f"More of slider {number}",
    )  # fmt: skip


_TGC = Travel(always(-12.0, 12.0))


class ImageSettings(Record, frozen=True, kw_only=True, repr_omit_defaults=True):
    """The scanner's knobs: dB relative to the scene's own gain, mm, MHz, mm, mm, dB, Hz, degrees; and words."""

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
    transmit: Annotated[
        float,
        Knob(
            name="Transmit focus", short="Send", help="Transmit focus, 0: every depth", unit="cm", shown=10, step=5,
            rate=20, setting=True, down="Send nearer", up="Send deeper",
        ),
        Travel(
            lambda scene: (0.0, 1.6 * scene.probe.depth_mm) if scene.synthetic else (0.0, 0.0),
            lambda scene: scene.probe.transmit_focus_mm,
        ),
    ] = 0.0  # fmt: skip
    tgc1: Annotated[float, _slider(1), _TGC] = 0.0
    tgc2: Annotated[float, _slider(2), _TGC] = 0.0
    tgc3: Annotated[float, _slider(3), _TGC] = 0.0
    tgc4: Annotated[float, _slider(4), _TGC] = 0.0
    tgc5: Annotated[float, _slider(5), _TGC] = 0.0
    tgc6: Annotated[float, _slider(6), _TGC] = 0.0
    tgc7: Annotated[float, _slider(7), _TGC] = 0.0
    tgc8: Annotated[float, _slider(8), _TGC] = 0.0
    prf: Annotated[
        float,
        Knob(
            name="Pulse repetition", short="PRF", help="Pulses a second of colour Doppler", unit="kHz", shown=1000,
            step=500, rate=2000, setting=True, down="Fewer pulses", up="More pulses",
        ),
        Travel(always(500.0, 10_000.0), lambda scene: 4000.0),
    ] = 4000.0  # fmt: skip
    steer: Annotated[
        float,
        Knob(
            name="Steer the colour box", short="Steer", help="Lean of the colour box's beams", unit="°", decimals=0,
            step=5, rate=20, setting=True, sense="left-right", down="Steer left", up="Steer right",
        ),
        Travel(
            lambda scene: (0.0, 0.0) if scene.probe.curved or not scene.synthetic else (-20.0, 20.0),
            lambda scene: 0.0 if scene.probe.curved or not scene.synthetic else 20.0,
        ),
    ] = 0.0  # fmt: skip
    box_across: Annotated[
        float,
        Knob(
            name="Colour box across", short="Box", help="Middle of the colour box across", unit="mm", decimals=0,
            step=2, rate=20, setting=True, sense="left-right", down="Box left", up="Box right",
        ),
        Travel(lambda scene: (-scene.probe.aperture_mm / 2, scene.probe.aperture_mm / 2)),
    ] = 0.0  # fmt: skip
    box_depth: Annotated[
        float,
        Knob(
            name="Colour box depth", short="Box depth", help="Depth of the colour box's middle", unit="mm", decimals=0,
            step=2, rate=20, setting=True, down="Box up", up="Box down",
        ),
        Travel(lambda scene: (0.0, 1.6 * scene.probe.depth_mm), lambda scene: 0.48 * scene.probe.depth_mm),
    ] = 0.0  # fmt: skip
    pixels: Annotated[
        int,
        about("pixels along the picture's longer side", low=128, high=1024),
        Words(name="Pixels", help="Along the picture's longer side, as many as the pane can show"),
    ] = 512
    mode: Annotated[Mode, Words(name="Mode", help="What is heard: what is sent, or its harmonic")] = "fundamental"
    grey_map: Annotated[GreyMap, Words(name="Grey map", help="What echoes are shown as")] = "linear"
    colour: Annotated[Colour, Words(name="Colour Doppler", help="Whether what flows is shown in colour")] = "off"

    def __post_init__(self) -> None:
        for name, words in (("mode", Mode), ("grey_map", GreyMap), ("colour", Colour)):
            if getattr(self, name) not in get_args(words):
                known = ", ".join(get_args(words))
                raise FieldError((name,), f"= {shown(getattr(self, name))} is not known; choose one of {known}")
        if not (isinstance(self.pixels, int) and 128 <= self.pixels <= 1024):
            raise FieldError(("pixels",), f"= {shown(self.pixels)} is out of range; give 128 to 1024")

    @property
    def tgc_db(self) -> tuple[float, ...]:
        """The eight sliders of time-gain compensation, from the face down; none where all stand in the middle."""
        sliders = tuple(float(getattr(self, f"tgc{k}")) for k in range(1, TGC_SLIDERS + 1))
        return sliders if any(sliders) else ()


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

    def with_image(self, **changes: float | str) -> Self:
        """Return the command with some of the image's numbers and words changed."""
        return replace(self, image=replace(self.image, **changes))

    def with_tissue(self, **changes: str) -> Self:
        """Return the command with some of the tissue's switches changed."""
        return replace(self, tissue=replace(self.tissue or TissueSettings(), **changes))
