"""The Kelvinlet model as the registry offers it; what computes is imported when a model is made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..option import Option
from ..registry import ModelSpec

if TYPE_CHECKING:
    from ...geometry.tissue import Tissue
    from ...mechanics.material import Material
    from .model import KelvinletModel


def _make(
    tissue: Tissue, materials: Material, *, drag_mm: float | None, anchors: int, build_up_mm: float | None
) -> KelvinletModel:
    from .drag import DragModel
    from .model import KelvinletModel

    drag = DragModel.kelvinlet(
        tissue.grid.side, drag=drag_mm, poissons_ratio=materials.poissons_ratio, build_up=build_up_mm
    )
    return KelvinletModel(tissue, drag, anchors=anchors)


SPEC = ModelSpec(
    name="kelvinlet",
    title="Kelvinlet",
    summary="elastic kernel, one drag along the axis; mesh-free, homogeneous",
    maker=_make,
    options=(
        Option(name="drag_mm", unit="mm", low=0, high=1e4, live=(0, 50),
               help="displacement at the shaft; by default 0.028 of the side"),
        Option(name="anchors", kind="whole", default=7, low=2, high=1000, help="anchors along a face side"),
        Option(name="build_up_mm", unit="mm", low=0, high=1e6, live=(0, 50),
               help="depth over which the tip comes to act; by default twice the drag"),
    ),
    properties=("poissons_ratio",),
)  # fmt: skip
