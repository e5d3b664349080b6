"""Sonospline: real-time tissue deformation under a needle, for ultrasound-guided surgery simulation.

Not a medical device; not for clinical use.
"""

from typing import TYPE_CHECKING, Any

from ._later import later

if TYPE_CHECKING:
    from .field import ComposedField, Field, InverseReport, KernelField
    from .grid import FACES, Grid
    from .grid_field import GridField
    from .insertion import Insertion
    from .interaction import NeedleTissueModel
    from .io.labels import read_labels
    from .kelvinlet import DragModel, Kelvinlet, KelvinletField, KelvinletInsertion
    from .kernels import Biharmonic, Kernel, Triharmonic
    from .label_map import LabelMap
    from .needle import Needle
    from .spline import PolyharmonicSpline
    from .tissue import Tissue

__all__ = [
    "FACES",
    "Biharmonic",
    "ComposedField",
    "DragModel",
    "Field",
    "Grid",
    "GridField",
    "Insertion",
    "InverseReport",
    "Kelvinlet",
    "KelvinletField",
    "KelvinletInsertion",
    "Kernel",
    "KernelField",
    "LabelMap",
    "Needle",
    "NeedleTissueModel",
    "PolyharmonicSpline",
    "Tissue",
    "Triharmonic",
    "read_labels",
]

_HOMES = {
    "kernels": ("Biharmonic", "Kernel", "Triharmonic"),
    "field": ("ComposedField", "Field", "InverseReport", "KernelField"),
    "kelvinlet": ("DragModel", "Kelvinlet", "KelvinletField", "KelvinletInsertion"),
    "grid": ("FACES", "Grid"),
    "grid_field": ("GridField",),
    "insertion": ("Insertion",),
    "io.labels": ("read_labels",),
    "label_map": ("LabelMap",),
    "needle": ("Needle",),
    "interaction": ("NeedleTissueModel",),
    "spline": ("PolyharmonicSpline",),
    "tissue": ("Tissue",),
}
_find, __dir__ = later(__name__, {name: home for home, names in _HOMES.items() for name in names})


def __getattr__(name: str) -> Any:
    """Look the version up only when asked: it costs more than the rest of the import."""
    if name == "__version__":
        from importlib.metadata import version

        return version("sonospline")
    return _find(name)
