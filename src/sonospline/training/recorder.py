"""Write down a session as it goes: one MCAP file, which a kill leaves readable up to the last second."""

from __future__ import annotations

import time
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec

from .. import _core
from .._digest import digest
from .._extras import require
from ..io.records import schema
from ..simulator.scene import Scene
from ..simulator.simulated_frame import SimulatedFrame
from .step import Step, made_whole, step_of
from .trace import Sample

FORMAT = "2"
"""Of recordings."""
READ_FORMATS = ("1", FORMAT)
"""Others are refused; in 1 every step has its time."""
HEADER, STEPS = "sonospline", "/steps"
_KEPT_S = 0.5
"""Of the clock, that is lost at most when the process is killed."""
_NANO = 1e9


class Recorder:
    """Writes every step of a session into a file.

    Parameters
    ----------
    path : str or Path
        A new ``.mcap`` file; one that is there is not written over.
    scene : Scene
        The session's.
    about : mapping of str to str, optional
        What else the header is to say: an exercise, a seed. Names of the header's own are not written over.

    Raises
    ------
    FileExistsError, OSError
        The file is there already, or cannot be written.
    MissingExtraError
        ``mcap`` is not installed: ``pip install 'sonospline[record]'``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import sonospline as ss
    >>> from sonospline.training import Recorder, Recording, replay
    >>> session = ss.Session("cube", model="kelvinlet")
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "one.mcap"
    >>> with Recorder(path, session.scene) as recorder:
    ...     recorder.add(session.step())
    ...     recorder.add(session.step(needles={"needle": ss.Needle((50, 50, 0), (50, 50, 30))}, dt=1 / 60))
    >>> recording = Recording.read(path)
    >>> recording, [replayed.same for replayed in replay(recording, session.scene)]
    (Recording("The paper's cube", 2 steps, 0.01667 s), [True, True])
    """

    def __init__(self, path: str | PathLike[str], scene: Scene, *, about: Mapping[str, str] | None = None) -> None:
        mcap = require("mcap.writer")
        self.path, self.scene = Path(path), scene
        self._stream = self.path.open("xb")
        self._writer: Any = mcap.Writer(self._stream, chunk_size=2**30, enable_data_crcs=True)
        self._last: Step | None = None
        self._count = self._highest = 0
        self._began = self._kept = time.monotonic()
        self._writer.start("sonospline", f"sonospline {version('sonospline')}")
        self._writer.add_metadata(HEADER, {**(about or {}), **header(scene)})
        shape = self._writer.register_schema("sonospline.Step", "jsonschema", msgspec.json.encode(schema(Step)))
        self._channel = self._writer.register_channel(STEPS, "json", shape)
        self._keep()

    def add(self, frame: SimulatedFrame) -> None:
        """Write down the step that made a frame.

        Raises
        ------
        OSError
            The disk is full or gone: the file holds what was kept before.
        ValueError
            The recorder is closed, or this is not the session's first step and the one before was not recorded.
        """
        if self._stream.closed:
            raise ValueError(f"{self.path.name} is closed; make another Recorder")
        if frame.number > self._highest:
            raise ValueError(
                f"frame {frame.number} goes on from one that was not recorded; begin with a session's first step"
            )
        before = self._last if self._last is not None and self._last.number == frame.number - 1 else None
        step = step_of(frame, Sample.of(frame, self.scene), before)
        now = time.monotonic()
        stamp = int(_NANO * (now - self._began))
        self._writer.add_message(self._channel, stamp, msgspec.json.encode(step), stamp, frame.number)
        self._last, self._count = made_whole(step, before), self._count + 1
        self._highest = max(self._highest, frame.number + 1)
        if now - self._kept >= _KEPT_S:
            self._keep()

    @property
    def count(self) -> int:
        """Steps that were written down."""
        return self._count

    def close(self) -> None:
        """End the file with its index; a second time does nothing."""
        if not self._stream.closed:
            try:
                self._writer.finish()
            finally:
                self._stream.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _keep(self) -> None:
        """Put what was written so far where a kill does not reach it: the library ends chunks by their size alone."""
        self._writer._Writer__finalize_chunk()
        self._stream.flush()
        self._kept = time.monotonic()

    def __repr__(self) -> str:
        return f"Recorder({self.path.name!r}, {self._count} steps)"


def header(scene: Scene) -> dict[str, str]:
    """Return what a replay has to share with a recording."""
    return {
        "format": FORMAT, "version": version("sonospline"), "backend": _core.backend(),
        "instruction_set": _core.instruction_set() or "", "scene": scene.spec.name, "scene_hash": scene_hash(scene),
        "began": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip


def scene_hash(scene: Scene) -> str:
    """Return a short text that scenes of one file, of the same labels, share."""
    labels = None if scene.tissues is None else scene.tissues.labels.voxels
    return digest(msgspec.json.encode(scene.spec).decode(), labels)
