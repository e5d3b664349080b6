"""Ultrasound probes: their beams and how sharp they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate

Array = NDArray[np.float64]
Kind = Literal["linear", "curvilinear", "phased"]

SPEED_OF_SOUND = 1.54
"""mm per microsecond, what scanners assume."""

FWHM = 2 * np.sqrt(2 * np.log(2))
"""Full width at half maximum over the standard deviation, of a Gaussian."""
_FINEST, _FITTING, _COARSEST = 0.105, 1.2, 1.5
"""A sample, in standard deviations of the pulse: 63 half-samples hold 3.3 of them."""
_FEWEST_SAMPLES, _SAMPLES, _MOST_SAMPLES = 80, 1024, 32_768
"""Along a beam: at least, where they fit the pulse, and at most."""
_WIDEST_STEP, _MOST_LINES = 2.6, 512
"""Between lines, in standard deviations of the beam, before there are more of them; and how many at most."""
_NOT_NEGATIVE = ("elevation_focus_mm", "elevation_spread", "radius_mm", "sector_deg")
_HARMONIC = 1.5
"""What is sent and what is heard, on average, over what is sent."""
_CONE = 0.6
"""Full width at half maximum of a converging beam over the cone that its aperture spans: set by eye."""


_ABDOMINAL: dict[str, Any] = {
    "aperture_mm": 62.8, "radius_mm": 60.0, "f_number": 2.5, "active_aperture_mm": 20.0, "elevation_mm": 3.0,
    "elevation_focus_mm": 65.0,
}  # fmt: skip
_CARDIAC: dict[str, Any] = {
    "aperture_mm": 20.0, "sector_deg": 80.0, "f_number": 2.5, "active_aperture_mm": 20.0, "elevation_mm": 3.5,
    "elevation_focus_mm": 70.0, "elevation_spread": 0.02,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, repr=False)
class Probe:
    """A transducer and its settings.

    The probe frame, whose pose is ``ProbeToReference``: x lateral, y depth, z elevation, origin in the
    middle of the face. Start from :meth:`linear`, :meth:`curvilinear` or :meth:`phased`.

    Parameters
    ----------
    kind : {"linear", "curvilinear", "phased"}
        Parallel beams, beams square to a convex face, or beams from one point.
    frequency_mhz : float
        Centre frequency f0.
    depth_mm : float
        Depth of the image.
    aperture_mm : float
        Width of the face along x (of its arc, for a convex one).
    radius_mm : float
        Radius of a convex face; 0 for the others.
    sector_deg : float
        Opening angle of a phased sector; a convex face's follows from its arc.
    lines, samples : int
        Beams, and samples along each.
    bandwidth : float
        Two-way -6 dB bandwidth over the centre frequency.
    f_number : float
        Depth over active aperture, until the aperture is used up.
    active_aperture_mm : float
        Widest active aperture D.
    elevation_mm : float
        Two-way full width at half maximum of the slice at its focus.
    elevation_focus_mm : float
        Depth of the elevation focus.
    elevation_spread : float
        Growth of the slice's standard deviation per mm from its focus.
    transmit_focus_mm : float, default: 0
        Depth the beams are sent to: elsewhere they are up to 1.41 times as wide. 0 focuses at every depth.
    downshift_db_cm_mhz : float, default: 0
        Attenuation by which the pulse's centre frequency falls with depth, which widens the beam; 0 for none.
    harmonic : bool, default: False
        Whether it hears the harmonic of what it sends; see :meth:`in_harmonic_mode`.

    Raises
    ------
    ValueError
        A length, frequency or count that is not above zero, or a sector of 180 degrees or more.

    Examples
    --------
    >>> from sonospline.ultrasound import Probe
    >>> probe = Probe.curvilinear(frequency_mhz=3.5)
    >>> round(probe.wavelength_mm, 2), round(float(probe.lateral_fwhm(60.0)), 2)
    (0.44, 1.19)
    """

    kind: Kind
    frequency_mhz: float
    depth_mm: float
    aperture_mm: float
    radius_mm: float = 0.0
    sector_deg: float = 0.0
    lines: int = 192
    samples: int = 1024
    bandwidth: float = 0.62
    f_number: float = 2.0
    active_aperture_mm: float = 22.0
    elevation_mm: float = 1.5
    elevation_focus_mm: float = 20.0
    elevation_spread: float = 0.015
    transmit_focus_mm: float = 0.0
    downshift_db_cm_mhz: float = 0.0
    harmonic: bool = False

    def __post_init__(self) -> None:
        _validate.choice("kind", self.kind, ("linear", "curvilinear", "phased"))
        for name in ("frequency_mhz", "depth_mm", "aperture_mm", "f_number", "active_aperture_mm", "elevation_mm"):
            _validate.number(name, getattr(self, name), positive=True)
        for name in (*_NOT_NEGATIVE, "transmit_focus_mm", "downshift_db_cm_mhz"):
            _validate.number(name, getattr(self, name))
        _bandwidth(self.bandwidth)
        _validate.count("lines", self.lines, least=16)
        _validate.count("samples", self.samples, least=64)
        if self.samples % 16:
            raise ValueError(f"samples = {self.samples} is not a multiple of 16; give {16 * (self.samples // 16 + 1)}")
        if self.kind == "curvilinear":
            _validate.number("radius_mm", self.radius_mm, positive=True)
        if self.kind == "phased":
            _validate.number("sector_deg", self.sector_deg, positive=True)
        if self.half_angle >= np.pi / 2:
            raise ValueError(f"the sector is {2 * np.degrees(self.half_angle):.0f} degrees wide; make it below 180")
        per_pulse = self.sample_mm / self.axial_sigma
        if not _FINEST <= per_pulse <= _COARSEST:
            fault, remedy = ("coarse", "more") if per_pulse > _COARSEST else ("fine", "fewer")
            raise ValueError(
                f"depth_mm = {self.depth_mm} over samples = {self.samples} is too {fault} for the pulse "
                f"({FWHM * self.axial_sigma:.3f} mm long); take {remedy} samples"
            )

    def __repr__(self) -> str:
        size = f"{self.lines} lines of {self.samples} samples"
        return f"Probe({self.kind}, {self.frequency_mhz:g} MHz, {self.depth_mm:g} mm deep, {size})"

    @classmethod
    def linear(
        cls, *, frequency_mhz: float = 7.5, depth_mm: float = 45.0, aperture_mm: float = 38.0, **settings: Any
    ) -> Probe:
        """Return a small-parts probe: parallel beams; as many samples and lines as its pulse and beam need.

        Examples
        --------
        >>> from sonospline.ultrasound import Probe
        >>> Probe.linear(frequency_mhz=10, depth_mm=80)
        Probe(linear, 10 MHz, 80 mm deep, 192 lines of 1440 samples)
        """
        return cls._preset("linear", frequency_mhz, depth_mm, {"aperture_mm": aperture_mm} | settings)

    @classmethod
    def curvilinear(cls, *, frequency_mhz: float = 3.5, depth_mm: float = 120.0, **settings: Any) -> Probe:
        """Return an abdominal probe: a convex face of 60 mm radius, 60 degrees wide."""
        return cls._preset("curvilinear", frequency_mhz, depth_mm, _ABDOMINAL | settings)

    @classmethod
    def phased(cls, *, frequency_mhz: float = 2.5, depth_mm: float = 140.0, **settings: Any) -> Probe:
        """Return a cardiac probe: a sector of 80 degrees from one point."""
        return cls._preset("phased", frequency_mhz, depth_mm, _CARDIAC | settings)

    @classmethod
    def _preset(cls, kind: Kind, frequency_mhz: float, depth_mm: float, settings: dict[str, Any]) -> Probe:
        _validate.number("frequency_mhz", frequency_mhz, positive=True)
        _validate.number("depth_mm", depth_mm, positive=True)
        if "samples" not in settings:
            bandwidth = _bandwidth(settings.get("bandwidth", cls.bandwidth))
            settings = settings | {"samples": _fitting_samples(depth_mm, _axial_sigma(bandwidth, frequency_mhz))}
        probe = cls(kind=kind, frequency_mhz=frequency_mhz, depth_mm=depth_mm, **settings)
        return probe if "lines" in settings else replace(probe, lines=probe._fitting_lines())

    def tuned(
        self,
        *,
        frequency_mhz: float | None = None,
        depth_mm: float | None = None,
        elevation_focus_mm: float | None = None,
        transmit_focus_mm: float | None = None,
    ) -> Probe:
        """Return the probe with some knobs turned, and as many samples as its pulse then needs.

        Examples
        --------
        >>> from sonospline.ultrasound import Probe
        >>> Probe.linear().tuned(frequency_mhz=1.0, depth_mm=20, elevation_focus_mm=15).samples
        400
        """
        frequency = self.frequency_mhz if frequency_mhz is None else frequency_mhz
        depth = self.depth_mm if depth_mm is None else depth_mm
        sigma = _axial_sigma(self.bandwidth, _validate.number("frequency_mhz", frequency, positive=True))
        return replace(
            self,
            frequency_mhz=frequency,
            depth_mm=depth,
            elevation_focus_mm=self.elevation_focus_mm if elevation_focus_mm is None else elevation_focus_mm,
            transmit_focus_mm=self.transmit_focus_mm if transmit_focus_mm is None else transmit_focus_mm,
            samples=_fitting_samples(_validate.number("depth_mm", depth, positive=True), sigma),
        )

    def in_harmonic_mode(self) -> Probe:
        """Return the probe as it images by the second harmonic of what it sends, by parameters.

        It sends f and hears 2 f: attenuation is that of 1.5 f, and so is the carrier here. The beam becomes 0.67 times
        as wide (theory: 0.58); the pulse keeps its length. Side lobes and the near field excite little of it, and there
        is more noise: see :class:`Artefacts`.

        Examples
        --------
        >>> from sonospline.ultrasound import Probe
        >>> plain, harmonic = Probe.curvilinear(), Probe.curvilinear().in_harmonic_mode()
        >>> harmonic.frequency_mhz, round(float(harmonic.lateral_fwhm(60) / plain.lateral_fwhm(60)), 2)
        (5.25, 0.67)
        """
        if self.harmonic:
            return self
        frequency, bandwidth = _HARMONIC * self.frequency_mhz, self.bandwidth / _HARMONIC
        return replace(self, frequency_mhz=frequency, bandwidth=bandwidth, harmonic=True)

    def _fitting_lines(self) -> int:
        """192 lines, or as many as keep neighbours within 2.6 standard deviations of the beam all along."""
        ranges = np.linspace(0, self.depth_mm, 50)
        apart = float((self.line_spacing(ranges) / self.lateral_sigma(ranges)).max())
        return min(max(self.lines, int(np.ceil(apart / _WIDEST_STEP * (self.lines - 1))) + 1), _MOST_LINES)

    @property
    def wavelength_mm(self) -> float:
        """Wavelength c / f0."""
        return SPEED_OF_SOUND / self.frequency_mhz

    @property
    def sample_mm(self) -> float:
        """Distance between samples of a beam, dr."""
        return self.depth_mm / self.samples

    @cached_property
    def half_angle(self) -> float:
        """Half of the sector in radians, T; 0 for a linear probe."""
        if self.kind == "linear":
            return 0.0
        if self.kind == "phased":
            return float(np.radians(self.sector_deg) / 2)
        return self.aperture_mm / self.radius_mm / 2

    @property
    def curved(self) -> bool:
        """Whether the beams fan out."""
        return self.kind != "linear"

    @property
    def apex_mm(self) -> float:
        """Distance R0 from the point the beams fan out from to the face."""
        return self.radius_mm if self.kind == "curvilinear" else 0.0

    @property
    def line_step(self) -> float:
        """Distance between beams: mm for a linear probe, radians for the others."""
        return (2 * self.half_angle if self.curved else self.aperture_mm) / (self.lines - 1)

    @cached_property
    def ranges(self) -> Array:
        """(samples,) range of each sample in mm."""
        return np.arange(self.samples, dtype=np.float64) * self.sample_mm

    def line_spacing(self, range_mm: ArrayLike) -> Array:
        """Return the distance between beams at a range, mm."""
        reach: Array = np.asarray(range_mm, float) + self.apex_mm
        return self.line_step * (reach if self.curved else np.ones_like(reach))

    @property
    def axial_sigma(self) -> float:
        """Standard deviation of the two-way pulse's envelope in range, mm: s_r = (c/2) / (2 pi s_f)."""
        return _axial_sigma(self.bandwidth, self.frequency_mhz)

    def frequency_at(self, range_mm: ArrayLike) -> Array:
        """Return the pulse's centre frequency at a range, MHz: a Gaussian spectrum loses its upper half sooner.

        f0 - 2 a r s_f^2, a the attenuation in neper, s_f the spectrum's standard deviation; half of f0 at least.
        """
        r = np.maximum(np.asarray(range_mm, float), 0)
        neper = self.downshift_db_cm_mhz / 10 * np.log(10) / 20
        spectrum = self.bandwidth * self.frequency_mhz / FWHM
        return np.maximum(self.frequency_mhz - 2 * neper * r * spectrum**2, self.frequency_mhz / 2)

    def lateral_fwhm(self, range_mm: ArrayLike) -> Array:
        """Return the beam's full width at half maximum, 0.9 wavelength max(F#, r / D), mm; wider off its focus."""
        r = np.asarray(range_mm, float)
        ratio: Array = np.maximum(self.f_number, r / self.active_aperture_mm)
        width = 0.9 * self.wavelength_mm * ratio
        if self.downshift_db_cm_mhz:
            width = width * self.frequency_mhz / self.frequency_at(r)
        if not self.transmit_focus_mm:
            return width
        # the beam sent, as wide as its aperture's share of the way off its focus; the one heard is focused anywhere
        at_focus = max(self.f_number, self.transmit_focus_mm / self.active_aperture_mm)
        off = _CONE * np.abs(r - self.transmit_focus_mm) / at_focus
        sent = np.hypot(np.sqrt(2) * 0.9 * self.wavelength_mm * at_focus, off)
        heard = np.sqrt(2) * width
        both: Array = 1 / np.hypot(1 / sent, 1 / heard)
        return np.maximum(both, width)

    def lateral_sigma(self, range_mm: ArrayLike) -> Array:
        """Return the beam's standard deviation, mm."""
        return self.lateral_fwhm(range_mm) / FWHM

    def elevation_sigma(self, range_mm: ArrayLike) -> Array:
        """Return the standard deviation of the slice's two-way amplitude profile, mm."""
        apart = self.elevation_spread * (np.asarray(range_mm, float) - self.elevation_focus_mm)
        sigma: Array = np.hypot(self.elevation_mm / FWHM, apart)
        return sigma

    def beam_coordinates(self, points: ArrayLike) -> Array:
        """Return range (mm), line (fractional) and elevation (mm) of probe points (m, 3), or of one (3,)."""
        x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
        return np.stack([*self.range_and_line(x, y), z], axis=-1)

    def range_and_line(self, x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return range (mm) and line of places in the image plane, any arrays that broadcast."""
        middle = (self.lines - 1) / 2
        if not self.curved:
            x, y = np.broadcast_arrays(x, y)
            return y, x / self.line_step + middle
        y = y + self.apex_mm
        return np.hypot(x, y) - self.apex_mm, np.arctan2(x, y) / self.line_step + middle

    def image_points(self, beam: ArrayLike) -> Array:
        """Return probe points (m, 3), or one (3,), of range, line and elevation: beam_coordinates' inverse."""
        r, line, z = np.moveaxis(np.asarray(beam, float), -1, 0)
        across = (line - (self.lines - 1) / 2) * self.line_step
        if not self.curved:
            return np.stack([across, r, z], axis=-1)
        reach = r + self.apex_mm
        return np.stack([reach * np.sin(across), reach * np.cos(across) - self.apex_mm, z], axis=-1)

    def beam_lines(self, count: int = 49) -> Array:
        """Return where beams across the image leave the face and their directions, (count, 4): x, y, x, y; mm."""
        line = np.linspace(0, self.lines - 1, count)
        near, far = (self.image_points(np.column_stack([np.full(count, r), line, np.zeros(count)])) for r in (0.0, 1.0))
        return np.column_stack([near[:, :2], (far - near)[:, :2]])

    @property
    def housing_mm(self) -> tuple[float, float]:
        """Width and thickness of what holds the face: a little more than it, and enough for a hand."""
        face = float(np.ptp(self.beam_lines(2)[:, 0]))
        return max(face, 24.0) + 5.0, 21.0 if self.curved else 16.0

    def beam_directions(self, points: ArrayLike) -> Array:
        """Return unit vectors (m, 3) of the beams through probe points (m, 3), or one (3,)."""
        points = np.asarray(points, float)
        if not self.curved:
            return np.broadcast_to([0.0, 1.0, 0.0], points.shape)
        from_apex = points * [1, 1, 0] + [0, self.apex_mm, 0]
        directions: Array = from_apex / np.maximum(np.linalg.norm(from_apex, axis=-1, keepdims=True), 1e-9)
        return directions

    @cached_property
    def footprint(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom of what the beams cover, in image coordinates, mm."""
        if not self.curved:
            return (-self.aperture_mm / 2, self.aperture_mm / 2, 0.0, self.depth_mm)
        side = (self.depth_mm + self.apex_mm) * float(np.sin(self.half_angle))
        return (-side, side, self.apex_mm * (float(np.cos(self.half_angle)) - 1), self.depth_mm)


def _bandwidth(value: float) -> float:
    if not 0.05 <= _validate.number("bandwidth", value) <= 1.5:
        raise ValueError(f"bandwidth = {value} is out of range; give 0.05 to 1.5 of the centre frequency")
    return float(value)


def _axial_sigma(bandwidth: float, frequency_mhz: float) -> float:
    return float(SPEED_OF_SOUND / 2 / (2 * np.pi * bandwidth * frequency_mhz / FWHM))


def _fitting_samples(depth_mm: float, axial_sigma: float) -> int:
    """1024 samples, or the number nearest to it that is neither too coarse nor too fine for the pulse."""
    if not _FEWEST_SAMPLES * _FINEST <= depth_mm / axial_sigma <= _MOST_SAMPLES * _FITTING:
        longer = depth_mm / axial_sigma < 1e3
        remedy = "a higher frequency or a larger depth" if longer else "a lower frequency or a smaller depth"
        raise ValueError(
            f"depth_mm = {depth_mm:g} does not go with a pulse {FWHM * axial_sigma:.3g} mm long; give {remedy}"
        )
    least = 16 * int(np.ceil(depth_mm / (_FITTING * axial_sigma) / 16))
    most = 16 * int(depth_mm / (_FINEST * axial_sigma) / 16)
    return min(max(_SAMPLES, least), most)


PROBES: dict[str, Callable[..., Probe]] = {
    "curvilinear": Probe.curvilinear, "linear": Probe.linear, "phased": Probe.phased,
}  # fmt: skip
"""Probes by the names that scene files and the command line give them."""
