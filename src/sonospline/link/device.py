"""What a force device is: something that says where a hand is, and takes a force."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from .. import _validate

logger = logging.getLogger(__name__)

Vector = tuple[float, float, float]

NO_FORCE: Vector = (0.0, 0.0, 0.0)
WAIT_S = 0.005
"""How long a device may let its thread wait for a state."""
LOCAL = ("127.0.0.1", "localhost", "::1")


class DeviceState(NamedTuple):
    """Where a device's grip is, in the world's mm, and how fast; numbers that are not finite are a fault of its own."""

    position_mm: Vector
    velocity_mm_s: Vector = NO_FORCE


@dataclass(frozen=True)
class DeviceLimits:
    """What a device can do.

    Parameters
    ----------
    force_n : float
        It is never asked for more.
    """

    force_n: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "force_n", _validate.number("force_n", self.force_n, positive=True))

    def within(self, force_n: Vector) -> Vector:
        """Return a force, or the strongest one in its direction."""
        size = sum(part * part for part in force_n) ** 0.5
        if not size <= self.force_n:  # NaN is not, either
            share = self.force_n / size if size > 0 and size < float("inf") else 0.0
            return (force_n[0] * share, force_n[1] * share, force_n[2] * share) if share else NO_FORCE
        return force_n


class ForceDevice(Protocol):
    """One hand's device. Its methods are called from one thread of its own; only ``close`` may come from another.

    A device that fails raises an OSError or a ValueError whose text is one clear line: the forces fade out, and the
    line is the loop's ``fault``.
    """

    name: str
    limits: DeviceLimits

    def read(self) -> DeviceState | None:
        """Return the newest state that was not read before; None where a few milliseconds brought none."""
        ...

    def write(self, force_n: Vector) -> None:
        """Take a force on the hand, N along the axes of the world."""
        ...

    def close(self) -> None:
        """Give up the device, without a force left; a second time does nothing."""
        ...


class DeviceThread:
    """The thread of one device: state in, force out, for as long as it is open.

    Parameters
    ----------
    device : ForceDevice
    take : callable
        Is given each state.
    force : callable
        Returns the force of now.
    """

    def __init__(self, device: ForceDevice, take: Callable[[DeviceState], object], force: Callable[[], Vector]) -> None:
        self.device, self.fault = device, ""
        self._take, self._force, self._ending = take, force, threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"device {device.name}", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it still listens."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End it; the device has no force then."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        """Serve until told to end; a fault is said when the device has been closed, so that another may come then."""
        fault = self._served()
        try:
            self.device.close()
        except Exception as error:  # of a device of anybody's
            logger.warning("%s: %s", self.device.name, error)
        if fault:
            logger.warning("%s", fault)
        self.fault = fault

    def _served(self) -> str:
        device = self.device
        try:
            while not self._ending.is_set():
                state = device.read()
                if state is not None:
                    self._take(state)
                    device.write(device.limits.within(self._force()))
        except Exception as error:  # of a device of anybody's: whatever it is, the force must end
            return f"{device.name}: {str(error) or type(error).__name__}"
        return ""


def local_host(name: str, host: str) -> str:
    """Return a host of this machine: forces are for nobody else to send."""
    if host not in LOCAL:
        raise ValueError(f"{name} = {host!r} is another machine; give 127.0.0.1, and a tunnel where it must be")
    return host
