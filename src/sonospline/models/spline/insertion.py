"""Algorithm 1: a needle advances through tissue, and each step leaves a field."""

from __future__ import annotations

from typing import Literal

from ...fields.kernel import Kernel
from ...geometry.tissue import Tissue
from ...mechanics.interaction import NeedleTissueModel
from ...mechanics.landmarks import LandmarkPlan
from ..insertion import NeedleInsertion
from .faces import Progress
from .model import Accumulation, SplineModel


class Insertion(NeedleInsertion):
    """A needle insertion into a block of tissue, Algorithm 1, by a :class:`SplineModel`.

    Parameters
    ----------
    tissue : Tissue
        Where the needle goes.
    model : NeedleTissueModel, optional
        Its effect on the tissue; by default Table I scaled to the grid's side.
    kernel, anchors, max_landmarks, smoothing, accumulation, build_up, progress
        As for :class:`SplineModel`.

    Examples
    --------
    >>> import sonospline as ss
    >>> tissue = ss.Tissue(ss.Grid.unit_cube(25), entry_face="x-")
    >>> insertion = ss.Insertion(tissue, model=ss.NeedleTissueModel.paper())
    >>> field = insertion.advance(ss.Needle(entry=(0, .5, .5), tip=(.6, .5, .5)))
    >>> field.on_grid().shape
    (25, 25, 25, 3)
    >>> bool(0.02 < abs(field.on_grid()).max() < 0.03)
    True
    """

    tissue_model: SplineModel

    def __init__(
        self,
        tissue: Tissue,
        model: NeedleTissueModel | None = None,
        *,
        kernel: Kernel | None = None,
        anchors: int | Literal["all"] = 5,
        max_landmarks: int = 300,
        smoothing: float = 0.0,
        accumulation: Accumulation = "maximum",
        build_up: float = 0.0,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(
            SplineModel(
                tissue,
                model,
                kernel=kernel,
                anchors=anchors,
                max_landmarks=max_landmarks,
                smoothing=smoothing,
                accumulation=accumulation,
                build_up=build_up,
                progress=progress,
            )
        )
        self.model = self.tissue_model.needle_effect
        self.anchors = self.tissue_model.anchors
        self.accumulation = self.tissue_model.accumulation

    @property
    def plan(self) -> LandmarkPlan | None:
        """The landmarks of the present pass; None while the needle is out."""
        return self.tissue_model.plan(self.state)

    @property
    def landmark_count(self) -> int:
        """Landmarks that the needle displaces at the present pose."""
        return self.tissue_model.landmark_count(self.response)
