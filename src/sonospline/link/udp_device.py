"""A device behind UDP: 56 bytes in, 32 bytes back. docs/forces.md has the format."""

from __future__ import annotations

import logging
import socket
import struct
from typing import Any

from .. import _validate
from .device import NO_FORCE, WAIT_S, DeviceLimits, DeviceState, Vector, local_host

logger = logging.getLogger(__name__)

MAGIC = b"SFD1"
STATE, FORCE = struct.Struct("<4sI6d"), struct.Struct("<4sI3d")
"""Magic, number of the message, position in mm and velocity in mm/s; magic, number that is answered, force in N."""
_HALF = 1 << 31


class UdpDevice:
    """Whoever sends a hand's states to a port of this machine, and takes forces back.

    The first sender has the needle; what others send is left out, with one line in the log. Messages that come out of
    order, are of another length or begin otherwise are left out.

    Parameters
    ----------
    port : int, default: 18950
        0 takes a free one: see :attr:`port`.
    host : str, default: "127.0.0.1"
        An address of this machine.
    force_n : float, default: 3.0
        The device's most (assumed).

    Raises
    ------
    ValueError
        A host elsewhere, a port out of range.
    OSError
        The port is taken.

    Examples
    --------
    >>> from sonospline.link import UdpDevice
    >>> device = UdpDevice(port=0)
    >>> device.read() is None  # nobody is there
    True
    >>> device.close()
    """

    def __init__(self, port: int = 18950, *, host: str = "127.0.0.1", force_n: float = 3.0) -> None:
        wanted = _validate.count("port", port, least=0, most=65535)
        family = socket.AF_INET6 if ":" in local_host("host", host) else socket.AF_INET
        self.limits, self._seen = DeviceLimits(force_n), -1
        self._peer: Any = None
        self._strangers: set[Any] = set()
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, wanted))
        except OSError as error:
            self._socket.close()
            raise OSError(f"port = {wanted} on {host} is taken: {error.strerror}; give another one") from None
        self._socket.settimeout(WAIT_S)
        self.port: int = self._socket.getsockname()[1]
        self.name = f"udp {host}:{self.port}"

    def read(self) -> DeviceState | None:
        """Return the newest state of all that came."""
        state = self._receive()
        self._socket.setblocking(False)
        try:
            while (newer := self._receive()) is not None:
                state = newer
        finally:
            if self._socket.fileno() >= 0:
                self._socket.settimeout(WAIT_S)
        return state

    def write(self, force_n: Vector) -> None:
        """Answer the newest state."""
        if self._peer is not None:
            self._socket.sendto(FORCE.pack(MAGIC, self._seen & 0xFFFFFFFF, *force_n), self._peer)

    def close(self) -> None:
        """Send a last force of nothing, and let the port go."""
        if self._socket.fileno() >= 0:
            self.write(NO_FORCE)
            self._socket.close()

    def __repr__(self) -> str:
        return f"UdpDevice({self.name}, at most {self.limits.force_n:.4g} N)"

    def _receive(self) -> DeviceState | None:
        try:
            message, sender = self._socket.recvfrom(1024)
        except (TimeoutError, BlockingIOError, ConnectionError):
            return None
        if len(message) != STATE.size or message[:4] != MAGIC:
            return None
        if self._peer is None:
            self._peer = sender
        if sender != self._peer:
            self._refuse(sender)
            return None
        _, number, *values = STATE.unpack(message)
        if self._seen >= 0 and not 0 < (number - self._seen) % (2 * _HALF) < _HALF:
            return None
        self._seen = number
        x, y, z, vx, vy, vz = values
        return DeviceState((x, y, z), (vx, vy, vz))

    def _refuse(self, sender: Any) -> None:
        if sender not in self._strangers and len(self._strangers) < 16:
            self._strangers.add(sender)
            logger.warning("%s: %s comes second, the needle is in the hand of %s", self.name, sender, self._peer)
