"""The short form of the Kelvinlet model: one needle, pose after pose."""

from __future__ import annotations

from ...fields.kelvinlet_field import KelvinletField
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ..insertion import NeedleInsertion
from .drag import DragModel
from .model import KelvinletModel


class KelvinletInsertion(NeedleInsertion):
    """A needle insertion into homogeneous tissue without a mesh, by a :class:`KelvinletModel`.

    Parameters
    ----------
    tissue, anchors
        As for :class:`KelvinletModel`.
    model : DragModel, optional
        The needle's effect; by default :meth:`DragModel.kelvinlet` of the grid's side.

    Examples
    --------
    >>> import sonospline as ss
    >>> insertion = ss.KelvinletInsertion(ss.Tissue(ss.Grid.unit_cube(25)))
    >>> field = insertion.advance(ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> bool(0.02 < abs(field.on_grid()).max() < 0.03)
    True
    """

    tissue_model: KelvinletModel

    def __init__(self, tissue: Tissue, model: DragModel | None = None, *, anchors: int = 7) -> None:
        super().__init__(KelvinletModel(tissue, model, anchors=anchors))
        self.model = self.tissue_model.drag
        self.anchors = self.tissue_model.anchors

    @property
    def landmark_count(self) -> int:
        """Landmarks on the shaft at the present pose."""
        return 0 if self.needle is None else len(self.tissue_model.landmarks(self.needle))

    def solve(self, needle: Needle) -> KelvinletField:
        """Return the exact sum of Kelvinlets for a pose; the insertion stays where it is."""
        return self.tissue_model.solve(needle)
