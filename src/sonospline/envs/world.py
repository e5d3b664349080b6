"""Worlds: the tissue of an exercise, made once, and episodes in it, each with a start and a target of its own."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace as replaced
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._digest import digest_of_bytes
from .._shown import shown
from ..geometry.needle import Needle
from ..io.records import FieldError
from ..simulator.command import Command, NeedleCommand
from ..simulator.console import Console
from ..simulator.console_frame import ConsoleFrame
from ..simulator.scene import Scene
from ..simulator.scene_file import SceneFile
from ..simulator.scene_maker import make_scene
from ..simulator.session import Session
from ..simulator.shipped import SHIPPED
from ..training.exercise import SHIPPED_EXERCISES, Exercise
from ..training.growing_trace import GrowingTrace
from ..training.metric import measure
from ..training.trace import Sample
from .unseen import without_pictures

Array = NDArray[np.float64]
FOLDER = Path(__file__).parent / "worlds"
OWN = ("needle-steering", "probe-navigation")
"""Exercises of this package, made for learning."""
LEAST_NODES, MOST_NODES = 1000, 500_000


class World:
    """The tissue of an exercise, in which episodes are drawn.

    Parameters
    ----------
    exercise : Exercise, str or Path
        One of this package's own (``needle-steering``, ``probe-navigation``), one of
        :data:`~sonospline.training.SHIPPED_EXERCISES`, a TOML file, or an exercise with a scene that is shipped.
    spread_mm : (3,) array_like, default: (0, 0, 0)
        How far from its place the target is drawn, at most: to the right, deeper, away from the viewer.
    nodes : int, default: 8000
        Of the solver's grid, about.
    pixels : int, optional
        Along the longer side of a frame's picture; by default frames have none.

    Raises
    ------
    ValueError
        An exercise or a scene that is not known or cannot be read, or a spread of which a corner is outside the
        tissue or out of the needle's reach.

    Examples
    --------
    >>> from sonospline.envs.world import World
    >>> episode = World("needle-steering", spread_mm=(10, 4, 4)).episode(seed=7)
    >>> frame = episode.step(episode.command.with_needle(depth=1.0), dt=0.1)
    >>> round(frame.readouts.depth, 1), frame.time_s, sorted(episode.metrics())[:2]
    (1.0, 0.1, ['back_wall_perforations', 'blind_advance_mm'])
    """

    def __init__(
        self,
        exercise: Exercise | str | Path,
        *,
        spread_mm: ArrayLike = (0.0, 0.0, 0.0),
        nodes: int = 8000,
        pixels: int | None = None,
    ) -> None:
        spread = np.array(_validate.vector("spread_mm", spread_mm))
        if (spread < 0).any():
            raise ValueError(f"spread_mm = {spread.tolist()} is below zero; give how far the target may be drawn")
        self.exercise, folder = read_exercise(exercise)
        nodes = _validate.count("nodes", nodes, least=LEAST_NODES, most=MOST_NODES)
        asked = _Asked.by(self.exercise, folder, nodes)
        self.seen = _scene(asked)
        """The scene, with pictures."""
        self._session = copy.copy(_at_rest(asked, self.exercise.model, pixels is not None))
        self.scene = self._session.scene
        """The scene that episodes are in."""
        self._spread, self._pixels = spread, pixels
        self._session.targets = dict(self.scene.targets)
        self.exercise.check(self.scene)
        for corner in np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1:
            self._check(self._beside(corner * spread))

    def episode(self, seed: int, *, target: ArrayLike | None = None) -> Episode:
        """Return an episode at its start, drawn by a seed: the same one is the same episode, to the bit.

        Those before it end: a world has one at a time.

        Parameters
        ----------
        seed : int
            Of start and target.
        target : (3,) array_like, optional
            Where the target is at rest, world RAS mm; by default drawn.

        Raises
        ------
        ValueError
            A target outside the tissue or out of the needle's reach.
        """
        rng = np.random.default_rng(seed)
        place = self._beside(self._spread * rng.uniform(-1, 1, 3))
        if target is not None:
            place = np.array(_validate.vector("target", target))
            self._check(place)
        start = self.exercise.start_in(self._with_target(place), int(rng.integers(2**63)))
        if self._pixels is not None:
            start = start.with_image(pixels=self._pixels)
        self._session.resume(None)
        self._session.choose_target(self.exercise.target, place)
        return Episode(self._session, self.exercise, start)

    def _beside(self, offset_mm: Array) -> Array:
        """A place beside the exercise's target, by parts along the skin's directions."""
        frame, (right, deep, out) = self.scene.frame, offset_mm
        found: Array = self.scene.targets[self.exercise.target] + right * frame.right + deep * frame.depth
        return found + out * frame.out

    def _with_target(self, place: Array) -> Scene:
        return replace(self.scene, targets={**self.scene.targets, self.exercise.target: place})

    def _check(self, place: Array) -> None:
        """Raise ValueError where a target is in no tissue, or some entry that may be drawn is too far from it."""
        self.scene.tissue.check_inside(target=place)
        start, drawn = self.scene.start, self.exercise.start
        for u in drawn.u or (start.needle.u,):
            for v in drawn.v or (start.needle.v,):
                entry = self.scene.frame.entry(replaced(start.needle, u=u, v=v))
                aimed = self.scene.frame.needle_command(Needle(entry, place))
                try:
                    self.scene.check(replaced(start, needle=aimed))
                except FieldError as error:
                    at = f"target at {np.round(place, 1).tolist()} is out of reach from u = {u:g}, v = {v:g} mm"
                    raise ValueError(f"{at}: {error}") from None

    def __repr__(self) -> str:
        return f"World({self.exercise!r}, spread_mm={self._spread.tolist()})"


class Episode:
    """One episode: a console at its start, and the trace of what became of it."""

    def __init__(self, session: Session, exercise: Exercise, start: Command) -> None:
        self.exercise = exercise
        self._console = Console(session)
        self._trace = GrowingTrace()
        self.entered: NeedleCommand | None = None
        """How the needle that is inside went in."""
        self.frame = self.step(start)
        """The frame in force."""

    @property
    def scene(self) -> Scene:
        """Where it happens."""
        return self._console.scene

    @property
    def command(self) -> Command:
        """The command in force."""
        return self.frame.command

    def step(self, command: Command, dt: float = 0.0) -> ConsoleFrame:
        """Bring the tissue to a command, some time later."""
        self.frame = self._console.step(command, dt)
        inside = self.frame.command.needle
        self.entered = None if inside.depth == 0 else self.entered or inside
        self._trace.add(self.frame.time_s, Sample.of(self.frame, self.scene))
        return self.frame

    def settle(self, command: Command) -> ConsoleFrame:
        """Bring the tissue to rest at a command, with no time passing."""
        self._console.settle(command)
        return self.step(command)

    def metrics(self) -> dict[str, float]:
        """Return the trainer's metrics of it so far, by name; NaN for what it does not tell."""
        return measure(self._trace.trace(), self.exercise.task)

    def __repr__(self) -> str:
        return f"Episode({self.exercise.name!r}, {self.frame.time_s:.4g} s)"


