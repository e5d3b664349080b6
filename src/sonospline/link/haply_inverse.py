"""Haply's Inverse3 by its Inverse Service: JSON through a WebSocket of this machine; no SDK."""

from __future__ import annotations

import json
import math
from contextlib import ExitStack
from typing import Any
from urllib.parse import urlsplit

from .._extras import require
from .._shown import shown
from .device import NO_FORCE, WAIT_S, DeviceLimits, DeviceState, Vector, local_host

_MOST_BYTES = 1 << 20
_OPENING_S = 2.0


class HaplyInverse:
    """An Inverse3, as its service (JSON of version 3.1 and later) has it.

    The service says a first message with each device's ``device_id`` and ``config``, and from then on a state for each
    command that it is sent: a force of zero is a command, too, and keeps the states coming. Positions are metres there
    and mm here, from the device's base, whose axes are taken for the world's: x to the right, y to the front, z up.

    Parameters
    ----------
    address : str, default: "ws://127.0.0.1:10001"
    device_id : str, optional
        Which one, where there are several.
    force_n : float, default: 3.0
        The most it is asked for (assumed; the maker's own limit was not found).
    profile : str, default: "sonospline"
        What the service calls this session.

    Raises
    ------
    MissingExtraError
        Without the package ``websockets``: ``pip install 'sonospline[serve]'``.
    ValueError
        An address elsewhere; no device, or another one than was asked for.
    OSError
        No service answers there.
    """

    def __init__(
        self, address: str = "ws://127.0.0.1:10001", *, device_id: str | None = None, force_n: float = 3.0,
        profile: str = "sonospline",
    ) -> None:  # fmt: skip
        local_host("address", urlsplit(address).hostname or address)
        self.limits, self.name = DeviceLimits(force_n), f"Inverse3 at {address}"
        client = require("websockets.sync.client")
        self._failures = (require("websockets.exceptions").WebSocketException, EOFError)
        with ExitStack() as opening:
            try:
                connection = client.connect(
                    address, open_timeout=_OPENING_S, close_timeout=WAIT_S, max_size=_MOST_BYTES, proxy=None
                )
                self._socket = opening.enter_context(connection)
                first = self._socket.recv(timeout=_OPENING_S)
            except (OSError, *self._failures) as error:
                raise OSError(f"no Inverse service answers at {address} ({error}); start it") from None
            self._first: dict[str, Any] | None = _read(first)
            self._id = _chosen(self._first, device_id)
            self._session = opening.pop_all()
        self.name = f"Inverse3 {self._id} at {address}"
        self._profile: str | None = profile
        self._open = True
        self.write(NO_FORCE)  # without a command there is no state

    def read(self) -> DeviceState | None:
        """Return the newest state."""
        message, self._first = self._first, None
        if message is None:
            try:
                message = _read(self._socket.recv(timeout=WAIT_S))
            except TimeoutError:
                return None
            except (OSError, *self._failures) as error:
                raise OSError(f"the service has ended the connection ({error})") from None
        for device in _devices(message):
            if device.get("device_id") == self._id and isinstance(device.get("state"), dict):
                return _state(device["state"])
        return None

    def write(self, force_n: Vector) -> None:
        """Send a force; the first message says who we are, too."""
        x, y, z = force_n
        command = {"set_cursor_force": {"values": {"x": x, "y": y, "z": z}}}
        message: dict[str, Any] = {"inverse3": [{"device_id": self._id, "commands": command}]}
        if self._profile is not None:
            message["session"] = {"configure": {"profile": {"name": self._profile}}}
            self._profile = None
        try:
            self._socket.send(json.dumps(message, allow_nan=False))
        except (OSError, *self._failures) as error:
            raise OSError(f"the service has ended the connection ({error})") from None

    def close(self) -> None:
        """Send a last force of nothing, and end the session."""
        if not self._open:
            return
        self._open = False
        try:
            self.write(NO_FORCE)
        finally:
            self._session.close()

    def __repr__(self) -> str:
        return f"HaplyInverse({self.name}, at most {self.limits.force_n:.4g} N)"


def _read(message: str | bytes) -> dict[str, Any]:
    try:
        found = json.loads(message)
    except ValueError:
        raise ValueError(
            f"the service sent {shown(message)}, which is no JSON; is it the port of the states?"
        ) from None
    if not isinstance(found, dict):
        raise ValueError(f"the service sent {shown(message)}, no state; is it the port of the states?")
    return found


def _devices(message: dict[str, Any]) -> list[dict[str, Any]]:
    devices = message.get("inverse3", [])
    return [device for device in devices if isinstance(device, dict)] if isinstance(devices, list) else []


def _chosen(message: dict[str, Any], wanted: str | None) -> str:
    there = [str(device["device_id"]) for device in _devices(message) if "device_id" in device]
    if not there:
        raise ValueError("the service knows no Inverse3; connect one and switch it on")
    if wanted is None:
        if len(there) > 1:
            raise ValueError(f"device_id is missing: {len(there)} devices are there; give one of {', '.join(there)}")
        return there[0]
    if wanted not in there:
        raise ValueError(f"device_id = {wanted!r} is not there; give one of {', '.join(there)}")
    return wanted


def _state(state: dict[str, Any]) -> DeviceState:
    """Parts that are left out are not known: a position without them is no place, a velocity stands."""
    return DeviceState(_mm(state.get("cursor_position"), math.nan), _mm(state.get("cursor_velocity"), 0.0))


def _mm(metres: Any, unknown: float) -> Vector:
    parts = metres if isinstance(metres, dict) else {}
    x, y, z = (_number(parts.get(axis), unknown) for axis in "xyz")
    return 1000 * x, 1000 * y, 1000 * z


def _number(value: Any, unknown: float) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else unknown
