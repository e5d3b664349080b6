"""Synthetic B-mode: the image a probe shows of a phantom that a field deforms and a needle pierces."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._shown import shown
from ..fields.field import Field
from ..fields.grid_field import GridField, at_nodes
from ..geometry import pose
from ..geometry.bent_needle import BentNeedle
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from . import needle_synthesis
from .acoustics import AcousticTissue
from .aimed import Aimed, noise
from .artefacts import HARMONIC_NOISE_DB, Artefacts
from .bmode import BMode
from .clutter import Clutter
from .display import Display
from .doppler import Doppler
from .frame import Frame
from .needle_echo import NeedleEcho
from .optics import Optics, Scan, picture_plane
from .organs import as_phantom
from .phantom import Phantom
from .probe import Probe
from .slow_time import BloodEchoes, Pulse, SlowTime

if TYPE_CHECKING:
    from ..models.contract import Response

logger = logging.getLogger(__name__)

_NOISE_TILES = 4
_LARGEST_SEED = 2**64 - 1


class Scanner:
    """A probe on a phantom: made once, then rendered for every field and needle.

    Scatterers live in the undeformed tissue, are carried forward by the field, and are each added once to a
    grid of beams with the exact phase of the carrier at their range; pulse and beam follow as convolutions.

    Parameters
    ----------
    phantom : Phantom, LabelMap or Volume
        What is there: a label map with the names of organs, any labels with ``tissues``, or a phantom.
    probe : Probe
        What looks at it.
    probe_to_reference : (4, 4) array_like
        Pose: rigid transform from the probe (mm from the middle of its face: x lateral, y depth, z elevation)
        to the world.
    tissues : mapping of int to AcousticTissue or str, optional
        Acoustic tissue of each label, where ``phantom`` is labels; by default by the names of its organs.
    display : Display, optional
        Gain, dynamic range, time-gain compensation, noise.
    needle_echo : NeedleEcho, optional
        How the needle looks; by default a trocar.
    artefacts : Artefacts, optional
        What a real image shows beyond clean beams; by default nothing.
    doppler : Doppler, optional
        Colour Doppler of the phantom's flows, whose blood then moves in the grey image, too; by default none.
    picture_shape : (int, int), optional
        Rows and columns of the picture; by default 512 along its longer side.
    seed : int, default: 0
        Of scatterers and noise: the same seed gives the same bits on one machine.
    margin_mm : float, default: 3
        Displacement allowed for when scatterers are chosen; a larger one chooses anew, which takes a moment.

    Raises
    ------
    ValueError
        A pose that is not rigid, a probe that is none, labels of which no tissues are known, a Doppler box outside the
        image, or pulses faster than their echoes.

    Examples
    --------
    >>> from sonospline.ultrasound import Probe, Phantom, Scanner
    >>> from sonospline.geometry import facing
    >>> phantom = Phantom.uniform("liver", size_mm=(30, 10, 40))
    >>> probe = Probe.linear(depth_mm=30, lines=64, samples=512, aperture_mm=20)
    >>> scanner = Scanner(phantom, probe, facing((15, 5, 2), depth=(0, 0, 1), right=(1, 0, 0)))
    >>> image = scanner.render()
    >>> bool(100 < image.beams[20:44, 50:250].mean() < 140)
    True
    """

    def __init__(
        self,
        phantom: Phantom | Volume,
        probe: Probe,
        probe_to_reference: ArrayLike,
        *,
        tissues: Mapping[int, AcousticTissue | str] | None = None,
        display: Display | None = None,
        needle_echo: NeedleEcho | None = None,
        artefacts: Artefacts | None = None,
        doppler: Doppler | None = None,
        picture_shape: tuple[int, int] | None = None,
        seed: int = 0,
        margin_mm: float = 3.0,
    ) -> None:
        if not isinstance(probe, Probe):
            raise ValueError(f"probe = {shown(probe)} is not a Probe; make one, e.g. Probe.curvilinear()")
        self.phantom = as_phantom(phantom, tissues)
        self.display = Display() if display is None else display
        self.needle_echo = NeedleEcho.trocar() if needle_echo is None else needle_echo
        self.artefacts = Artefacts.none() if artefacts is None else artefacts
        if not isinstance(self.artefacts, Artefacts):
            raise ValueError(f"artefacts = {shown(artefacts)} are none; give Artefacts(), or leave them out")
        if not isinstance(doppler, Doppler | None):
            raise ValueError(f"doppler = {shown(doppler)} is none; give Doppler(box_mm=...), or leave it out")
        self.doppler = doppler
        self.seed = _validate.count("seed", seed, least=0)
        if seed > _LARGEST_SEED:
            raise ValueError(f"seed = {seed} is too large; give at most {_LARGEST_SEED}")
        margin_mm = _validate.number("margin_mm", margin_mm, positive=True)
        self.probe_to_reference = pose.rigid("probe_to_reference", probe_to_reference)
        self._blind = False
        self._use(probe, picture_shape, margin_mm)

    def moved(self, probe_to_reference: ArrayLike) -> Scanner:
        """Return the same scanner at another pose, with the image that a new one would show there.

        What does not depend on the pose is shared. Scatterers are chosen anew by the next :meth:`render`:
        tens of milliseconds, fast enough for a probe in a hand.
        """
        other = self._twin()
        other.probe_to_reference = pose.rigid("probe_to_reference", probe_to_reference)
        other.plane = picture_plane(self.probe, other.probe_to_reference, self.plane.shape)
        other._aimed, other._clutter = self._aimed.anew(self._scan), self._clutter.moved()
        other._slow_time = None if self._slow_time is None else self._slow_time.moved()
        return other

    def with_probe(self, probe: Probe) -> Scanner:
        """Return a scanner with another probe, or another setting of it, at the same pose and picture size.

        Examples
        --------
        >>> from dataclasses import replace
        >>> from sonospline.ultrasound import Probe, Phantom, Scanner
        >>> from sonospline.geometry import facing
        >>> phantom = Phantom.uniform("liver", size_mm=(40, 10, 70))
        >>> pose = facing((20, 5, 2), depth=(0, 0, 1), right=(1, 0, 0))
        >>> scanner = Scanner(phantom, Probe.linear(depth_mm=30), pose)
        >>> scanner.with_probe(replace(scanner.probe, depth_mm=60, frequency_mhz=5)).probe.depth_mm
        60
        """
        if not isinstance(probe, Probe):
            raise ValueError(f"probe = {shown(probe)} is not a Probe; make one, e.g. Probe.curvilinear()")
        other = self._twin()
        for cached in ("_noise_level", "_offset_db"):
            other.__dict__.pop(cached, None)
        other._use(probe, self.plane.shape, self._aimed.margin_mm)
        return other

    def with_picture(self, picture_shape: tuple[int, int]) -> Scanner:
        """Return the scanner with a picture of so many rows and columns; its beams show the same, bit for bit."""
        other = self._twin()
        other._use(self.probe, picture_shape, self._aimed.margin_mm)
        return other

    def with_doppler(self, doppler: Doppler | None) -> Scanner:
        """Return the scanner with colour Doppler, another one, or none."""
        if not isinstance(doppler, Doppler | None):
            raise ValueError(f"doppler = {shown(doppler)} is none; give Doppler(box_mm=...), or None")
        other = self._twin()
        other.doppler = doppler
        if (doppler is None) == (self.doppler is None):  # the same tissue is seen
            other._slow_time = other._listening()
        else:
            other._use(self.probe, self.plane.shape, self._aimed.margin_mm)
        return other

    def render(
        self,
        deformed: Field | Response | None = None,
        needle: Needle | BentNeedle | None = None,
        *,
        frame: int = 0,
        time_s: float = 0.0,
    ) -> BMode:
        """Return the image of the deformed phantom.

        A probe that sees nothing of the phantom gives a black image and a warning; a field with NaN is left out,
        with a warning: rendering never stops a simulation.

        Parameters
        ----------
        deformed : Field or Response, optional
            The deformation; a field that is not known at the nodes of its grid is sampled there. A response of a
            model brings its needles.
        needle : Needle or BentNeedle, optional
            The needle in the tissue, where it is now; by default those of the response.
        frame : int, default: 0
            Number of the frame: electronic noise differs from frame to frame.
        time_s : float, default: 0
            When it is: under Doppler, blood is where it has flowed by then.
        """
        field, needles = _parted(deformed)
        needles = needles if needle is None else (needle,)
        grid_field = self._still if field is None else at_nodes(field)
        largest = _largest(grid_field)
        if not np.isfinite(largest):
            logger.warning("the field contains NaN or infinity; the tissue is shown undeformed")
            grid_field, largest = self._still, 0.0
        self._look(grid_field, largest)
        echoes, shadow = self._seen(needles, self.optics, self.probe_to_reference)
        tiles = noise(self.seed, _NOISE_TILES * 2 * self.probe.lines * self.probe.samples)
        start = 2 * (frame * 7919 % ((_NOISE_TILES - 1) * self.probe.lines * self.probe.samples))
        colour, box = None, self._slow_time
        if box is not None and self._blood is not None:
            (blood,) = self._blood.heard(np.array([time_s]), self.probe_to_reference, grid_field, largest)
            in_box = self._seen(needles, box.optics, box.pose(self.probe_to_reference))
            pulse = Pulse(grid_field, in_box, box.noise_level(self._noise_db), frame)
            colour = box.flow(self._tissue, self.probe_to_reference, pulse, largest, time_s)
            echoes = np.concatenate([echoes, blood])
        iq, grey, picture = self._aimed.plan.render(
            grid_field.along_axes, grid_field.grid.spacing, echoes, shadow, needle_synthesis.SHADOW_SOFT_MM,
            tiles[start:], self._noise_level, self._offset_db, self.display.range_db,
            *self._clutter.heard(
                self._tissue, self.probe_to_reference, grid_field, largest, (echoes, shadow), tiles,
            ),
        )  # fmt: skip
        return BMode(
            Frame(self.display.mapped(picture), self.plane, self._scan.fan, colour),
            grey,
            iq.view(np.complex64)[..., 0],
            self.optics,
        )

    def _seen(
        self, needles: tuple[Needle | BentNeedle, ...], optics: Optics, place: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Echoes of needles, and the shadow of all: it begins with the nearest."""
        if not needles:
            return _no_needle(optics.probe)
        found = [
            needle_synthesis.echo(self.needle_echo, needle, optics, place, self.seed, real=self.artefacts.needle)
            for needle in needles
        ]
        if len(found) == 1:
            return found[0]
        shadows = [shadow for _, shadow in found]
        begins = np.minimum.reduce([shadow[0] for shadow in shadows])
        left = np.multiply.reduce([shadow[1] for shadow in shadows])
        return np.concatenate([echoes for echoes, _ in found]), np.stack([begins, left])

    def with_display(self, **settings: Any) -> Scanner:
        """Return the scanner with some knobs of its :class:`Display` turned; nothing is computed anew."""
        other = self._twin()
        other.display = replace(self.display, **settings)
        for cached in ("_offset_db", "_noise_level"):
            other.__dict__.pop(cached, None)
        return other

    def __repr__(self) -> str:
        return f"Scanner({self.probe!r}, {self.phantom!r})"

    def _twin(self) -> Scanner:
        """A scanner that shares everything with this one."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def _use(self, probe: Probe, picture_shape: tuple[int, int] | None, margin_mm: float) -> None:
        self.probe, self.optics = probe, Optics(probe)
        self.plane = picture_plane(probe, self.probe_to_reference, picture_shape)
        self._scan = Scan.of(probe, self.plane)
        self._aimed = Aimed(self.optics, self._scan, margin_mm)
        self._clutter = Clutter(self.artefacts, self.optics, margin_mm, self.seed)
        self._tissue = self.phantom if self.doppler is None else self.phantom.still
        self._slow_time = self._listening()
        self._blood = None if self.doppler is None else BloodEchoes(self.phantom, self.optics, self.seed)

    def _listening(self) -> SlowTime | None:
        if self.doppler is None:
            return None
        return SlowTime(self.doppler, self.probe, self.phantom, self.plane, self._aimed.margin_mm, self.seed)

    def _look(self, field: GridField, largest_mm: float) -> None:
        sees = self._aimed.look(
            self._tissue, self.probe_to_reference, field, largest_mm, self.seed,
            diffuse=self.artefacts.diffuse, power=self.optics.speckle_power,
        )  # fmt: skip
        if sees is False and not self._blind:  # said once, until it has seen something
            logger.warning("the probe sees nothing: its plane misses the phantom, or all of it is fluid")
        self._blind = self._blind if sees is None else not sees

    @cached_property
    def _still(self) -> GridField:
        lattice = self.phantom.labels.lattice
        grid = Grid.covering(lattice.extent, nodes=20_000, origin=lattice.origin, direction=lattice.direction)
        return GridField(grid, np.zeros((*grid.shape, 3), np.float32))

    @property
    def _noise_db(self) -> float:
        return self.display.noise_db + (HARMONIC_NOISE_DB if self.probe.harmonic else 0)

    @cached_property
    def _noise_level(self) -> float:
        return float(np.sqrt(self.optics.speckle_power[0] / 2) * 10 ** (self._noise_db / 20))

    @cached_property
    def _offset_db(self) -> NDArray[np.float32]:
        return self.display.offset_db(self.probe, self.optics.speckle_power)


def _parted(deformed: Field | Response | None) -> tuple[Field | None, tuple[Needle | BentNeedle, ...]]:
    """The field and the needles of what is to be shown."""
    if deformed is None or isinstance(deformed, Field):
        return deformed, ()
    try:
        return deformed.field, tuple(needle for _, needle in deformed.state.needles)
    except AttributeError:
        raise ValueError(f"deformed = {shown(deformed)} is no Field and no Response; give one, or nothing") from None


@lru_cache(maxsize=8)
def _no_needle(probe: Probe) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    shadow = np.stack([np.full(probe.lines, 2 * probe.depth_mm), np.ones(probe.lines)]).astype(np.float32)
    return np.zeros((0, 4), np.float32), shadow


def _largest(field: GridField) -> float:
    """Largest component of a displacement; NaN where there is one."""
    values = field.along_axes
    return float(max(values.max(), -values.min()))
