"""A session: needles and a probe in a scene's tissue, from poses in the world to a picture."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..models import registry
from ..models.contract import Response, TissueModel
from ..models.insertion import NEEDLE
from .command import ImageSettings
from .fold_check import folds
from .imaging import Imager, out_of_plane, tuned
from .poses import Needles, Poses, same
from .readouts import Readouts
from .scene import Scene
from .scene_file import SceneFile
from .scene_maker import make_scene
from .scene_model import scene_model
from .simulated_frame import SimulatedFrame

Array = NDArray[np.float64]


class _Answer(NamedTuple):
    """What the tissue answered, and as the picture shows it."""

    response: Response | None
    field: GridField
    folds: bool


class Session:
    """A scene that is worked on: push needles, move the probe, see the picture.

    Everything is in world coordinates (RAS, mm) and happens in :meth:`step`, in the caller's
    thread. Each step goes on from :attr:`last`, which holds the whole of the session's state: a
    step that fails raises and leaves it as it was, and :meth:`resume` goes back to any frame.
    A :class:`~sonospline.simulator.Console` has knobs instead of poses, as the page does.

    Parameters
    ----------
    scene : Scene, SceneFile, str or Path
        A scene made ready, one to be made, the name of a shipped one (``kidney``, ``gel``, ``cube``), or a file.
    model : str, optional
        How the tissue answers, of :func:`sonospline.models.names`; by default as the scene says.

    Raises
    ------
    ValueError
        A scene that cannot be read or made, or an unknown model.

    Examples
    --------
    >>> import sonospline as ss
    >>> session = ss.Session("gel", model="kelvinlet")
    >>> entry, vessel = (26, 30, 0), session.scene.targets["vessel"]
    >>> frame = session.step(needles={"needle": ss.Needle(entry, vessel)}, dt=1 / 60)
    >>> frame.image.pixels.dtype.name, round(frame.readouts.depth, 1), bool(frame.readouts.moved > 0.1)
    ('uint8', 41.6, True)
    >>> session.step(needles={}).readouts.moved
    0.0
    """

    def __init__(self, scene: Scene | SceneFile | str | Path = "kidney", *, model: str | None = None) -> None:
        self.scene = scene if isinstance(scene, Scene) else make_scene(scene)
        self.model = registry.spec(model or self.scene.spec.model.use).name
        """Which model answers; :meth:`switch` changes it."""
        self.target = next(iter(self.scene.targets))
        """What read-outs are about; :meth:`choose_target` changes it."""
        self.last: SimulatedFrame | None = None
        """The frame in force."""
        grid = self.scene.tissue.grid
        self.rest = GridField(grid, np.zeros((*grid.shape, 3), np.float32), error_estimate=0.0)
        """The field while no needle is in."""
        self._models: dict[str, TissueModel] = {}
        self._making = threading.Lock()
        self._imager: Imager | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_making"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _making=threading.Lock())

    def step(
        self,
        *,
        needles: Needles | None = None,
        probe_to_reference: ArrayLike | None = None,
        settings: ImageSettings | None = None,
        dt: float = 0.0,
    ) -> SimulatedFrame:
        """Bring the tissue to needles at their poses, some time later, and return the picture of it.

        What is not given stays as it is.

        Parameters
        ----------
        needles : mapping of str to Needle, optional
            Every needle in the tissue; none is a needle taken out. The picture shows the first.
        probe_to_reference : (4, 4) array_like, optional
            Pose of the probe: rigid, origin in the middle of its face, x to the right in the image, y deep.
        settings : ImageSettings, optional
            Gain, depth, frequency and focus.
        dt : float, default: 0
            Seconds since the last step; zero asks for the quasi-static answer.

        Raises
        ------
        ValueError
            A needle outside the tissue, a pose that is not rigid, settings beyond the scene's, a dt
            below zero or not finite, or several needles where the model knows one. Whatever a step
            raises, nothing has changed.
        """
        last, dt = self.last, _validate.number("dt", dt)
        poses = self._in_force().changed(self.scene, needles, probe_to_reference, settings)
        number = 0 if last is None else last.number + 1
        began = time.perf_counter()
        answer = self._answer(poses.needles, dt)
        answered = time.perf_counter()
        imager = self._aimed(poses)
        image = imager.render(answer.field, poses.needle, frame=number, gain_db=poses.settings.gain)
        rendered = time.perf_counter()
        rest, moved = self.scene.targets[self.target], self._target_moved(answer)
        self.last = SimulatedFrame(
            number=number, image=image, probe=imager.probe, probe_to_reference=imager.probe_to_reference,
            settings=poses.settings, needles=poses.needles, model=self.model, response=answer.response,
            field=answer.field, target=self.target, target_rest=rest, target_now=rest + moved,
            readouts=self._readouts(poses.needle, rest + moved, moved, imager, answer),
            step_ms=1e3 * (answered - began), render_ms=1e3 * (rendered - answered),
        )  # fmt: skip
        self._imager = imager
        return self.last

    def settle(
        self,
        *,
        needles: Needles | None = None,
        probe_to_reference: ArrayLike | None = None,
        settings: ImageSettings | None = None,
        most: int = 100,
    ) -> SimulatedFrame:
        """Step until the tissue has come to rest, and return the last frame."""
        frame = self.step(needles=needles, probe_to_reference=probe_to_reference, settings=settings)
        for _ in range(most):
            if frame.settled:
                break
            frame = self.step()
        return frame

    def resume(self, frame: SimulatedFrame | None) -> None:
        """Go on from a frame of this session, or a copy of it; from none, as at first."""
        if not isinstance(frame, SimulatedFrame | None):
            raise ValueError(f"frame = {shown(frame)} is not a SimulatedFrame; give one that step() returned")
        self.last = frame

    def switch(self, model: str) -> None:
        """Let another model answer, from the next step on; needles and probe stay where they are."""
        self.model = registry.spec(model).name

    def choose_target(self, name: str) -> None:
        """Aim for another target of the scene, from the next step on."""
        self.target = _validate.choice("target", name, self.scene.targets)

    def warm_up(self, needle: Needle | None = None) -> None:
        """Make what the first push will need, so that it does not wait for it; nothing changes.

        Unlike everything else this may be called in another thread while the session steps.

        Parameters
        ----------
        needle : Needle, optional
            One to try.
        """
        name, last = self.model, self.last
        if (last is not None and last.needles) or name in self._models:
            return
        with self._making:
            if name not in self._models:
                model = scene_model(self.scene, name)
                if needle is not None:
                    model.step(model.rest, {NEEDLE: needle})
                self._models[name] = model

    def _in_force(self) -> Poses:
        last = self.last
        if last is None:
            return Poses.at_start(self.scene)
        return Poses(last.needles, last.probe_to_reference, last.settings)

    def _answer(self, needles: Needles, dt: float) -> _Answer:
        """Let the tissue answer to needles; where it already has, and has come to rest, nothing is done."""
        last = self.last if self.last is not None and self.last.model == self.model else None
        before = None if last is None else last.response
        if before is None and not needles:
            return _Answer(None, self.rest, folds=False)
        if last is not None and before is not None and before.settled and same(last.needles, needles):
            return _Answer(before, last.field, last.readouts.folds)
        model = self._model(self.model)
        response = model.step(model.rest if before is None else before.state, needles, dt)
        if response.settled and not needles:
            return _Answer(None, self.rest, folds=False)
        field = GridField.of(response.field)
        return _Answer(response, field, any(folds(field, needle) for needle in needles.values()))

    def _model(self, name: str) -> TissueModel:
        with self._making:
            if name not in self._models:
                self._models[name] = scene_model(self.scene, name)
            return self._models[name]

    def _aimed(self, poses: Poses) -> Imager:
        imager, place = self._imager, poses.probe_to_reference
        probe = tuned(self.scene.probe, poses.settings)
        if imager is None:
            return self.scene.see(probe, place)
        return imager if imager.is_aimed(probe, place) else imager.aimed(probe, place)

    def _target_moved(self, answer: _Answer) -> Array:
        if answer.response is None:
            return np.zeros(3)
        return answer.response.field.displacement(self.scene.targets[self.target][None])[0]

    def _readouts(
        self, needle: Needle | None, target: Array, moved: Array, imager: Imager, answer: _Answer
    ) -> Readouts:
        away = half_slice = to_target = float("nan")
        if needle is not None:
            away, half_slice = out_of_plane(imager.probe, imager.probe_to_reference, needle.tip)
            to_target = float(np.linalg.norm(target - needle.tip))
        return Readouts(
            tip_to_target=to_target, depth=0.0 if needle is None else needle.depth, moved=float(np.linalg.norm(moved)),
            moved_parts=self.scene.frame.parts(moved), out_of_plane=away, half_slice=half_slice, folds=answer.folds,
            estimate=answer.field.error_estimate,
        )  # fmt: skip

    def __repr__(self) -> str:
        return f"Session({self.scene!r})"
