"""The image a probe would show: slices of a field, real images that deform, synthetic B-mode."""

from .acoustics import TISSUES, AcousticTissue
from .dicom import Clip, Region, read_dicom
from .frame import Frame
from .kidney import KidneyPhantom, kidney_phantom
from .needle_echo import NeedleEcho
from .plane import ImagePlane
from .pose import facing
from .probe import Probe
from .reslice import Reslicer, swept
from .scene import Scene
from .slices import NodeSlice, PlaneSlice
from .synthesis import BMode, Display, Ultrasound

__all__ = [
    "TISSUES",
    "AcousticTissue",
    "BMode",
    "Clip",
    "Display",
    "Frame",
    "ImagePlane",
    "KidneyPhantom",
    "NeedleEcho",
    "NodeSlice",
    "PlaneSlice",
    "Probe",
    "Region",
    "Reslicer",
    "Scene",
    "Ultrasound",
    "facing",
    "kidney_phantom",
    "read_dicom",
    "swept",
]
