"""What a person asks of the simulator, all of it at once: needle, probe, image, freeze."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from .._shown import figure, inside
from ._fields import FieldError

Range = tuple[float, float]
_SLACK = 1e-6


@dataclass(frozen=True, kw_only=True)
class NeedleCommand:
    """Where the needle should be: mm and degrees, seen from the skin (see :class:`SkinFrame`)."""

    u: float
    v: float
    angle: float
    swing: float
    depth: float


@dataclass(frozen=True, kw_only=True)
class ProbeCommand:
    """Where the probe should be, from its rest pose: mm and degrees."""

    slide: float = 0.0
    sweep: float = 0.0
    rotate: float = 0.0
    fan: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ImageSettings:
    """The scanner's knobs: dB relative to the scene's own gain, mm, MHz, mm."""

    gain: float
    depth: float
    frequency: float
    focus: float


@dataclass(frozen=True, kw_only=True)
class Command:
    """The whole command, absolute: the newest one counts.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from sonospline.simulator import ImageSettings, NeedleCommand, ProbeCommand, Command
    >>> command = Command(needle=NeedleCommand(u=40, v=0, angle=120, swing=0, depth=0), probe=ProbeCommand(),
    ...             image=ImageSettings(gain=0, depth=120, frequency=3.5, focus=65))
    >>> command.with_needle(depth=30).needle.depth
    30
    """

    needle: NeedleCommand
    probe: ProbeCommand
    image: ImageSettings
    frozen: bool = False

    @property
    def told(self) -> dict[str, Any]:
        """The command as a state message has it."""
        return {
            "needle": vars(self.needle), "probe": vars(self.probe), "image": vars(self.image), "frozen": self.frozen,
        }  # fmt: skip

    def with_needle(self, **changes: float) -> Command:
        """Return the command with some of the needle's metrics changed."""
        return _changed(self, "needle", changes)

    def with_probe(self, **changes: float) -> Command:
        """Return the command with some of the probe's metrics changed."""
        return _changed(self, "probe", changes)

    def with_image(self, **changes: float) -> Command:
        """Return the command with some of the image's metrics changed."""
        return _changed(self, "image", changes)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What of a command makes sense in a scene: lowest and highest of each figure."""

    needle: dict[str, Range]
    probe: dict[str, Range]
    image: dict[str, Range]

    def check(self, command: Command) -> None:
        """Raise FieldError for the first figure that is beyond its limits (or NaN)."""
        for part in ("needle", "probe", "image"):
            asked, allowed = getattr(command, part), getattr(self, part)
            for entry in fields(asked):
                value, (low, high) = getattr(asked, entry.name), allowed[entry.name]
                if not low - _SLACK <= value <= high + _SLACK:
                    lowest, highest = inside(low, high, slack=_SLACK)
                    raise FieldError(
                        (part, entry.name),
                        f"= {figure(value)} is out of range; give {lowest} to {highest} in this scene",
                    )


def _changed(command: Command, part: str, changes: dict[str, float]) -> Command:
    from dataclasses import replace

    return replace(command, **{part: replace(getattr(command, part), **changes)})
