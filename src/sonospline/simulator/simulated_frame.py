"""One frame of the simulator: the picture and everything that belongs to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fields.grid_field import GridField
from ..geometry.needle import Needle
from ..mechanics.breath import Breath
from ..models.contract import NeedleForce, Response
from ..ultrasound.frame import Frame
from ..ultrasound.probe import Probe
from .command import ImageSettings
from .imaging import out_of_plane
from .readouts import Readouts
from .tissue_settings import TissueSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedFrame:
    """One frame. With it, a session can go on from here again: :meth:`Session.resume`."""

    number: int
    """From 0; the picture's noise goes by it."""
    time_s: float
    """Of the session: the sum of what its steps were given."""
    dt: float
    """What the step to this frame was given of it."""
    image: Frame
    probe: Probe
    """As the settings have tuned it."""
    probe_to_reference: Array
    """(4, 4) pose of the probe, origin in the middle of its face."""
    settings: ImageSettings
    tissue: TissueSettings
    """What was asked of tissue in time; models without time heed none of it."""
    needles: Mapping[str, Needle]
    """Those in the tissue, by name; the picture shows the first."""
    undeformed: Mapping[str, Needle]
    """The same as tissue has them that nobody's breath moves, which is what a model is asked; without any that are
    where no tissue is."""
    model: str
    """Which model of tissue answered."""
    response: Response | None
    """What it answered: field, forces; None while the tissue is at rest and nobody asked."""
    events: tuple[object, ...]
    """What happened in the step: needles that rest on bone, or have just come to, and what the model says."""
    field: GridField
    """The deformation as the picture shows it: linear between the nodes of the display grid."""
    by_needles: GridField
    """What of it is the needles', in undeformed tissue; the same where nobody breathes."""
    breath: Breath | None
    """Whose; None while nobody breathes."""
    target: str
    target_rest: Array
    target_now: Array
    """Where the target is, by the model's own field."""
    readouts: Readouts
    step_ms: float
    """What the tissue took to answer."""
    render_ms: float
    """What the picture took."""

    @property
    def needle(self) -> Needle | None:
        """The needle the picture shows; None while it is out."""
        return next(iter(self.needles.values()), None)

    @property
    def settled(self) -> bool:
        """Whether the tissue has come to rest: at the same poses and time another step would change nothing."""
        return self.response is None or self.response.settled

    @property
    def moves(self) -> bool:
        """Whether time alone changes it."""
        return self.breath is not None or self.image.colour is not None

    @property
    def forces(self) -> Mapping[str, NeedleForce]:
        """Of each needle on the tissue, where the model knows them."""
        return {} if self.response is None else self.response.forces

    @property
    def image_to_reference(self) -> Array:
        """(4, 4) pose of the picture, origin at the centre of pixel (0, 0)."""
        return self.image.plane.image_to_reference

    def out_of_plane(self, point: Array) -> tuple[float, float]:
        """Return how far a point is out of the image plane, away from the viewer, and half the slice there, mm."""
        return out_of_plane(self.probe, self.probe_to_reference, point)

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}: {needle.depth:.4g} mm" for name, needle in self.needles.items()) or "no needle"
        rows, columns = self.image.pixels.shape
        return f"{type(self).__name__}({self.number}, {self.model}, {inside}, {rows} x {columns} pixels)"