def read_exercise(exercise: Exercise | str | Path) -> tuple[Exercise, Path]:
    """Return an exercise by its name or from its file, and the folder that its scene is seen from."""
    if isinstance(exercise, Exercise):
        return exercise, Path()
    if not isinstance(exercise, str | Path):
        raise ValueError(f"exercise = {shown(exercise)} is none; give a name, a .toml file or an Exercise")
    if exercise in OWN:
        return Exercise.read(FOLDER / f"{exercise}.toml"), FOLDER
    if exercise in SHIPPED_EXERCISES:
        return Exercise.shipped(str(exercise)), Path()
    path = Path(exercise)
    if path.suffix != ".toml":
        known = ", ".join((*OWN, *SHIPPED_EXERCISES))
        raise ValueError(f"exercise = {shown(exercise)} is not known; choose one of {known}, or give a .toml file")
    return Exercise.read(path), path.parent


@dataclass(frozen=True)
class _Asked:
    """A scene as an exercise has it, its files' folder, and nodes; equal where what would be made is."""

    digest: str
    folder: Path
    nodes: int
    spec: SceneFile = field(compare=False)

    @classmethod
    def by(cls, exercise: Exercise, folder: Path, nodes: int) -> _Asked:
        spec = exercise.scene_file(folder)
        beside = Path() if exercise.scene in SHIPPED else (folder / exercise.scene).parent
        return cls(digest_of_bytes(msgspec.json.encode(spec)), beside, nodes, spec)


@lru_cache(maxsize=4)  # the environments of a vector share it
def _scene(asked: _Asked) -> Scene:
    """Fields are drawn on as many nodes as they are solved on: no picture shows more than there is."""
    spec, nodes = asked.spec, asked.nodes
    tissue, model = replaced(spec.tissue, nodes=nodes), replaced(spec.model, solver_nodes=nodes)
    return make_scene(replaced(spec, tissue=tissue, model=model), folder=asked.folder)


@lru_cache(maxsize=8)
def _at_rest(asked: _Asked, model: str | None, pictures: bool) -> Session:
    """A session that nobody steps: copies of it share its models of tissue."""
    scene = _scene(asked)
    return Session(scene if pictures else without_pictures(scene), model=model)
