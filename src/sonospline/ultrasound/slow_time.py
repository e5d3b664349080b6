"""Colour Doppler of a phantom: pulse after pulse along the beams of its box, while blood flows on."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry import pose
from .aimed import Aimed, noise
from .colour_flow import BoxScan, ColourFlow, autocorrelation, without_polynomial
from .doppler import Doppler
from .flow import Flow
from .optics import CUT_WEIGHT, ELEVATION_CUT, Optics
from .phantom import Phantom

if TYPE_CHECKING:
    from ..geometry.plane import ImagePlane
    from .probe import Probe

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_RAYS, _RAY_SAMPLES = 32, 128
_SLACK_MM = 2.0
"""Beside the slice, for what the tissue's own motion turns."""
_LESS_NOISE_DB = 9.0
"""Of a pulse thrice as long, heard in a third of the band."""


class Pulse(NamedTuple):
    """What is the same for all pulses of an ensemble."""

    field: GridField
    needle: tuple[Floats, Floats]
    noise_level: float
    frame: int


class BloodEchoes:
    """The moving blood of a phantom, as a probe hears it."""

    def __init__(self, phantom: Phantom, optics: Optics, seed: int) -> None:
        self._optics = optics
        per_mm3 = float(optics.density(np.linspace(0, optics.probe.depth_mm, 50)).max())
        self._flows = [
            (flow.blood(per_mm3, seed + k), 10 ** (phantom.blood_of(flow).backscatter_db / 20))
            for k, flow in enumerate(phantom.flows)
        ]

    def heard(self, times_s: Array, probe_to_reference: Array, field: GridField, largest_mm: float) -> list[Floats]:
        """Return the echoes at each time, (m, 4): line, half-sample, real and imaginary part.

        Times of an ensemble are close: places go evenly from those at the first to those at the last.
        """
        parts: list[list[Floats]] = [[np.zeros((0, 4), np.float32)] for _ in times_s]
        for blood, level in self._flows:
            slack_mm = largest_mm + blood.flow.fastest_mm_s * (times_s[-1] - times_s[0])
            near = blood.between(times_s[0], *self._stretch(blood.flow, probe_to_reference, slack_mm))
            near = near[self._near(blood.places(times_s[0], near), probe_to_reference, slack_mm)]
            near = near[blood.rounds(times_s[0], near) == blood.rounds(times_s[-1], near)]  # else it came in again
            first, last = (blood.places(time_s, near) for time_s in (times_s[0], times_s[-1]))
            seen = [self._seen(places, probe_to_reference, field) for places in (first, last)]
            size = level * blood.amplitude * blood.signs[near]
            for k, share in enumerate(np.linspace(0, 1, len(times_s))):
                parts[k].append(self._echoes(seen[0] + share * (seen[1] - seen[0]), size))
        return [np.concatenate(part) for part in parts]

    def _stretch(self, flow: Flow, probe_to_reference: Array, largest_mm: float) -> tuple[float, float]:
        """Between which places along its axis a vessel may be seen, mm."""
        left, right, top, bottom = self._optics.probe.footprint
        corners = np.array([(x, y, 0.0) for x in (left, right) for y in (top, bottom)])
        along = (pose.to_reference(probe_to_reference, corners) - flow.start) @ flow.axes[0]
        slack = largest_mm + max(flow.radii_mm) + _SLACK_MM
        return float(along.min()) - slack, float(along.max()) + slack

    def _near(self, places: Array, probe_to_reference: Array, largest_mm: float) -> NDArray[np.bool_]:
        """Which may be heard once displaced."""
        probe = self._optics.probe
        r, line, elevation = probe.beam_coordinates(pose.to_image(probe_to_reference, places)).T
        slack = largest_mm + _SLACK_MM
        beside = slack / probe.line_spacing(np.maximum(r, 0)) + 2
        thick = ELEVATION_CUT * probe.elevation_sigma(np.clip(r, 0, probe.depth_mm)) + slack
        within = (r > -slack) & (r < probe.depth_mm + slack) & (np.abs(elevation) < thick)
        near: NDArray[np.bool_] = within & (line > -beside) & (line < probe.lines - 1 + beside)
        return near

    def _seen(self, places: Array, probe_to_reference: Array, field: GridField) -> Array:
        return self._optics.probe.beam_coordinates(pose.to_image(probe_to_reference, field.forward(places)))

    def _echoes(self, seen: Array, size: Array) -> Floats:
        r, line, elevation = seen.T
        sigma = self._optics.probe.elevation_sigma(r)
        profile = np.exp(-0.5 * np.minimum((elevation / sigma) ** 2, ELEVATION_CUT**2)) - CUT_WEIGHT
        turns = r * self._optics.cycles_per_mm
        phase = 2 * np.pi * (turns - np.rint(turns))
        size = size * profile
        numbers = [line, r / self._optics.half_sample_mm, size * np.cos(phase), -size * np.sin(phase)]
        return np.column_stack(numbers).astype(np.float32)


