"""A session: one needle, one probe, one patient, from command to picture."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from .. import _validate
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..models.insertion import NeedleInsertion
from . import models
from .command import Command, NeedleCommand
from .fold_check import folds
from .imaging import Imager, tuned
from .pass_metrics import PassMetrics
from .readouts import Blocked, Readouts
from .scene import Scene
from .scene_file import MODELS, SceneFile
from .scene_maker import make_scene
from .shot import Shot
from .skin_frame import room_along

Array = NDArray[np.float64]

RESTORE_S = 8.0
"""How long a reset can be undone."""
STEER_DEG = 5.0
"""How far a needle inside can be turned from the direction it entered in."""
_OUT_MM = 0.05
"""A needle less deep than this is out."""
_INSIDE_MM = 1e-3
"""Room left between a tip and the far side of the box."""

logger = logging.getLogger(__name__)


class Granted(NamedTuple):
    """A command after the tissue had its say."""

    command: Command
    blocked: Blocked | None


@dataclass(frozen=True, eq=False)
class _Saved:
    """What a reset puts away."""

    command: Command
    metrics: PassMetrics
    passes: tuple[PassMetrics, ...]
    entered: NeedleCommand | None
    at: float


class Session:
    """A scene that is worked on: push the needle, move the probe, see the picture.

    Everything happens in :meth:`step`, in the caller's thread; a :class:`~sonospline.simulator.Runner` calls it at a
    fixed rate in a thread of its own. A step that fails raises and leaves the last picture in force.

    Parameters
    ----------
    scene : Scene, SceneFile, str or Path
        A scene made ready, one to be made, the name of a shipped one (``kidney``, ``gel``, ``cube``), or a file.
    model : {"paper", "kelvinlet", "elastic"}, optional
        How the tissue answers; by default as the scene says.
    clock : callable, default: time.monotonic
        Seconds, for the metrics of a pass.

    Raises
    ------
    ValueError
        A scene that cannot be read or made.

    Examples
    --------
    >>> from sonospline.simulator import SceneFile, Session
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
    >>> session = Session(scene, model="paper")
    >>> shot = session.step(session.command.with_needle(depth=30.0))
    >>> shot.image.pixels.dtype.name, shot.readouts.depth, bool(shot.readouts.moved > 0.1)
    ('uint8', 30.0, True)
    >>> session.step(session.command.with_needle(depth=0)).readouts.moved
    0.0
    """

    def __init__(
        self,
        scene: Scene | SceneFile | str | Path = "kidney",
        *,
        model: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.scene = _scene(scene)
        self.command = self.scene.start
        """The state in force."""
        self.target = next(iter(self.scene.targets))
        self.model = _validate.choice("model", model or self.scene.spec.model.use, MODELS)
        self.last: Shot | None = None
        self._clock = clock
        self._insertions: dict[str, NeedleInsertion] = {}
        self._making = threading.Lock()
        self.rest = GridField(
            self.scene.tissue.grid, np.zeros((*self.scene.tissue.grid.shape, 3), np.float32), error_estimate=0.0
        )
        """The field while the needle is out."""
        self._needle: Needle | None = None
        self._shown, self._exact_model = self.rest, ""
        self._folds = False
        self._imager: Imager | None = None
        self._aimed_for: tuple[Any, ...] = ()
        self._metrics = PassMetrics()
        self._passes: tuple[PassMetrics, ...] = ()
        self._entered: NeedleCommand | None = None
        self._saved: _Saved | None = None
        self._frozen_at: float | None = None
        self._frames = 0

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_making"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _making=threading.Lock())

    def step(self, command: Command | None = None) -> Shot:
        """Bring the tissue nearer to a command and return the picture of it.

        Parameters
        ----------
        command : Command, optional
            By default the one in force: elastic tissue comes to rest over some steps, and a picture's noise lives.

        Raises
        ------
        ValueError
            A command beyond the scene's limits; nothing changes.
        """
        command = self.command if command is None else command
        self.scene.knobs.check(command)
        if command.frozen and self.last is not None:
            return self._freeze()
        self._thaw()
        granted = self.grant(command)
        started = time.perf_counter()
        needle = self._needle_of(granted.command.needle)
        self._answer(needle)
        stepped = time.perf_counter()
        imager = self._aimed(granted.command)
        image = imager.render(self._shown, needle, frame=self._frames, gain_db=granted.command.image.gain)
        rendered = time.perf_counter()
        self.command = granted.command
        self.last = self._shot(granted, imager, image, 1e3 * (stepped - started), 1e3 * (rendered - stepped))
        self._frames += 1
        return self.last

    def warm_up(self) -> None:
        """Make what the first push will need, so that the first push does not wait for it; nothing changes.

        Unlike everything else this may be called in another thread while the session steps.
        """
        command, model = self.command, self.model
        if command.needle.depth > 0 or model in self._insertions:
            return
        trial = self._needle_of(self.grant(command.with_needle(depth=1.0)).command.needle)
        with self._making:
            if model not in self._insertions:
                insertion = models.make(model, self.scene)
                if trial is not None:
                    insertion.advance(trial)
                    insertion.reset()
                self._insertions[model] = insertion

    def pause(self) -> None:
        """Have the clock of the pass stand still until the next step; nobody steps meanwhile."""
        if self._frozen_at is None:
            self._frozen_at = self._clock()

    def settle(self, command: Command | None = None, *, most: int = 100) -> Shot:
        """Step until the tissue has come to rest at a command, and return the last picture."""
        shot = self.step(command)
        for _ in range(most):
            if shot.settled:
                break
            shot = self.step()
        return shot

    def switch(self, model: str) -> None:
        """Let another model answer; needle and probe stay where they are."""
        self.model = _validate.choice("model", model, MODELS)

    def choose_target(self, name: str) -> None:
        """Aim for another target of the scene."""
        self.target = _validate.choice("target", name, self.scene.targets)

    def undo_pass(self) -> None:
        """Take the needle out and forget the present or last pass; the next step shows it."""
        if self._passes:
            *before, self._metrics = self._passes
            self._passes = tuple(before)
        self._entered = None
        self.command = structs.replace(self.command.with_needle(depth=0.0), frozen=False)

    def reset(self) -> None:
        """Put needle, probe, image and metrics back to the scene's start."""
        self._saved = _Saved(self.command, self._metrics, self._passes, self._entered, self._clock())
        self.command, self._metrics, self._passes, self._entered = self.scene.start, PassMetrics(), (), None

    def restore(self) -> None:
        """Undo a reset.

        Raises
        ------
        ValueError
            There was none, or it is more than 8 s ago.
        """
        saved = self._saved
        if saved is None or self._clock() - saved.at > RESTORE_S:
            raise ValueError(f"there is no reset of the last {RESTORE_S:g} s to undo; push the needle again")
        self.command, self._metrics, self._passes = (
            structs.replace(saved.command, frozen=False),
            saved.metrics,
            saved.passes,
        )
        self._entered, self._saved = saved.entered, None

    def grant(self, command: Command) -> Granted:
        """Return a command as far as needle and tissue allow it."""
        needle, blocked = command.needle, None
        if needle.depth < _OUT_MM:
            return Granted(command.with_needle(depth=0.0), None)
        if self._entered is not None:
            held = _held(needle, self._entered)
            blocked = None if held == needle else "needle inside"
            needle = held
        frame, length = self.scene.frame, self.scene.spec.needle.length_mm
        room = room_along(self.scene.tissue.grid, frame.entry(needle), frame.direction(needle)) - _INSIDE_MM
        if needle.depth > room:
            needle, blocked = structs.replace(needle, depth=room if room > _OUT_MM else 0.0), "leaves the tissue"
        elif needle.depth >= length:
            needle, blocked = structs.replace(needle, depth=length), "end of needle"
        return Granted(structs.replace(command, needle=needle), blocked)  # type: ignore[arg-type]

    def _needle_of(self, command: NeedleCommand) -> Needle | None:
        if command.depth == 0:
            return None
        entry = self.scene.frame.entry(command)
        return Needle(entry, entry + command.depth * self.scene.frame.direction(command))

    def _answer(self, needle: Needle | None) -> None:
        """Let the tissue answer to a needle; where it already has, nothing is done."""
        if needle is None:
            if self._needle is not None or self._exact_model != self.model:
                if self.model in self._insertions:
                    self._insertions[self.model].reset()
                self._take(needle, self.rest)
            return
        insertion = self._insertion()
        same = self._needle is not None and _same(self._needle, needle) and self._exact_model == self.model
        if same and models.settled(insertion):
            return
        self._take(needle, GridField.of(insertion.advance(needle)))

    def _take(self, needle: Needle | None, shown: GridField) -> None:
        self._needle, self._shown, self._exact_model = needle, shown, self.model
        self._folds = needle is not None and folds(shown, needle)

    def _insertion(self) -> NeedleInsertion:
        with self._making:
            if self.model not in self._insertions:
                self._insertions[self.model] = models.make(self.model, self.scene)
            return self._insertions[self.model]

    def _aimed(self, command: Command) -> Imager:
        asked = (command.probe, command.image.depth, command.image.frequency, command.image.focus)
        if self._imager is not None and asked == self._aimed_for:
            return self._imager
        probe = tuned(self.scene.probe, command.image)
        pose = self.scene.frame.probe_to_reference(command.probe, self.scene.spec.probe.press_mm)
        self._imager = self.scene.see(probe, pose) if self._imager is None else self._imager.aimed(probe, pose)
        self._aimed_for = asked
        return self._imager

    def _count(self, command: Command, tip: Array, out_of_plane: float) -> None:
        now = self._clock()
        if command.needle.depth == 0:
            self._entered = None
            return
        if self._entered is None:
            self._passes = (*self._passes, self._metrics)
            self._metrics, self._entered = self._metrics.entered(now), command.needle
        self._metrics = self._metrics.moved(tip, out_of_plane, now)

    def _shot(self, granted: Granted, imager: Imager, image: Any, step_ms: float, render_ms: float) -> Shot:
        frame, command = self.scene.frame, granted.command
        entry, direction = frame.entry(command.needle), frame.direction(command.needle)
        tip = entry + command.needle.depth * direction
        rest = self.scene.targets[self.target]
        moved = np.zeros(3) if self._needle is None else self._insertion().field.displacement(rest[None])[0]
        out_of_plane, half_slice = imager.out_of_plane(tip)
        self._count(command, tip, out_of_plane)
        readouts = Readouts(
            tip_to_target=float(np.linalg.norm(rest + moved - tip)), depth=command.needle.depth,
            moved=float(np.linalg.norm(moved)), moved_parts=frame.parts(moved), out_of_plane=out_of_plane,
            half_slice=half_slice, folds=self._folds, estimate=self._shown.error_estimate,
        )  # fmt: skip
        return Shot(
            number=self._frames, command=command, blocked=granted.blocked, image=image,
            probe_to_reference=imager.probe_to_reference, entry=entry, tip=tip, direction=direction,
            needle=self._needle, field=self._shown, target=self.target, target_rest=rest, target_now=rest + moved,
            readouts=readouts, metrics=self._metrics, model=self.model,
            settled=self._needle is None or models.settled(self._insertion()), step_ms=step_ms, render_ms=render_ms,
        )  # fmt: skip

    def _freeze(self) -> Shot:
        """The last picture again, marked frozen; nothing moves."""
        assert self.last is not None
        if self._frozen_at is None:
            self._frozen_at = self._clock()
        self.command = structs.replace(self.command, frozen=True)
        self.last = replace(self.last, command=structs.replace(self.last.command, frozen=True))
        return self.last

    def _thaw(self) -> None:
        if self._frozen_at is not None:
            self._metrics = self._metrics.later(self._clock() - self._frozen_at)
            self._frozen_at = None


def _held(command: NeedleCommand, entered: NeedleCommand) -> NeedleCommand:
    """A needle inside keeps its entry and turns but a little from the direction it entered in."""
    return structs.replace(
        command,
        u=entered.u,
        v=entered.v,
        angle=float(np.clip(command.angle, entered.angle - STEER_DEG, entered.angle + STEER_DEG)),
        swing=float(np.clip(command.swing, entered.swing - STEER_DEG, entered.swing + STEER_DEG)),
    )


def _same(a: Needle, b: Needle) -> bool:
    return bool((a.entry == b.entry).all() and (a.tip == b.tip).all())


def _scene(scene: Scene | SceneFile | str | Path) -> Scene:
    return scene if isinstance(scene, Scene) else make_scene(scene)
