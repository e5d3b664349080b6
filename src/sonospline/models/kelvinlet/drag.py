"""How a needle drags homogeneous tissue: the one parameter of the Kelvinlet model."""

from __future__ import annotations

from dataclasses import dataclass

from ... import _validate
from .kernel import Kelvinlet

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

    Examples
    --------
    >>> import sonospline as ss
    >>> ss.DragModel.kelvinlet(side=100).kernel.width
    10.0
    """

    drag: float
    spacing: float
    kernel: Kelvinlet

    def __post_init__(self) -> None:
        object.__setattr__(self, "drag", _validate.number("drag", self.drag))
        object.__setattr__(self, "spacing", _validate.number("spacing", self.spacing, positive=True))

    @classmethod
    def kelvinlet(cls, side: float = 1.0, *, drag: float | None = None, poissons_ratio: float = 0.45) -> DragModel:
        """Return the model for a cube of a side.

        The default drag is the one that least squares finds for load case F on the three
        tuning insertions; it is linear in load over stiffness.
        """
        side = _validate.number("side", side, positive=True)
        chosen = DRAG * side if drag is None else drag
        return cls(drag=chosen, spacing=0.04 * side, kernel=Kelvinlet(poissons_ratio, 0.1 * side))
