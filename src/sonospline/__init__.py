"""Sonospline: real-time tissue deformation under a needle, for ultrasound-guided surgery simulation.

Not a medical device; not for clinical use.
"""

from .field import ComposedField, Field, InverseReport, KernelField
from .grid import FACES, Grid
from .grid_field import GridField
from .insertion import Insertion
from .interaction import NeedleTissueModel
from .kelvinlet import DragModel, Kelvinlet, KelvinletField, KelvinletInsertion
from .kernels import Biharmonic, Kernel, Triharmonic
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
    "Needle",
    "NeedleTissueModel",
    "PolyharmonicSpline",
    "Tissue",
    "Triharmonic",
]


def __getattr__(name: str) -> str:
    """Look the version up only when asked: it costs more than the rest of the import."""
    if name == "__version__":
        from importlib.metadata import version

        return version("sonospline")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
