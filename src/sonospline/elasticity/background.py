"""Tissue that moves whatever the needle does: breathing, and the probe that presses on the skin.

u_b(x, t) = s(t) B(x) + sum_k w_k D_k(x): the diaphragm's excursion times the field of one millimetre of it, and the
dents between which the probe is: four while it slides and presses, seven at most. All are solved once; a frame costs a
multiplication and an addition for each number of each of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._by_bits import ByBits
from .._shown import shown
from ..fields.grid_field import GridField
from ..geometry import pose
from ..geometry.needle import Needle
from ..mechanics.breathing import ORGAN_RATIO, Breathing
from ..mechanics.footprint import Footprint
from ..mechanics.stiffening import Stiffening
from .diaphragm import carried_by_diaphragm
from .probe_contact import ProbeContact
from .probe_dents import Blend, ProbeDents
from .solver import ElasticSolver
from .weighted import weighted

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_HALVINGS = 30
_ALONG = 17
"""Points of a needle that are taken back to rest: it meets the skin between two of them."""


@dataclass(frozen=True, eq=False, repr=False)
class Background(ByBits):
    """Where tissue is without a needle, at a time and under a probe."""

    displacement: Single
    """(3, nx, ny, nz) on the solver's nodes, along the axes of its grid, mm; read-only."""
    excursion_mm: float = 0.0
    """Of the diaphragm, towards the feet."""
    probe_force_n: float = 0.0
    """Of the probe on the tissue, into it, N."""

    def __repr__(self) -> str:
        return f"Background({self.excursion_mm:.3g} mm of breath, probe {self.probe_force_n:.3g} N)"


