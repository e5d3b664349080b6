"""How a hand is coupled to a needle, and what it is never to feel."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .. import _validate
from .._shown import figure

MAY_GIVE_J = 5e-7
"""Net work on the hand before the hand has done any: without it no force could ever begin. Half of what may be seen."""
MOST_STORED_J = 0.05
"""Of what the hand has put in, so much may come back at once: 3 N on 0.3 N/mm store 0.015 J (assumed)."""
SWAP_MS, SWAP_STEP_N = 20.0, 0.045
DEVICE_STALE_MS, CONTACT_STALE_MS, FADE_MS = 20.0, 100.0, 50.0
WITHDRAWN_MM = 0.5
SWEEPS, TOLERANCE_MM = 8, 1e-7


@dataclass(frozen=True, kw_only=True, repr=False)
class Coupling:
    """A spring and a damper between device and needle, and the limits of what comes of them.

    Stable, and passive without being held back, is what keeps ``stiffness (delay + 3/2 period) + damping`` at or below
    the damping of the hand on the device (Colgate's and Brown's condition; the delay, and a wait for the next tick, are
    more of the same lag).
    More is refused. Beyond that a passivity controller scales the force: over any time the loop does at most 1e-6 J
    more work on the hand than the hand has done on it, as long as the numbers here about hand and delay hold.

    Parameters
    ----------
    stiffness_n_mm : float, default: 0.6
        Of the spring. The hand feels tissue through it: in series, never stiffer.
    damping_n_s_mm : float, default: 0.001
    delay_ms : float, default: 5.0
        Longest time between a motion and the force that answers it, without what is lost on the way.
    period_ms : float, default: 1.0
        Of a tick, at most 1: the force has at least 1 kHz.
    most_force_n : float, default: 6.0
        No force is above it (assumed: twice the puncture of skin; take what your device can do).
    most_rate_n_s : float, default: 500.0
        No force grows faster (assumed). It may fall faster, where it would do work on the hand that nobody put in.
    hand_damping_n_s_mm : float, default: 0.005
        Of hand and device, at least (assumed).
    hand_mass_kg : float, default: 0.2
        Of hand and device, at least (assumed).
    hand_acceleration_mm_s2 : float, default: 10000.0
        Of the hand by its own strength, at most (assumed: that of free fall).

    Raises
    ------
    ValueError
        A number out of its range, or a stiffness that this delay and this hand make no stable force of.

    Examples
    --------
    >>> from sonospline.link import Coupling
    >>> quick = Coupling(delay_ms=1.0, stiffness_n_mm=1.5)
    >>> round(quick.stiffest_n_mm, 3), round(Coupling().stiffest_n_mm, 3)
    (1.6, 0.615)
    """

    stiffness_n_mm: float = 0.6
    damping_n_s_mm: float = 0.001
    delay_ms: float = 5.0
    period_ms: float = 1.0
    most_force_n: float = 6.0
    most_rate_n_s: float = 500.0
    hand_damping_n_s_mm: float = 0.005
    hand_mass_kg: float = 0.2
    hand_acceleration_mm_s2: float = 10_000.0

    def __post_init__(self) -> None:
        zero = {"damping_n_s_mm", "delay_ms"}
        for field in fields(self):
            value = _validate.number(field.name, getattr(self, field.name), positive=field.name not in zero)
            object.__setattr__(self, field.name, value)
        for name, least, most in (("period_ms", 0.05, 1.0), ("delay_ms", 0.0, 100.0)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(
                    f"{name} = {figure(getattr(self, name))} is out of range; give {least:g} to {most:g} ms"
                )
        if self.stiffness_n_mm > self.stiffest_n_mm * (1 + 1e-12):
            raise ValueError(
                f"stiffness_n_mm = {figure(self.stiffness_n_mm)} is not stable with a delay of {figure(self.delay_ms)} "
                f"ms; give at most {max(0.0, self.stiffest_n_mm):.3g}, less delay or less damping"
            )

    @property
    def stiffest_n_mm(self) -> float:
        """The stated limit of the stiffness."""
        lag_s = (self.delay_ms + 1.5 * self.period_ms) / 1000
        return (self.hand_damping_n_s_mm - self.damping_n_s_mm) / lag_s

    def __repr__(self) -> str:
        spring, damper = f"{self.stiffness_n_mm:.4g} N/mm", f"{self.damping_n_s_mm:.4g} N s/mm"
        return f"Coupling({spring}, {damper}, {self.delay_ms:.4g} ms of delay, {1000 / self.period_ms:.4g} Hz)"

    def for_core(self) -> NDArray[np.float64]:
        """Return the numbers that the core takes, in mm, N and s."""
        return np.array([
            self.period_ms / 1000, self.stiffness_n_mm, self.damping_n_s_mm, self.delay_ms / 1000,
            self.hand_acceleration_mm_s2, self.hand_mass_kg / 1000, self.most_force_n, self.most_rate_n_s,
            SWAP_MS / 1000, SWAP_STEP_N, DEVICE_STALE_MS / 1000, CONTACT_STALE_MS / 1000, FADE_MS / 1000,
            MAY_GIVE_J * 1000, MOST_STORED_J * 1000, WITHDRAWN_MM, TOLERANCE_MM,
        ])  # fmt: skip
