"""Makes a scene ready, from its file or its name."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from ..geometry.tissue import Tissue
from .command import Command
from .knobs import Circumstances, Knobs, start
from .scene import Scene
from .scene_content import Progress, read_content
from .scene_file import SceneFile
from .scene_meshes import scene_meshes
from .scene_view import probe_of
from .skin_frame import SkinFrame
from .tissue_settings import TissueSettings


def make_scene(scene: SceneFile | str | Path, *, folder: Path | None = None, progress: Progress | None = None) -> Scene:
    """Return a scene made ready.

    Parameters
    ----------
    scene : SceneFile, str or Path
        The scene, the name of a shipped one (``kidney``, ``kidney-wide``, ``gel``, ``cube``), or a TOML file.
    folder : Path, optional
        Where the files it names are; by default beside the scene's file, else here.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    ValueError
        A scene that cannot be read or made.

    Examples
    --------
    >>> from sonospline.simulator import make_scene
    >>> scene = make_scene("cube")
    >>> scene.frame.depth.tolist(), list(scene.targets)
    ([1.0, 0.0, 0.0], ['end of the path'])
    """
    spec, beside = _read(scene)
    return _made(spec, beside if folder is None else folder, progress or (lambda share: None))


def _read(scene: SceneFile | str | Path) -> tuple[SceneFile, Path]:
    """A scene as it is written, and the folder its files are seen from."""
    if isinstance(scene, SceneFile):
        return scene, Path()
    if isinstance(scene, str) and not scene.endswith(".toml"):
        return SceneFile.shipped(scene), Path()
    return SceneFile.read(scene), Path(scene).parent


def _made(spec: SceneFile, folder: Path, progress: Progress) -> Scene:
    progress(0.05)
    content = read_content(spec, folder, progress)
    progress(0.7)
    tissue = Tissue(content.grid, entry_face=spec.tissue.entry_face)
    frame = SkinFrame.on_face(content.grid, spec.tissue.entry_face, at=spec.probe.at, right=spec.probe.right)
    targets = {part.name: np.array(part.at) for part in spec.targets} or dict(content.targets)
    tissue.check_inside(**{f"target {name!r}": at for name, at in targets.items()})
    probe = probe_of(spec.probe, artefacts=spec.display.artefacts)
    along, across = frame.sides(content.grid)
    deep = float(np.abs(frame.depth @ content.grid.direction) @ content.grid.extent)
    circumstances = Circumstances(spec, probe, along, across, deep, synthetic=content.phantom is not None)
    knobs = Knobs.of(Command, circumstances)
    first = replace(start(Command, circumstances), tissue=_tissue_settings(spec))
    knobs.check(first)
    progress(0.9)
    return Scene(
        spec=spec, tissue=tissue, frame=frame, tissues=content.tissues, see=content.see, probe=probe, targets=targets,
        start=first, knobs=knobs, undented=content.undented, draw=partial(scene_meshes, spec, content, frame),
        flows=content.phantom is not None and bool(content.phantom.flows) and probe.kind != "phased",
        prepare=_nothing if content.phantom is None else content.phantom.prepare,
    )  # fmt: skip


def _tissue_settings(spec: SceneFile) -> TissueSettings:
    breathes = spec.breathing is not None and spec.breathing.breathes
    return TissueSettings(
        contact=spec.model.contact,
        relaxation=spec.model.relaxation,
        breathing="free" if breathes else "none",
        probe="presses" if spec.probe.presses else "looks",
    )


def _nothing() -> None:
    pass