class BackgroundMotion:
    """Breathing and the pressed probe, on the nodes of an elastic solver: a pure function of time and the probe's pose.

    Parameters
    ----------
    solver : ElasticSolver
        The needle's: its tissue, material and nodes.
    breathing : Breathing, optional
        How the diaphragm moves; nobody breathes by default.
    cranial_face : str, optional
        The face of the tissue towards the head; needed to breathe.
    organ : (m, 3) array_like, optional
        World points of the organ that moves ``ratio`` times as far as the diaphragm; needed to breathe.
    footprint : Footprint, optional
        What of the probe presses on the skin; by default it only looks.
    stiffening : Stiffening, optional
        How its force grows faster than its depth; by default it does not.
    ratio : float, default: 0.65
        See ``organ``.

    Raises
    ------
    ValueError
        Breathing without a cranial face and an organ, or so deep that tissue folds.

    Examples
    --------
    >>> import numpy as np, sonospline as ss
    >>> from sonospline.elasticity import BackgroundMotion, ElasticSolver
    >>> from sonospline.mechanics import Breathing, Footprint, Material, Spread
    >>> tissue = ss.Tissue(ss.Grid.covering((100, 100, 60), nodes=9000), "z-")
    >>> solver = ElasticSolver(tissue, Material(10), nodes=13**3)
    >>> calm = Breathing(Spread(15, 0, 15, 15), Spread(10, 0, 10, 10))
    >>> motion = BackgroundMotion(
    ...     solver, breathing=calm, cranial_face="x-", organ=[(50, 50, 40)], footprint=Footprint(40, 16)
    ... )
    >>> probe = ss.facing((50, 50, 5), depth=(0, 0, 1), right=(1, 0, 0))
    >>> background = motion.at(2.0, probe)
    >>> background
    Background(10 mm of breath, probe 2.82 N)
    >>> round(float(motion.field(motion.at(2.0)).displacement((50, 50, 40))[0]), 2)
    6.5
    """

    def __init__(
        self,
        solver: ElasticSolver,
        *,
        breathing: Breathing | None = None,
        cranial_face: str | None = None,
        organ: ArrayLike | None = None,
        footprint: Footprint | None = None,
        stiffening: Stiffening | None = None,
        ratio: float = ORGAN_RATIO,
    ) -> None:
        if not isinstance(breathing, Breathing | None):
            raise ValueError(f"breathing = {shown(breathing)} is not a Breathing; make one, e.g. Breathing()")
        if not isinstance(footprint, Footprint | None):
            raise ValueError(f"footprint = {shown(footprint)} is not a Footprint; make one, e.g. Footprint(60, 20)")
        if not isinstance(stiffening, Stiffening | None):
            raise ValueError(f"stiffening = {shown(stiffening)} is not a Stiffening; make one, e.g. Stiffening(4.0)")
        self.solver, self.breathing = solver, breathing
        self._dents = None if footprint is None else ProbeDents(ProbeContact(solver, footprint, stiffening))
        self.carried: Single | None = None
        """(3, nx, ny, nz) displacement for each mm of the diaphragm's excursion; None where nobody breathes."""
        if breathing is not None:
            if cranial_face is None or organ is None:
                raise ValueError(
                    "breathing needs cranial_face and organ; give the face towards the head and points of it"
                )
            self.carried = carried_by_diaphragm(solver, cranial_face, organ, ratio=ratio)
            self._refuse_folds(breathing)
        self._last: tuple[Any, Blend] | None = None
        self.rest = Background(solver.rest.displacement)
        """Nothing moves."""

    def breathes(self, breathing: Breathing) -> BackgroundMotion:
        """Return the same motion with another breathing, as of a breath that is held; nothing is solved again.

        Raises
        ------
        ValueError
            Nobody breathes in this one, or tissue would fold.
        """
        if self.breathing is None:
            raise ValueError("breathing = None where this motion was made; give one there")
        changed = object.__new__(BackgroundMotion)
        changed.__dict__.update(self.__dict__, breathing=breathing)
        if breathing.largest_mm > self.breathing.largest_mm:
            changed._refuse_folds(breathing)
        return changed

    def at(
        self, t: float = 0.0, probe_to_reference: ArrayLike | None = None, *, force_n: float | None = None
    ) -> Background:
        """Return where tissue is at a time, under a probe.

        Parameters
        ----------
        t : float, default: 0
            Seconds from 0 on.
        probe_to_reference : (4, 4) array_like, optional
            Pose of the probe: rigid, origin in the middle of its face, y deep, x to the right in the image. It presses
            as deep as it lies below the skin at rest.
        force_n : float, optional
            Press so hard instead, wherever the pose is above or below the skin.

        Raises
        ------
        ValueError
            A time out of range, a probe beyond the skin or too deep, a force below zero or too large.
        NotConvergedError
            As :meth:`ProbeContact.dent`.
        """
        excursion = 0.0 if self.breathing is None else float(self.breathing.excursion(_validate.number("t", t)))
        blend = self._pressed(probe_to_reference, force_n)
        parts = [(weight, dent.displacement) for weight, dent in blend.parts]
        if self.carried is not None and excursion:
            parts.append((excursion, self.carried))
        return Background(weighted(parts), excursion, blend.force_n) if parts else self.rest

    def field(self, background: Background) -> GridField:
        """Return where tissue is as a field: cubic between the solver's nodes, on the display grid."""
        values = background.displacement.transpose(1, 2, 3, 0)
        grid = self.solver.grid
        if not grid.upright:
            values = values @ grid.direction.T.astype(np.float32)
        return GridField(self.solver.tissue.grid, values, lattice=grid, order=3)

    def at_rest(self, background: Background, needle: Needle) -> Needle | None:
        """Return a needle as undeformed tissue has it: through the points of it that its tip is in and its entry meets.

        A model of undeformed tissue takes it, and :class:`~sonospline.CarriedField` what that answers. Where skin has
        been dented away from the needle, its entry is where it meets the dent; None while it does not reach that.

        Raises
        ------
        ValueError
            A needle in tissue that the background folds, whose places at rest are not known.
        """
        return needle if background == self.rest else undeformed(self.field(background), needle)

    def _pressed(self, probe_to_reference: ArrayLike | None, force_n: float | None) -> Blend:
        """The dents of the probe; those of the last pose are kept, for probes are held for many frames."""
        if force_n is not None:
            force_n = _validate.number("force_n", force_n)
        if probe_to_reference is None or self._dents is None:
            if force_n:
                missing = "probe_to_reference" if probe_to_reference is None else "footprint"
                raise ValueError(f"force_n = {force_n:g} presses nothing: {missing} is missing")
            return Blend(())
        asked = np.asarray(probe_to_reference).tobytes(), force_n
        if self._last is None or self._last[0] != asked:
            place = pose.rigid("probe_to_reference", probe_to_reference)
            self._last = asked, self._dents.at(place, force_n)
        return self._last[1]

    def _refuse_folds(self, breathing: Breathing) -> None:
        """Raise ValueError where the deepest breath turns tissue inside out."""
        assert self.carried is not None
        grid = self.solver.grid
        per_mm = self.field(Background(self.carried)).jacobian(grid.points) - np.eye(3)

        def folds(excursion: float) -> bool:
            return bool((np.linalg.det(np.eye(3) + excursion * per_mm) <= 0).any())

        low, high = 0.0, breathing.largest_mm
        if not folds(high):
            return
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if folds(middle) else (middle, high)
        raise ValueError(
            f"breathing.excursion_mm reaches {breathing.largest_mm:.4g} mm, at which tissue in a box of "
            f"{shown(grid.extent.round(1).tolist())} mm folds; give at most {low:.3g} mm"
        )

    def __repr__(self) -> str:
        who = "nobody breathes" if self.breathing is None else repr(self.breathing)
        return f"BackgroundMotion({who}, {'no probe' if self._dents is None else repr(self._dents.contact.footprint)})"


def undeformed(background: GridField, needle: Needle) -> Needle | None:
    """Return a needle as undeformed tissue has it, by the field of a background: see :meth:`BackgroundMotion.at_rest`.

    Raises
    ------
    ValueError
        A needle in tissue that the background folds.
    """
    grid, share = background.grid, np.linspace(0, 1, _ALONG)[:, None]
    rest = background.inverse(needle.entry + share * (needle.tip - needle.entry))
    if not np.isfinite(rest).all():
        raise ValueError(f"needle = {needle} is in tissue that its background folds; press or breathe less")
    local = grid.local(rest)
    beyond = np.maximum(-local, local - grid.extent).max(axis=1)
    if beyond[-1] > 0:
        return None
    first = int(np.flatnonzero(beyond > 0).max(initial=-1)) + 1
    entry = local[0]
    if first:
        part = beyond[first - 1] / (beyond[first - 1] - beyond[first])
        entry = local[first - 1] + part * (local[first] - local[first - 1])
    return Needle(grid.world(np.clip(entry, 0, grid.extent)), grid.world(local[-1]))
