"""The deformed surfaces of a scene as POLYDATA, no more often than a client can draw them."""

from __future__ import annotations

import logging
import threading
import time

import numpy as np

from .. import igtl
from ..fields.field import Field
from ..simulator.scene import Scene
from .coordinate_frames import CoordinateFrames
from .scanner_names import LONGEST_NAME

logger = logging.getLogger(__name__)


class MeshMessages:
    """Makes POLYDATA of a scene's surfaces; the surfaces themselves are made in a thread of their own when first asked.

    Parameters
    ----------
    scene : Scene
    frames : CoordinateFrames
        Points go out in its reference; its names say how often.
    """

    def __init__(self, scene: Scene, frames: CoordinateFrames) -> None:
        self._scene, self._frames = scene, frames
        rate = frames.names.MeshRate
        self._apart_s, self._due = 1 / rate if rate else np.inf, 0.0 if rate else np.inf
        self._ready = threading.Event()
        self._making: threading.Thread | None = None
        self._sent: set[str] = set()

    def of(self, field: Field, stamp: int) -> list[igtl.Message]:
        """Return the surfaces as a field deforms them; nothing where it is too early."""
        now = time.monotonic()
        if now < self._due:
            return []
        if not self._ready.is_set():
            self._prepare()
            return []
        self._due = (self._due if now - self._due < self._apart_s else now) + self._apart_s
        return self.made(field, stamp)

    def made(self, field: Field, stamp: int) -> list[igtl.Message]:
        """Return the surfaces as a field deforms them, with how far each point has moved, mm."""
        surfaces = [mesh for mesh in self._scene.meshes if mesh.kind == "surface"]
        deformed, messages, first, taken = self._scene.deformed(field, grid=False), [], 0, set[str]()
        for mesh in surfaces:
            points = deformed[first : first + len(mesh.points)]
            first += len(mesh.points)
            moved = igtl.Attribute("moved_mm", np.linalg.norm(points - mesh.points, axis=1))
            name = device_name(mesh.name, taken)
            content = igtl.PolyData(
                self._frames.points(points).astype(np.float32), polygons=mesh.indices, attributes=(moved,)
            )
            messages.append(igtl.Message(content, name, stamp))
        self._sent |= taken
        return messages

    def gone(self) -> list[igtl.Message]:
        """Return empty surfaces of every name that was sent: clients keep what they hear no more of."""
        return [
            igtl.Message(igtl.PolyData(np.empty((0, 3), np.float32)), name, igtl.now()) for name in sorted(self._sent)
        ]

    def _prepare(self) -> None:
        if self._making is None:
            self._making = threading.Thread(target=self._make, name="meshes", daemon=True)
            self._making.start()

    def _make(self) -> None:
        try:
            self._scene.meshes  # noqa: B018  (made when first asked for)
        except Exception as error:  # of libraries that may be absent: the link goes on without meshes
            logger.warning("no meshes are sent: %s", error)
            self._due = np.inf
        else:
            self._ready.set()


def device_name(text: str, taken: set[str]) -> str:
    """Return a name of at most 20 bytes that was not taken before, and take it.

    Examples
    --------
    >>> from sonospline.link.mesh_messages import device_name
    >>> taken = set()
    >>> [device_name(name, taken) for name in ("pelvicalyceal system", "pelvicalyceal system 2", "skin")]
    ['pelvicalyceal system', 'pelvicalyceal syst_1', 'skin']
    """
    name, number = _short(text, LONGEST_NAME), 0
    while name in taken:
        number += 1
        ending = f"_{number}"
        name = _short(text, LONGEST_NAME - len(ending)) + ending
    taken.add(name)
    return name


def _short(text: str, most: int) -> str:
    return text.encode()[:most].decode(errors="ignore")
