from .kidney import KidneyPhantom as KidneyPhantom
from .kidney import kidney_phantom as kidney_phantom
from .wide_kidney import wide_kidney_phantom as wide_kidney_phantom
