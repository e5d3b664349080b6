"""What is heard beside the beam, as the core adds it: a second beam, wide and weak, and reverberation.

The wide beam is rendered like the first, from the same tissue, needle and displacement, with a quarter of the
lines: where scatterers stand for 18 times the volume, and faint surfaces are left out, few of them do.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from . import grating
from .aimed import NO_CLUTTER, Aimed, ClutterInput
from .artefacts import Artefacts
from .grating import GratingLobes
from .optics import Optics
from .phantom import Phantom
from .probe import Probe

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

_WIDER, _THICKER, _FEWER_LINES = 6.0, 3.0, 4
_WIDE_RAYS, _WIDE_RAY_SAMPLES, _WIDE_POINTS, _WIDE_FAINTEST = 48, 128, 32, 20.0
_HAZE_DB_MM_MHZ = 0.34  # fall of the haze with depth: 1.2 dB/mm at 3.5 MHz
_FAINTEST_HAZE_DB = -60.0
_BANDS, _BAND_MM_MHZ, _BAND_DB, _BAND_FALL_DB = 6, 3.9, 12.0, 4.5  # echoes in the lens, one under the other
_TAIL_MM = 12.0
_TAIL_RUN = 16
_TAIL_DB_CM_MHZ = 0.6  # lost on the way as elsewhere
_LOUD_DB = 20.0  # above liver at its depth: what is heard again
_FAINTEST = 1e25  # one over a power that nothing is heard of, so deep or at so high a frequency
_MIRROR_DB = 40.0
"""A perfect mirror over liver speckle, of such surfaces as here."""


class Clutter:
    """What a probe hears beside its beam; poses of it share what does not depend on the pose."""

    def __init__(self, artefacts: Artefacts, optics: Optics, margin_mm: float, seed: int) -> None:
        artefacts = artefacts.in_harmonic_mode() if optics.probe.harmonic else artefacts
        self.artefacts, self.optics, self._seed = artefacts, optics, seed
        self._wide: Aimed | None = None
        self._lobes: GratingLobes | None = None
        wide, lobes = _wide_probe(optics.probe), grating.angle(optics.probe)
        if lobes is not None and artefacts.grating_db is not None:
            self._lobes = GratingLobes(optics.probe, wide, _TAIL_RUN, lobes, artefacts.grating_db)
        if artefacts.side_lobes_db is not None or self._lobes is not None:
            beam = Optics(wide, _WIDE_RAYS, _WIDE_RAY_SAMPLES, _WIDE_POINTS, _WIDE_FAINTEST)
            self._wide = Aimed.unseen(beam, margin_mm)

    def moved(self) -> Clutter:
        """Return the same for another pose."""
        other = object.__new__(Clutter)
        other.__dict__.update(self.__dict__)
        if self._wide is not None:
            other._wide = self._wide.anew(self._wide.scan)
        return other

    def heard(
        self,
        phantom: Phantom,
        probe_to_reference: Array,
        field: GridField,
        largest_mm: float,
        needle: tuple[Floats, Floats],
        noise: Floats,
    ) -> ClutterInput:
        """Return what the core adds to a frame."""
        wide, scale, ghosts = NO_CLUTTER.wide, NO_CLUTTER.wide_scale, NO_CLUTTER.ghosts
        if self._wide is not None:
            power = self.optics.speckle_power
            self._wide.look(
                phantom, probe_to_reference, field, largest_mm, self._seed, diffuse=False, power=power
            )  # fmt: skip
            heard = self._rendered(self._wide, field, needle, noise)
            if self.artefacts.side_lobes_db is not None:
                wide, scale = heard, self._wide_scale
            if self._lobes is not None:
                ghosts = self._lobes.heard(heard)
        level, keep = self._tail
        texture = NO_CLUTTER.texture if level == 0 and self._lobes is None else self._texture
        return ClutterInput(wide, scale, self._haze, texture, level, keep, ghosts, *self._repeats)

    def _rendered(self, aimed: Aimed, field: GridField, needle: tuple[Floats, Floats], noise: Floats) -> Floats:
        probe, narrow = aimed.optics.probe, self.optics.probe
        echoes, shadow = needle
        echoes = echoes * np.array([(probe.lines - 1) / (narrow.lines - 1), 1, 1, 1], np.float32)
        of = np.linspace(0, narrow.lines - 1, probe.lines)
        shadow = np.stack([np.interp(of, np.arange(narrow.lines), row) for row in shadow]).astype(np.float32)
        return aimed.beams(field, echoes, shadow, noise, 0.0)

    @cached_property
    def _wide_scale(self) -> Floats:
        """Amplitude that brings the wide beam's speckle to its level below the narrow one's."""
        assert self._wide is not None and self.artefacts.side_lobes_db is not None
        ratio = self.optics.speckle_power / self._wide.optics.speckle_power
        level = self.artefacts.side_lobes_db + (self.artefacts.defocus_db or 0.0) * self._off_focus
        scale: Floats = (np.sqrt(ratio) * 10 ** (level / 20)).astype(np.float32)
        return scale

    @property
    def _off_focus(self) -> Array | float:
        """How far samples lie off the transmit focus: 0 in it, 1 where the beam is as much wider as it can be."""
        probe = self.optics.probe
        if not probe.transmit_focus_mm:
            return 0.0
        focused = replace(probe, transmit_focus_mm=0.0).lateral_fwhm(probe.ranges)
        off: Array = (probe.lateral_fwhm(probe.ranges) / focused - 1) / (np.sqrt(2) - 1)
        return off

    @cached_property
    def _repeats(self) -> tuple[Floats, Floats, float]:
        """Amplitude of liver's speckle, one over the power of what is heard again, and the face's share of it."""
        if self.artefacts.multiples_db is None:
            return NO_CLUTTER.unit, NO_CLUTTER.loudness, 0.0
        probe, power = self.optics.probe, self.optics.speckle_power
        lost = 2 * _TAIL_DB_CM_MHZ * probe.frequency_mhz * probe.ranges / 10
        loudness = np.minimum(10 ** ((lost - _LOUD_DB) / 10) / power, _FAINTEST)
        again = 10 ** ((self.artefacts.multiples_db - _MIRROR_DB) / 20)
        return np.sqrt(power).astype(np.float32), loudness.astype(np.float32), float(again)

    @cached_property
    def _tail(self) -> tuple[float, float]:
        """Share of the power before it that sounds, and of the power that is left from one run to the next."""
        if self.artefacts.tail_db is None:
            return 0.0, 0.0
        probe = self.optics.probe
        run = _TAIL_RUN * probe.sample_mm
        fades = float(np.exp(-run / _TAIL_MM))
        lost = 10 ** (-2 * _TAIL_DB_CM_MHZ * probe.frequency_mhz * run / 10 / 10)
        return float(10 ** (self.artefacts.tail_db / 10) * (1 - fades)), fades * float(lost)

    @cached_property
    def _texture(self) -> Floats:
        """(lines, samples, 2) speckle of power 1, of this probe's pulse and beam."""
        probe, lateral = self.optics.probe, self.optics.lateral
        random = np.random.default_rng([self._seed, 5])
        pulse, half = self.optics.axial[::2], len(lateral) // 2
        padded = random.standard_normal((probe.lines + 2 * half, probe.samples + len(pulse) - 1, 2)).astype(np.float32)
        along = sum(tap * padded[:, k : k + probe.samples] for k, tap in enumerate(pulse.astype(np.float32)))
        assert not isinstance(along, int)
        taps = lateral.astype(np.float32)[..., None]
        across = sum(tap * along[k : k + probe.lines] for k, tap in enumerate(taps))
        power = 2 * (pulse**2).sum() * (lateral**2).sum(axis=0)
        texture: Floats = np.ascontiguousarray(across / np.sqrt(power)[:, None], np.float32)
        return texture

    @cached_property
    def _haze(self) -> Floats:
        """(lines, first samples, 2): speckle that falls with depth, and the lens's echoes, alike in all lines."""
        level = self.artefacts.haze_db
        if level is None:
            return NO_CLUTTER.haze
        probe, fall = self.optics.probe, _HAZE_DB_MM_MHZ * self.optics.probe.frequency_mhz
        end = min(probe.samples, 1 + int((level - _FAINTEST_HAZE_DB) / fall / probe.sample_mm))
        r = probe.ranges[:end]
        rms = np.sqrt(self.optics.speckle_power[:end])
        haze = self._texture[:, :end] * (rms * 10 ** ((level - fall * r) / 20))[:, None]
        bands = np.arange(_BANDS)
        apart = _BAND_MM_MHZ / probe.frequency_mhz
        heights = 10 ** ((level + _BAND_DB - _BAND_FALL_DB * bands) / 20) * (-1.0) ** bands
        pulse = np.exp(-(((r[:, None] - apart * bands) / probe.axial_sigma) ** 2) / 2)
        haze[..., 0] += (pulse @ heights) * rms
        found: Floats = np.ascontiguousarray(haze, np.float32)
        return found


def _wide_probe(probe: Probe) -> Probe:
    """Return the probe of the side lobes: six times as wide, three times as thick, a quarter of the lines."""
    return replace(
        probe,
        lines=max(16, -(-probe.lines // _FEWER_LINES)),
        f_number=probe.f_number * _WIDER,
        active_aperture_mm=probe.active_aperture_mm / _WIDER,
        elevation_mm=probe.elevation_mm * _THICKER,
        elevation_spread=probe.elevation_spread * _THICKER,
    )
