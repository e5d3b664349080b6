"""A tracker that is listened to, as a file describes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .. import igtl
from ..tracking.link_client import LinkClient
from .scanner_names import TrackerDevice

_EVERY_MS = 10
"""How often poses are asked for where they come together."""
_MM = 1000.0


class Tracker:
    """Listens to a :class:`TrackerDevice`; its places come in mm, whatever it sends.

    Parameters
    ----------
    device : TrackerDevice
    take : callable
        Called as ``take(message, id)``.
    """

    def __init__(self, device: TrackerDevice, take: Callable[[igtl.Message, str], object]) -> None:
        self.device, self._take = device, take
        together = device.MessageType != "TRANSFORM"
        asks = [igtl.Message(igtl.Start(device.MessageType, _EVERY_MS))] if together else []
        self.client = LinkClient(
            device.ServerAddress, device.ServerPort, self._receive, version=device.HeaderVersion, says=asks,
            reads=("TRANSFORM", "POSITION", "QTRANS", "TDATA", "QTDATA", "POINT"),
        )  # fmt: skip

    def close(self) -> None:
        """Hang up."""
        self.client.close()

    def _receive(self, message: igtl.Message) -> None:
        self._take(in_mm(message) if self.device.Unit == "m" else message, self.device.Id)

    def __repr__(self) -> str:
        return f"Tracker({self.device.Id}, {self.client!r})"


def in_mm(message: igtl.Message) -> igtl.Message:
    """Return a message of poses in metres with them in millimetres."""
    match message.content:
        case igtl.TrackingData() | igtl.QuaternionTrackingData() as several:
            tools = tuple(igtl.Tool(tool.name, _scaled(tool.matrix)) for tool in several.tools)
            return replace(message, content=igtl.TrackingData(tools))
        case igtl.Transform() | igtl.Position() | igtl.QuaternionTransform() as pose:
            return replace(message, content=igtl.Transform(_scaled(pose.matrix)))
    return message


def _scaled(
    matrix: np.ndarray[tuple[int, ...], np.dtype[np.floating]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.floating]]:
    scaled = np.array(matrix)
    scaled[:3, 3] *= _MM
    return scaled