class SlowTime:
    """The box of a probe at a pose; poses share what does not depend on them."""

    def __init__(
        self, doppler: Doppler, probe: Probe, phantom: Phantom, plane: ImagePlane, margin_mm: float, seed: int
    ) -> None:
        doppler.check(probe)
        self.doppler, self._probe, self._seed = doppler, probe, seed
        self.optics = Optics(doppler.beams(probe), _RAYS, _RAY_SAMPLES)
        self.blood = BloodEchoes(phantom, self.optics, seed)
        self._aimed = Aimed.unseen(self.optics, margin_mm)
        self._scan = BoxScan(doppler, probe, self.optics.probe, plane)
        self._outline = doppler.outline(probe)
        self._filter = without_polynomial(doppler.ensemble, doppler.wall_filter)

    def moved(self) -> SlowTime:
        """Return the same for another pose."""
        other = object.__new__(SlowTime)
        other.__dict__.update(self.__dict__)
        other._aimed = self._aimed.anew(self._aimed.scan)
        return other

    def pose(self, probe_to_reference: Array) -> Array:
        """Return where the box's beams start from, where the probe is there."""
        found: Array = probe_to_reference @ self.doppler.pose(self._probe)
        return found

    def flow(
        self, phantom: Phantom, probe_to_reference: Array, pulse: Pulse, largest_mm: float, time_s: float
    ) -> ColourFlow:
        """Return what is seen to flow of a phantom whose own blood is silent, from ``time_s`` on."""
        place = self.pose(probe_to_reference)
        self._aimed.look(
            phantom, place, pulse.field, largest_mm, self._seed, diffuse=False, power=self.optics.speckle_power
        )
        times = time_s + np.arange(self.doppler.ensemble) / self.doppler.prf_hz
        blood = self.blood.heard(times, place, pulse.field, largest_mm)
        pulses = np.stack([self._heard(echoes, pulse, k) for k, echoes in enumerate(blood)])
        estimate = autocorrelation(pulses, self._filter, self.optics)
        least = self._least_power(pulse.noise_level)
        nyquist = self.doppler.nyquist_cm_s(self._probe)
        velocity = (np.angle(estimate.lag_one) * (nyquist / np.pi)).astype(np.float32)
        velocity[estimate.power < least] = np.nan
        return ColourFlow(velocity, self._scan.shown(estimate, least), self._scan.corner, nyquist, self._outline)

    def _heard(self, blood: Floats, pulse: Pulse, number: int) -> NDArray[np.complex64]:
        echoes, shadow = pulse.needle
        size = 2 * self.optics.probe.lines * self.optics.probe.samples
        tiles = noise(self._seed, (self.doppler.ensemble + 1) * size)  # of each pulse its own
        start = 2 * (pulse.frame * 7919 % (size // 2)) + number * size
        echoes = np.concatenate([echoes, blood])
        iq = self._aimed.beams(pulse.field, echoes, shadow, tiles[start:], pulse.noise_level)
        heard: NDArray[np.complex64] = iq.view(np.complex64)[..., 0]
        return heard

    def noise_level(self, noise_db: float) -> float:
        """Return the deviation of the noise of each of a pulse's two parts."""
        return float(np.sqrt(self.optics.speckle_power[0] / 2) * 10 ** ((noise_db - _LESS_NOISE_DB) / 20))

    def _least_power(self, noise_level: float) -> float:
        kept = np.trace(self._filter) / self.doppler.ensemble
        return float(2 * noise_level**2 * kept * 10 ** (self.doppler.threshold_db / 10))
