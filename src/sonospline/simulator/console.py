"""A session by knobs instead of poses: the numbers of a command, what the tissue allows of them, and passes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from msgspec import structs
from numpy.typing import ArrayLike

from ..contact.events import Held
from ..geometry.needle import Needle
from ..models.insertion import NEEDLE
from .command import Command, NeedleCommand, ProbeCommand
from .console_frame import ConsoleFrame, seen_from_skin
from .constraint import Constrained, constrain
from .event_log import logged
from .logged_event import Log
from .pass_metrics import PassMetrics
from .scene import Scene
from .session import Session, knows_time
from .simulated_frame import SimulatedFrame

RESTORE_S = 8.0
"""How long a reset can be undone."""


@dataclass(frozen=True, eq=False)
class _Standing:
    """Everything that commands have led to."""

    command: Command
    metrics: PassMetrics = field(default_factory=PassMetrics)
    passes: tuple[PassMetrics, ...] = ()
    """Metrics before each pass."""
    entered: NeedleCommand | None = None
    """How the needle that is inside went in."""
    log: Log = ()

    def moved(self, frame: ConsoleFrame, now: float) -> _Standing:
        """Return what a frame leads to."""
        needle = frame.command.needle
        log = logged(self.log, frame.events, needle.depth)
        if needle.depth == 0:
            return replace(self, command=frame.command, entered=None, log=log)
        first, metrics, passes = self.entered is None, self.metrics, self.passes
        if first:
            metrics, passes = metrics.entered(now), (*passes, metrics)
        metrics = metrics.moved(now)
        return _Standing(frame.command, metrics, passes, needle if first else self.entered, log)

    def without_pass(self) -> _Standing:
        """Return it with the needle out and the present or last pass forgotten."""
        command = structs.replace(self.command.with_needle(depth=0.0), frozen=False)
        *before, metrics = self.passes or (self.metrics,)
        return _Standing(command, metrics, tuple(before), log=self.log)


@dataclass(frozen=True, eq=False)
class _Reset:
    """What a reset puts away."""

    standing: _Standing
    frame: SimulatedFrame | None
    at: float


class Console:
    """A session worked by knobs, as the page has them: each command is absolute, the newest one counts.

    One needle; its numbers and the probe's are seen from the skin. What is merely blocked is
    clamped, and the frame says why. A step that fails raises and leaves everything as it was.

    Parameters
    ----------
    session : Session
        What is worked on; moved by this console alone.
    clock : callable, default: time.monotonic
        Seconds, for the metrics of a pass.

    Examples
    --------
    >>> from sonospline.simulator import Console, SceneFile, Session
    >>> scene = SceneFile.parse('''name = "Small block"
    ... [tissue]
    ... source = "gel block"
    ... voxel_mm = 1.0
    ... nodes = 5000
    ... [probe]
    ... kind = "linear"
    ... frequency_mhz = 3
    ... depth_mm = 40
    ... lines = 64
    ... [needle]
    ... u = -34
    ... angle = 38
    ... ''')
    >>> console = Console(Session(scene, model="paper"))
    >>> frame = console.step(console.command.with_needle(depth=300.0, angle=90.0))
    Traceback (most recent call last):
    sonospline.io.records.FieldError: needle.depth = 300 is out of range; give 0 to 150 in this scene
    >>> frame = console.step(console.command.with_needle(depth=100.0, angle=90.0))
    >>> frame.blocked, round(frame.readouts.depth), bool(frame.readouts.moved > 0)
    ('leaves the tissue', 70, True)
    >>> console.step(console.command.with_needle(depth=0)).readouts.moved
    0.0
    """

    def __init__(self, session: Session, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.session = session
        self.last: ConsoleFrame | None = None
        """The frame in force."""
        self._clock = clock
        self._standing = _Standing(session.scene.start)
        self._reset: _Reset | None = None
        self._paused_at: float | None = None

    @property
    def scene(self) -> Scene:
        """The session's."""
        return self.session.scene

    @property
    def command(self) -> Command:
        """The command in force."""
        return self._standing.command

    def step(self, command: Command | None = None, dt: float = 0.0) -> ConsoleFrame:
        """Bring the tissue to a command, some time later, and return the picture of it.

        Parameters
        ----------
        command : Command, optional
            By default the one in force: tissue may take some steps to come to rest, and a picture's noise lives.
        dt : float, default: 0
            Seconds since the last step.

        Raises
        ------
        ValueError
            A command beyond the scene's limits; nothing changes.
        """
        command = self._whole(self.command if command is None else command)
        self.scene.check(command)
        if command.frozen and self.last is not None:
            return self._freeze(self.last)
        constrained = self.constrain(command)
        allowed, skin = constrained.command, self.scene.frame
        needle = skin.needle(allowed.needle)
        frame = self.session.step(
            needles={} if needle is None else {NEEDLE: needle},
            probe_to_reference=skin.probe_to_reference(allowed.probe, self.scene.spec.probe.press_mm),
            settings=allowed.image,
            tissue=allowed.tissue,
            dt=dt,
        )
        constrained = self._as_held(constrained, frame)
        now, standing = self._clock(), self._standing
        if self._paused_at is not None:
            standing = replace(standing, metrics=standing.metrics.later(now - self._paused_at))
        shown = seen_from_skin(
            frame, self.scene, constrained.command, blocked=constrained.blocked, bone=constrained.bone,
            held_by=constrained.held_by, metrics=standing.metrics, log=standing.log,
        )  # fmt: skip
        standing = standing.moved(shown, now)
        self._standing, self._paused_at = standing, None
        self.last = replace(shown, metrics=standing.metrics, log=standing.log)
        return self.last

    def settle(self, command: Command | None = None, *, most: int = 100) -> ConsoleFrame:
        """Step until the tissue has come to rest at a command, and return the last frame."""
        frame = self.step(command)
        for _ in range(most):
            if frame.settled:
                break
            frame = self.step()
        return frame

    def constrain(self, command: Command) -> Constrained:
        """Return a command as far as needle and tissue allow it."""
        field = None if self.session.last is None else self.session.last.field
        time = knows_time(self.session.model)
        return constrain(self.scene, command, self._standing.entered, self.command.needle, field, time=time)

    def needle_command(self, needle: Needle) -> NeedleCommand:
        """Return the numbers of a needle in the world.

        Raises
        ------
        ValueError
            One that they cannot say, or that is beyond the scene's limits.
        """
        found = self.scene.frame.needle_command(needle)
        self.scene.knobs.check(structs.replace(self.scene.start, needle=found))
        return found

    def probe_command(self, probe_to_reference: ArrayLike) -> ProbeCommand:
        """Return the numbers of a probe's pose in the world.

        Raises
        ------
        ValueError
            One that they cannot say, or that is beyond the scene's limits.
        """
        found = self.scene.frame.probe_command(probe_to_reference, self.scene.spec.probe.press_mm)
        self.scene.knobs.check(structs.replace(self.scene.start, probe=found))
        return found

    def undo_pass(self) -> None:
        """Take the needle out and forget the present or last pass; the next step shows it."""
        self._standing = self._standing.without_pass()

    def reset(self) -> None:
        """Put needle, probe, image and metrics back to the scene's start."""
        self._reset = _Reset(self._standing, self.session.last, self._clock())
        self._standing = _Standing(self.scene.start, log=self._standing.log)

    def restore(self) -> None:
        """Undo a reset; the tissue is where it was before.

        Raises
        ------
        ValueError
            There was none, or it is more than 8 s ago.
        """
        reset = self._reset
        if reset is None or self._clock() - reset.at > RESTORE_S:
            raise ValueError(f"there is no reset of the last {RESTORE_S:g} s to undo; push the needle again")
        self.session.resume(reset.frame)
        command = structs.replace(reset.standing.command, frozen=False)
        self._standing, self._reset = replace(reset.standing, command=command), None

    def pause(self) -> None:
        """Have the clock of the pass stand still until the next step; nobody steps meanwhile."""
        if self._paused_at is None:
            self._paused_at = self._clock()

    def warm_up(self) -> None:
        """Make what the first push will need, so that it does not wait for it; nothing changes.

        Unlike everything else this may be called in another thread while the console steps.
        """
        if self.command.needle.depth == 0:
            tried = self.constrain(self.command.with_needle(depth=1.0)).command.needle
            self.session.warm_up(self.scene.frame.needle(tried))

    def _whole(self, command: Command) -> Command:
        """A command that says what tissue does in time."""
        return command if command.tissue else structs.replace(command, tissue=self.scene.start.tissue)

    def _as_held(self, constrained: Constrained, frame: SimulatedFrame) -> Constrained:
        """What is allowed of a command once tissue has had its say: the needle turns as far as the frame has it."""
        held = next((event for event in frame.events if isinstance(event, Held)), None)
        if held is None or frame.needle is None:
            return constrained
        there = self.scene.frame.needle_command(frame.needle)
        command = constrained.command.with_needle(angle=there.angle, swing=there.swing)
        blocked = constrained.blocked if constrained.bone else "held"
        return constrained._replace(command=command, blocked=blocked, held_by=held.by or "tissue")

    def _freeze(self, last: ConsoleFrame) -> ConsoleFrame:
        """The last frame again, marked frozen; nothing moves."""
        self.pause()
        self._standing = replace(self._standing, command=structs.replace(self.command, frozen=True))
        self.last = replace(last, command=structs.replace(last.command, frozen=True))
        return self.last

    def __repr__(self) -> str:
        return f"Console({self.session!r})"
