"""Sonospline: real-time tissue deformation under a needle, for ultrasound-guided surgery simulation.

Not a medical device; not for clinical use.
"""

from importlib.metadata import version as _version

from .field import ComposedField, Field, InverseReport, KernelField
from .grid import FACES, Grid
from .insertion import Insertion
from .interaction import NeedleTissueModel
from .kernels import Biharmonic, Kernel, Triharmonic
from .needle import Needle
from .spline import PolyharmonicSpline
from .tissue import Tissue

__version__ = _version("sonospline")

__all__ = [
    "FACES",
    "Biharmonic",
    "ComposedField",
    "Field",
    "Grid",
    "Insertion",
    "InverseReport",
    "Kernel",
    "KernelField",
    "Needle",
    "NeedleTissueModel",
    "PolyharmonicSpline",
    "Tissue",
    "Triharmonic",
]
