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
from ..contact.events import Held, Touched
from ..contact.turning import between, is_along
from ..elasticity.carried import both, composed, needles_at_rest
from ..elasticity.pressed_tissue import PressedTissue
from ..elasticity.solver import ElasticSolver
from ..fields.carried_field import CarriedField
from ..fields.fold_check import folds
from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..mechanics.bone_stop import Blocked, stopped
from ..mechanics.breath import Breath
from ..models import registry
from ..models.contract import Response, TissueModel
from ..models.insertion import NEEDLE
from .command import ImageSettings
from .imaging import Imager, out_of_plane, tuned
from .moving_tissue import MovingTissue
from .poses import Needles, Poses, same
from .readouts import HubForce, Readouts
from .scene import Scene
from .scene_file import SceneFile
from .scene_maker import make_scene
from .scene_model import scene_model
from .scene_motion import pressed_tissue
from .simulated_frame import SimulatedFrame
from .tissue_settings import TissueSettings

Array = NDArray[np.float64]


class _Answer(NamedTuple):
    """What the tissue answered to needles, and as the picture shows it."""

    response: Response | None
    field: GridField
    folds: bool


class _Moving(NamedTuple):
    """Tissue without needles, as breath and probe move it."""

    field: GridField | None
    excursion_mm: float
    probe_n: float | None


