"""What a link sends, written down: StartRecording and StopRecording of PLUS's clients."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

from .. import igtl
from ..io.sequence_writer import SUFFIX, SequenceWriter
from .frame_messages import OK

logger = logging.getLogger(__name__)

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

    def start(self, name: str = "") -> str:
        """Begin a recording and return its file's name.

        Raises
        ------
        ValueError
            There is no folder, one is being written, or a name that is none in this folder.
        """
        if self._folder is None:
            raise ValueError("there is no folder for recordings; start sonospline link with --recordings FOLDER")
        name = name or f"TrackedSequence_{datetime.now():%Y%m%d_%H%M%S}{SUFFIX}"
        if not _NAME.fullmatch(name):
            raise ValueError("OutputFilename is no plain name; give one without folders, as hand.igs.mha")
        name = name if name.endswith(SUFFIX) else f"{name.split('.')[0]}{SUFFIX}"
        with self._lock:
            if self._writer is not None:
                raise ValueError(f"{self._writer.path.name} is being recorded; stop it first")
            self._writer = SequenceWriter(self._folder / name, orientation=self._orientation)
        return name

    def stop(self) -> tuple[str, int]:
        """End the recording; return its file's name and how many frames it has; ValueError where there is none."""
        with self._lock:
            writer, self._writer = self._writer, None
        if writer is None:
            raise ValueError("nothing is being recorded; start it first")
        try:
            writer.close()
        except OSError as error:
            raise ValueError(f"{writer.path.name} could not be written: {error}") from None
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
        """End what is being recorded."""
        if self._writer is not None:
            try:
                self.stop()
            except ValueError as error:  # nobody asks for it any more
                logger.warning("%s", error)
