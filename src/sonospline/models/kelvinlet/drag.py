"""How a needle drags homogeneous tissue: the one parameter of the Kelvinlet model."""

from __future__ import annotations

from dataclasses import dataclass

from ... import _validate
from ...fields.kelvinlet import Kelvinlet

DRAG = 0.0279
"""In cube sides, for load case F."""


@dataclass(frozen=True, kw_only=True)
class DragModel:
    """How the needle drags homogeneous tissue: one displacement along the whole shaft.

    Parameters
    ----------
    drag : float
        Displacement of tissue at the shaft, along the needle. At or above zero.
    spacing : float
        Distance of landmarks along the shaft. Above zero.
    kernel : Kelvinlet
        How the tissue around follows.
    build_up : float, default: 0.0
        Depth over which the drag builds up from nothing (see :func:`~sonospline.mechanics.built_up`). At or above
        zero, where the whole acts at once.

    Examples
    --------
    >>> import sonospline as ss
    >>> ss.DragModel.kelvinlet(side=100).kernel.width
    10.0
    """

    drag: float
    spacing: float
    kernel: Kelvinlet
    build_up: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "drag", _validate.number("drag", self.drag))
        object.__setattr__(self, "spacing", _validate.number("spacing", self.spacing, positive=True))
        object.__setattr__(self, "build_up", _validate.number("build_up", self.build_up))

    @classmethod
    def kelvinlet(
        cls,
        side: float = 1.0,
        *,
        drag: float | None = None,
        poissons_ratio: float = 0.45,
        build_up: float | None = None,
    ) -> DragModel:
        """Return the model for a cube of a side.

        The default drag is the one that least squares finds for load case F on the three
        tuning insertions; it is linear in load over stiffness. By default it builds up over twice
        its length, so that tissue never moves faster than the needle.
        """
        side = _validate.number("side", side, positive=True)
        drag = _validate.number("drag", DRAG * side if drag is None else drag)
        return cls(
            drag=drag,
            spacing=0.04 * side,
            kernel=Kelvinlet(poissons_ratio, 0.1 * side),
            build_up=2 * drag if build_up is None else build_up,
        )