class _Kind(NamedTuple):
    """Which of the scene's models answers."""

    name: str
    contact: str
    relaxation: str


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
        self.targets = dict(self.scene.targets)
        """Places to aim for, at rest: the scene's, and those that :meth:`choose_target` was given."""
        self.target = next(iter(self.targets))
        """What read-outs are about; :meth:`choose_target` changes it."""
        self.last: SimulatedFrame | None = None
        """The frame in force."""
        grid = self.scene.tissue.grid
        self.rest = GridField(grid, np.zeros((*grid.shape, 3), np.float32), error_estimate=0.0)
        """The field while no needle is in."""
        self._models: dict[_Kind, TissueModel] = {}
        self._moving: MovingTissue | None = None
        self._pressed: PressedTissue | None = None
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
        tissue: TissueSettings | None = None,
        dt: float = 0.0,
    ) -> SimulatedFrame:
        """Bring the tissue to needles at their poses, some time later, and return the picture of it.

        What is not given stays as it is. A needle that meets bone ends there, whatever the model knows of bone, and one
        that leaves a track turns as far as tissue holds it not: the frame's events say so.

        Parameters
        ----------
        needles : mapping of str to Needle, optional
            Every needle in the tissue; none is a needle taken out. The picture shows the first.
        probe_to_reference : (4, 4) array_like, optional
            Pose of the probe: rigid, origin in the middle of its face, x to the right in the image, y deep.
        settings : ImageSettings, optional
            Gain, depth, frequency and focus.
        tissue : TissueSettings, optional
            Whether needles leave tracks, whether tissue relaxes, whether somebody breathes and whether the probe dents
            the skin, as deep as its pose is below it. Models without ``"time"`` heed none of it; who chooses another
            contact or relaxation begins with the needle put in anew.
        dt : float, default: 0
            Seconds since the last step; zero asks for the quasi-static answer.

        Raises
        ------
        ValueError
            A needle outside the tissue or with its entry in bone, a pose that is not rigid, a probe that presses beside
            the skin or deeper than a third of the tissue, settings beyond the scene's, breathing in a scene that has no
            part for it, a dt below zero or not finite, or several needles where the model knows one. Whatever a step
            raises, nothing has changed.
        """
        last, dt = self.last, _validate.number("dt", dt)
        poses = self._in_force().changed(self.scene, needles, probe_to_reference, settings, tissue)
        inside, rests = stopped(poses.needles, self.scene.tissues, None if last is None else last.field)
        poses = poses._replace(needles=dict(inside))
        number, now = (0, dt) if last is None else (last.number + 1, last.time_s + dt)
        began = time.perf_counter()
        breath = self._breath(poses.tissue, now)
        moving = self._without_needles(poses, breath, now)
        needles, held = self._turned(poses, moving)
        poses = poses._replace(needles=needles)
        undeformed = needles_at_rest(moving.field, needles)
        answer = self._answer(undeformed, poses.tissue, dt)
        field = composed(answer.field, moving.field)
        answered = time.perf_counter()
        imager = self._aimed(poses)
        image = imager.render(field, poses.needle, frame=number, settings=poses.settings, time_s=now)
        rendered = time.perf_counter()
        rest, moved = self.targets[self.target], self._target_moved(answer, moving.field)
        self.last = SimulatedFrame(
            number=number, time_s=now, dt=dt, image=image, probe=imager.probe,
            probe_to_reference=imager.probe_to_reference,
            settings=poses.settings, tissue=poses.tissue, needles=poses.needles, undeformed=undeformed,
            model=self.model, response=answer.response, events=(*held, *_events(rests, answer.response, last)),
            field=field, by_needles=answer.field, breath=breath,
            target=self.target, target_rest=rest, target_now=rest + moved,
            readouts=self._readouts(poses.needle, rest + moved, moved, imager, answer, moving),
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
        tissue: TissueSettings | None = None,
        most: int = 100,
    ) -> SimulatedFrame:
        """Step until the tissue has come to rest, with no time passing, and return the last frame."""
        frame = self.step(needles=needles, probe_to_reference=probe_to_reference, settings=settings, tissue=tissue)
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

    def choose_target(self, name: str, at: ArrayLike | None = None) -> None:
        """Aim for another target, from the next step on; with ``at`` for a place of your own in undeformed tissue.

        Raises
        ------
        ValueError
            A name that is not known, or a place outside the tissue.
        """
        if at is not None:
            place = _validate.vector("at", at)
            self.scene.tissue.check_inside(at=place)
            self.targets[name] = place
        self.target = _validate.choice("target", name, self.targets)

    def warm_up(self, needle: Needle | None = None) -> None:
        """Make what the first push will need, so that it does not wait for it; nothing changes.

        Unlike everything else this may be called in another thread while the session steps.

        Parameters
        ----------
        needle : Needle, optional
            One to try.
        """
        last, kind = self.last, self._kind(self.model, self._in_force().tissue)
        if (last is not None and last.needles) or kind in self._models:
            return
        with self._making:
            if kind not in self._models:
                model = self._made(kind)
                if needle is not None:
                    model.step(model.rest, {NEEDLE: needle})
                self._models[kind] = model

    def _in_force(self) -> Poses:
        last = self.last
        if last is None:
            return Poses.at_start(self.scene)
        return Poses(last.needles, last.probe_to_reference, last.settings, last.tissue)

    def _answer(self, needles: Needles, tissue: TissueSettings, dt: float) -> _Answer:
        """Let the tissue answer to needles; where it already has, and has come to rest, nothing is done."""
        kind, last = self._kind(self.model, tissue), self.last
        if last is not None and self._kind(last.model, last.tissue) != kind:
            last = None
        before = None if last is None else last.response
        if before is None and not needles:
            return _Answer(None, self.rest, folds=False)
        if last is not None and before is not None and before.settled and same(last.undeformed, needles):
            return _Answer(before, last.by_needles, last.readouts.folds)
        model = self._model(kind)
        response = model.step(model.rest if before is None else before.state, needles, dt)
        if response.settled and not needles:
            return _Answer(None, self.rest, folds=False)
        field = GridField.of(response.field)
        return _Answer(response, field, any(folds(field, needle) for needle in needles.values()))

    def _turned(self, poses: Poses, moving: _Moving) -> tuple[Needles, tuple[Held, ...]]:
        """Needles that turn as far as the tissue beside their tracks lets them, and what holds the others."""
        last, kind, found, events = self.last, self._kind(self.model, poses.tissue), dict(poses.needles), []
        goes_on = last is not None and self._kind(last.model, last.tissue) == kind
        if last is None or last.response is None or not goes_on or kind.contact == "pose":
            return found, ()
        model, state = self._model(kind), last.response.state
        for name, asked in poses.needles.items():
            before = last.needles.get(name)
            if before is None or is_along(before, asked):
                continue
            ends = needles_at_rest(moving.field, {"before": before, "asked": asked})
            held = model.held(state, name, ends["before"], ends["asked"]) if len(ends) == 2 else None
            if held is not None:
                found[name] = between(before, asked, held.share)
                events.append(held)
        return found, tuple(events)

    def _kind(self, name: str, tissue: TissueSettings) -> _Kind:
        return _Kind(name, tissue.contact, tissue.relaxation) if knows_time(name) else _Kind(name, "pose", "none")

    def _model(self, kind: _Kind) -> TissueModel:
        with self._making:
            if kind not in self._models:
                self._models[kind] = self._made(kind)
            return self._models[kind]

    def _made(self, kind: _Kind) -> TissueModel:
        return scene_model(self.scene, kind.name, contact=kind.contact, relaxation=kind.relaxation)

    def _breath(self, tissue: TissueSettings, now: float) -> Breath | None:
        """The breath in force, as the switches have it go on; nobody breathes under models without time."""
        if not knows_time(self.model):
            return None
        breath = None if self.last is None else self.last.breath
        if breath is None and tissue.breathing != "none":
            breath = Breath(self._breathing(tissue).breathing, now)
        return None if breath is None else breath.asked(tissue.breathing, now)

    def _without_needles(self, poses: Poses, breath: Breath | None, now: float) -> _Moving:
        """Where tissue is whatever the needles do; models without time know of neither breath nor probe."""
        excursion = 0.0 if breath is None else breath.excursion_mm(now)
        breathed = None if breath is None else self._breathing(poses.tissue).at(excursion)
        if poses.tissue.probe == "looks" or not knows_time(self.model):
            return _Moving(breathed, excursion, None)
        pressed = self._pressing(poses.tissue).at(poses.probe_to_reference)
        return _Moving(both(breathed, pressed.field), excursion, pressed.force_n)

    def _breathing(self, tissue: TissueSettings) -> MovingTissue:
        """How the scene's tissue breathes, made when first asked for, on the nodes of its elastic model."""
        if self._moving is None:
            self._moving = MovingTissue.of(self.scene, self._solver(tissue))
        return self._moving

    def _pressing(self, tissue: TissueSettings) -> PressedTissue:
        """How the probe dents the scene's tissue, made when first asked for."""
        if self._pressed is None:
            self._pressed = pressed_tissue(self.scene, self._solver(tissue))
        return self._pressed

    def _solver(self, tissue: TissueSettings) -> ElasticSolver:
        """That of the scene's elastic models, which share it; of the one that answers, where none is made yet."""
        from ..models.elastic.model import ElasticModel

        models = [model for model in tuple(self._models.values()) if isinstance(model, ElasticModel)]
        model = models[0] if models else self._model(self._kind("elastic", tissue))
        assert isinstance(model, ElasticModel)
        return model.solver

    def _aimed(self, poses: Poses) -> Imager:
        imager, place = self._imager, poses.probe_to_reference
        probe = tuned(self.scene.probe, poses.settings)
        if imager is None:
            return self.scene.see(probe, place)
        return imager if imager.is_aimed(probe, place) else imager.aimed(probe, place)

    def _target_moved(self, answer: _Answer, background: GridField | None) -> Array:
        """By the model's own field, and then by the background's."""
        by_needles = answer.field if answer.response is None else answer.response.field
        field = by_needles if background is None else CarriedField(by_needles, background)
        return field.displacement(self.targets[self.target][None])[0]

    def _readouts(
        self, needle: Needle | None, target: Array, moved: Array, imager: Imager, answer: _Answer, moving: _Moving
    ) -> Readouts:
        away = half_slice = to_target = float("nan")
        if needle is not None:
            away, half_slice = out_of_plane(imager.probe, imager.probe_to_reference, needle.tip)
            to_target = float(np.linalg.norm(target - needle.tip))
        return Readouts(
            tip_to_target=to_target, depth=0.0 if needle is None else needle.depth, moved=float(np.linalg.norm(moved)),
            moved_parts=self.scene.frame.parts(moved), out_of_plane=away, half_slice=half_slice, folds=answer.folds,
            estimate=answer.field.error_estimate, excursion=moving.excursion_mm,
            hub=self._felt(answer.response), probe_n=moving.probe_n,
        )  # fmt: skip

    def _felt(self, response: Response | None) -> HubForce | None:
        """What the hand feels of the needle that is shown."""
        if "forces" not in registry.spec(self.model).capabilities:
            return None
        if response is None or not response.forces:
            return HubForce()
        name, force = next(iter(response.forces.items()))
        needle = dict(response.state.needles)[name]
        return HubForce.of(force, needle, self.scene.spec.needle.length_mm)

    def __repr__(self) -> str:
        return f"Session({self.scene!r})"


def knows_time(model: str) -> bool:
    """Whether seconds matter to a model of the registry."""
    return "time" in registry.spec(model).capabilities


def _events(rests: tuple[Blocked, ...], response: Response | None, last: SimulatedFrame | None) -> tuple[object, ...]:
    """Which needles rest on bone, and have just come to, and what else the model says: of bone the scene knows more."""
    before = {(event.needle, event.by) for event in (() if last is None else last.events) if isinstance(event, Blocked)}
    touched = [Touched(rest.needle, rest.by) for rest in rests if (rest.needle, rest.by) not in before]
    fresh = response is not None and (last is None or response is not last.response)
    said = response.events if response is not None and fresh else ()
    return (*rests, *touched, *(event for event in said if not isinstance(event, Blocked)))
