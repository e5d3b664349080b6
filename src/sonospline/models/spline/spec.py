"""The paper's model as the registry offers it; what computes is imported when a model is made."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from ...fields.polyharmonic import KERNELS
from ...mechanics.interaction import AMPLITUDES, NeedleTissueModel
from ..option import Option
from ..registry import ModelSpec

if TYPE_CHECKING:
    from ...geometry.tissue import Tissue
    from ...mechanics.material import Material
    from .faces import Progress
    from .model import Accumulation, SplineModel

_LENGTHS = {
    "shaft_displacement": "drag of tissue at the shaft",
    "shaft_pull": "pull of tissue towards the shaft",
    "shaft_radius": "how far from the shaft tissue is moved",
    "shaft_decay": "radial decay of the drag",
    "pull_decay": "radial decay of the pull",
    "tip_displacement": "push ahead of the tip",
    "tip_radius": "radius of what the tip pushes",
    "tip_length": "length of what the tip pushes",
}
"""The parameters of :class:`NeedleTissueModel`; those not given are Table I's."""


def _make(
    tissue: Tissue,
    materials: Material,
    *,
    kernel: str,
    smoothing: float,
    anchors: int | Literal["all"],
    max_landmarks: int,
    accumulation: Accumulation,
    build_up_mm: float | None,
    progress: Progress | None,
    **lengths: float | None,
) -> SplineModel:
    from .model import SplineModel

    preset = NeedleTissueModel.paper_incremental if accumulation == "incremental" else NeedleTissueModel.paper
    given = {name: value for name, value in lengths.items() if value is not None}
    effect = replace(preset(tissue.grid.side), **given)
    return SplineModel(
        tissue,
        effect,
        kernel=KERNELS[kernel](),
        anchors=anchors,
        max_landmarks=max_landmarks,
        smoothing=smoothing,
        accumulation=accumulation,
        build_up=_gentle(effect, accumulation) if build_up_mm is None else build_up_mm,
        progress=progress,
    )


def _gentle(effect: NeedleTissueModel, accumulation: Accumulation) -> float:
    """A depth to build up over, so long that tissue never moves faster than the needle; none in Algorithm 1."""
    return 0.0 if accumulation == "incremental" else 2 * max(effect.shaft_displacement, effect.tip_displacement)


SPEC = ModelSpec(
    name="paper",
    title="Paper spline",
    summary="U = r, landmarks displaced by Table I; the paper's model",
    maker=_make,
    options=(
        Option(name="kernel", kind="choice", default="biharmonic", choices=tuple(KERNELS), help="spline kernel"),
        Option(name="smoothing", default=0.0, low=0, high=1e9, help="0 meets every landmark"),
        Option(name="anchors", kind="whole", default=5, low=2, high=1000, choices=("all",),
               help="anchors along a face side, or every face node"),
        Option(name="max_landmarks", kind="whole", default=300, low=1, high=1_000_000, help="most landmarks"),
        Option(name="accumulation", kind="choice", default="maximum", choices=("maximum", "incremental"),
               help="map from the reference, or Algorithm 1's moving mesh"),
        *(
            Option(name=name, unit="mm", low=0 if name in AMPLITUDES else 1e-6, high=1e6, help=f"{what} (Table I)")
            for name, what in _LENGTHS.items()
        ),
        Option(name="build_up_mm", unit="mm", low=0, high=1e6, live=(0, 50),
               help="depth over which displacements build up; 0 as printed, by default twice the largest"),
    ),
    reports_progress=True,
)  # fmt: skip
