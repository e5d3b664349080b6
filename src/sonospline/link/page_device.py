"""The page as a force device: a hand's pose comes in, a bar to draw and a gamepad's rumble go out."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from .device import NO_FORCE, WAIT_S, DeviceLimits, DeviceState, Vector


@dataclass(frozen=True)
class PageForce:
    """What a page shows of a force.

    Parameters
    ----------
    force_n : (3,) tuple of float
        On the hand.
    bar : float
        Share of the bar that is full, 0 to 1.
    rumble_strong, rumble_weak : float
        Magnitudes of a gamepad's two motors (``GamepadHapticActuator.playEffect``), 0 to 1: the strong one follows the
        force, the weak one how much it has changed since the page last asked, as it does where a membrane gives way.
    """

    force_n: Vector = NO_FORCE
    bar: float = 0.0
    rumble_strong: float = 0.0
    rumble_weak: float = 0.0


class PageDevice:
    """A page's hand. Any thread gives poses and asks what to show.

    Parameters
    ----------
    full_n : float, default: 3.0
        Force at which the bar is full (assumed: a little above the puncture of skin).

    Examples
    --------
    >>> from sonospline.link import PageDevice
    >>> page = PageDevice(full_n=2.0)
    >>> page.receive((0, 0, 12.5))
    >>> page.read().position_mm
    (0.0, 0.0, 12.5)
    >>> page.write((0, 0, -1.0))
    >>> page.shown().bar, page.shown().rumble_weak
    (0.5, 0.0)
    """

    def __init__(self, full_n: float = 3.0) -> None:
        self.name, self.limits = "page", DeviceLimits(full_n)
        self._came = threading.Condition()
        self._state: DeviceState | None = None
        self._force = self._shown = NO_FORCE

    def receive(self, position_mm: Vector, velocity_mm_s: Vector = NO_FORCE) -> None:
        """Take the hand's pose, mm and mm/s."""
        x, y, z = map(float, position_mm)
        vx, vy, vz = map(float, velocity_mm_s)
        with self._came:
            self._state = DeviceState((x, y, z), (vx, vy, vz))
            self._came.notify()

    def read(self) -> DeviceState | None:
        """Return the newest pose, once."""
        with self._came:
            self._came.wait_for(lambda: self._state is not None, WAIT_S)
            state, self._state = self._state, None
            return state

    def write(self, force_n: Vector) -> None:
        """Keep what is to be shown."""
        with self._came:
            self._force = force_n

    def shown(self) -> PageForce:
        """Return what to show now."""
        with self._came:
            force, before, self._shown = self._force, self._shown, self._force
        change = [a - b for a, b in zip(force, before, strict=True)]
        share, changed = self._share(force), self._share(change)
        return PageForce(force, share, share, changed)

    def close(self) -> None:
        """Show nothing any more."""
        self.write(NO_FORCE)

    def __repr__(self) -> str:
        return f"PageDevice(full at {self.limits.force_n:.4g} N)"

    def _share(self, force_n: list[float] | Vector) -> float:
        return min(1.0, sum(part * part for part in force_n) ** 0.5 / self.limits.force_n)
