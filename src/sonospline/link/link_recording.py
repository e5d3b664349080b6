"""What a link sends, written down: StartRecording and StopRecording of PLUS's clients."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from .. import igtl
from ..io.sequence_writer import SUFFIX, SequenceWriter
from .frame_messages import OK

logger = logging.getLogger(__name__)

Said = TypeVar("Said")

_NAME = re.compile(r"[\w][\w. -]{0,99}", re.ASCII)


class LinkRecording:
    """Recordings in one folder, one at a time, with image and poses as they are sent.

    Parameters
    ----------
    folder : Path, optional
        Without one, nothing can be recorded.
    orientation : str
        Of the images.
    """

    def __init__(self, folder: Path | None, orientation: str) -> None:
        self._folder, self._orientation = folder, orientation
        self._lock = threading.Lock()
        self._writer: SequenceWriter | None = None
        self._finisher = ThreadPoolExecutor(1, "recording")
        self._finishing: set[str] = set()

    def start(self, name: str = "") -> str:
        """Begin a recording and return its file's name.

        Raises
        ------
        ValueError
            There is no folder, one is being written, or a name that is none in this folder.
        """
        name = name or f"TrackedSequence_{datetime.now():%Y%m%d_%H%M%S}{SUFFIX}"
        path = self.place(name if name.endswith(SUFFIX) else f"{name.split('.')[0]}{SUFFIX}")
        with self._lock:
            if self._writer is not None:
                raise ValueError(f"{self._writer.path.name} is being recorded; stop it first")
            if path.name in self._finishing:
                raise ValueError(f"{path.name} is still being written; give another name")
            self._writer = SequenceWriter(path, orientation=self._orientation)
        return path.name

    def place(self, name: str) -> Path:
        """Return where a new file goes; ValueError where there is no folder, no plain name, or such a file already."""
        if self._folder is None:
            raise ValueError("there is no folder for recordings; start sonospline link with --recordings FOLDER")
        if not _NAME.fullmatch(name):
            raise ValueError("the file has no plain name; give one without folders, as hand.igs.mha")
        if (self._folder / name).exists():
            raise ValueError(f"{name} is there already; give a new name")
        return self._folder / name

    def stop(self, said: Callable[[str, int], Said]) -> Future[Said]:
        """End the recording, and have its file written by a thread of its own: it may have gigabytes.

        Parameters
        ----------
        said : callable
            What its result is made by once the file is there, of the file's name and how many frames it has.

        Raises
        ------
        ValueError
            There is none. The future raises it where the file could not be written.
        """
        with self._lock:
            writer, self._writer = self._writer, None
            if writer is None:
                raise ValueError("nothing is being recorded; start it first")
            self._finishing.add(writer.path.name)
        return self._finisher.submit(lambda: said(*self._finish(writer)))

    def _finish(self, writer: SequenceWriter) -> tuple[str, int]:
        try:
            writer.close()
        except OSError as error:
            raise ValueError(f"{writer.path.name} could not be written: {error.strerror or error}") from None
        finally:
            with self._lock:
                self._finishing.discard(writer.path.name)
        return writer.path.name, writer.frames

    def add(self, messages: Iterable[igtl.Message]) -> None:
        """Take what is sent of a frame; ValueError or OSError where it cannot be kept."""
        with self._lock:
            if self._writer is None:
                return
            found = list(messages)
            image, stamp = next((one.content, one.stamp) for one in found if isinstance(one.content, igtl.Image))
            poses = {
                one.device: (one.content.matrix, one.metadata.get("Status", OK) == OK)
                for one in found
                if isinstance(one.content, igtl.Transform)
            }
            reference = next(iter(poses)).rpartition("To")[2]
            placed = {f"ImageTo{reference}": (image.ijk_to_reference, True), **poses}
            self._writer.add(image.voxels[0], igtl.seconds_of(stamp), placed)

    def close(self) -> None:
        """End what is being recorded, and wait until it is written."""
        last = self.stop(lambda name, frames: name) if self._writer is not None else None
        self._finisher.shutdown()
        if last is not None and (error := last.exception()) is not None:  # nobody asks for it any more
            logger.warning("%s", error)
