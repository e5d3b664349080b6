"""The force in the hand, in real time: a thread of the core between a device and what a tissue model knows."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from .._shown import shown
from ..contact.frozen_contact import FrozenContact
from ..geometry.pose import rigid
from .coupling import CONTACT_STALE_MS, DEVICE_STALE_MS, SWEEPS, Coupling
from .device import DeviceThread, ForceDevice, Vector

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ForceReading:
    """What the loop is at.

    Parameters
    ----------
    force_n : (3,) tuple of float
        On the hand, along the axes of the world.
    axial_n : float
        Of it, along the needle of the newest contact: below zero while tissue resists.
    needle_mm : float
        How far the needle is beyond where its tip was in the newest contact, along its axis.
    stretch_mm : float
        How far the device is ahead of the needle.
    stored_j : float
        Work that may still come back to the hand.
    state : str
        ``"felt"``, or why the force fades out or is gone.
    """

    force_n: Vector
    axial_n: float
    needle_mm: float
    stretch_mm: float
    stored_j: float
    state: str


@dataclass(frozen=True)
class ForceTiming:
    """How the loop kept its time, since it began or :meth:`ForceLoop.forget_timing`; quantiles to a tenth of them.

    Parameters
    ----------
    ticks, skipped : int
        Those computed, and those left out since the one before took too long.
    compute_p50_ms, compute_p99_ms : float
        Of one tick, by the clock: what other processes took is in it.
    jitter_p999_ms : float
        How late a tick began.
    real_time : bool
        Whether the system lets the loop run before every ordinary program. Linux does for root, and for those to whom
        ``/etc/security/limits.conf`` gives an ``rtprio`` of 1 or more.
    """

    ticks: int
    skipped: int
    compute_p50_ms: float
    compute_p99_ms: float
    jitter_p999_ms: float
    real_time: bool


class ForceLoop:
    """The force of one needle in one hand, at 1 kHz or more, whatever Python does.

    Parameters
    ----------
    coupling : Coupling, optional

    Raises
    ------
    ImportError
        Without the compiled core: Python keeps no millisecond. :class:`FakeDevice` runs the same law in virtual time.

    Examples
    --------
    >>> import time
    >>> import numpy as np
    >>> from sonospline import _core
    >>> from sonospline.contact import FrozenContact
    >>> from sonospline.link import ForceLoop
    >>> apart = np.subtract.outer(np.arange(5), np.arange(5))
    >>> contact = FrozenContact.at_rest(places_mm=2.0 * np.arange(-4, 1), compliance_mm_n=1 / np.hypot(1, apart),
    ...                                 friction_n=0.05, cutting_n=0.4, axis=(0, 0, 1), tip_mm=(0, 0, 40))
    >>> if _core.backend() == "core":
    ...     with ForceLoop() as loop:
    ...         loop.publish(contact)  # by the tissue model, after each step
    ...         loop.move_to((0, 0, 40))  # by the device, as often as it can
    ...         while not loop.timing.ticks:
    ...             time.sleep(0.001)
    ...         assert loop.reading.force_n == (0, 0, 0)
    """

    def __init__(self, coupling: Coupling | None = None) -> None:
        self.coupling = coupling or Coupling()
        if _core.backend() != "core":
            raise ImportError("the force loop needs the compiled core; install a C++17 compiler, then sonospline again")
        self._loop = _core.active.ForceLoop(self.coupling.for_core(), SWEEPS)
        self._axis = np.zeros(3)
        self._device: DeviceThread | None = None
        self._lock = threading.Lock()
        self._published = self._moved = False

    def start(self) -> None:
        """Begin to tick; nothing where it does already."""
        self._loop.start()

    def close(self) -> None:
        """Let the device go and end the thread; no force is left."""
        self.detach()
        self._loop.stop()

    def __enter__(self) -> ForceLoop:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def publish(self, contact: FrozenContact) -> None:
        """Have the force follow a newer contact from the next tick on; in 20 ms, by at most 0.05 N a tick."""
        if not isinstance(contact, FrozenContact):
            raise ValueError(f"contact = {shown(contact)} is not a FrozenContact; make one from the model's track")
        self._loop.publish(**contact.for_core())
        self._axis, self._published = contact.axis, True

    def move_to(self, position_mm: ArrayLike) -> None:
        """Say where the device is now, mm. What is not finite fades the force out; the last good place stays."""
        position = np.asarray(position_mm, float)
        if position.shape != (3,):
            raise ValueError(f"position_mm = {shown(position_mm)} has shape {position.shape}; give x, y, z in mm")
        self._loop.place(position)
        self._moved = True

    def attach(self, device: ForceDevice, *, device_to_reference: ArrayLike | None = None) -> None:
        """Have a device move the needle and feel its force, in a thread of its own.

        Parameters
        ----------
        device : ForceDevice
        device_to_reference : (4, 4) array_like, optional
            Where the device's base stands in the world, mm: a rotation and a shift. The same place, where left out.

        Raises
        ------
        ValueError
            The needle has a device already: two hands on one needle would each feel the other's. Or the device stands
            nowhere: a matrix that is not rigid.
        """
        pose = rigid("device_to_reference", np.eye(4) if device_to_reference is None else device_to_reference)
        turn, shift = pose[:3, :3], pose[:3, 3]
        with self._lock:
            if self._device is not None and self._device.alive:
                taken = self._device.device.name
                raise ValueError(
                    f"device = {device.name!r} comes second: the needle is in the hand of {taken!r}; "
                    "detach that one, or give this one a needle and a loop of its own"
                )
            self._device = DeviceThread(
                device,
                lambda state: self.move_to(turn @ state.position_mm + shift),
                lambda: tuple((self.reading.force_n @ turn).tolist()),
            )

    def detach(self) -> None:
        """Let the device go, without a force; nothing where there is none."""
        with self._lock:
            device, self._device = self._device, None
        if device is not None:
            device.close()

    @property
    def fault(self) -> str:
        """What ended the device, in one line; empty where nothing did."""
        return "" if self._device is None else self._device.fault

    @property
    def reading(self) -> ForceReading:
        """What the last tick found."""
        force, advance, stretch, fade, stored, heard, fresh = self._loop.reading()
        state = self._state(heard, fresh, fade)
        axial = float(np.dot(force, self._axis))
        x, y, z = force
        return ForceReading((x, y, z), axial, advance - stretch, stretch, stored / 1000, state)

    @property
    def timing(self) -> ForceTiming:
        """How it kept its time."""
        real_time, ticks, skipped, *seconds = self._loop.timing()
        p50, p99, late = (1000 * value for value in seconds)
        return ForceTiming(ticks, skipped, p50, p99, late, real_time)

    def forget_timing(self) -> None:
        """Count anew."""
        self._loop.forget_timing()

    def _state(self, heard: bool, fresh: bool, fade: float) -> str:
        if not self._loop.running():
            return "stopped"
        if not self._published:
            return "no contact yet"
        if not self._moved:
            return "no device yet"
        how = "fades out" if fade > 0 else "is gone"
        if not heard:
            return f"force {how}: the device says nothing finite since {DEVICE_STALE_MS:g} ms"
        if not fresh:
            return f"force {how}: the tissue is older than {CONTACT_STALE_MS:g} ms"
        return "felt" if fade == 1 else "fades in"

    def __repr__(self) -> str:
        device = "no device" if self._device is None else self._device.device.name
        return f"ForceLoop({self.reading.state}, {device}, {1000 / self.coupling.period_ms:g} Hz)"
