from .kidney import KidneyPhantom as KidneyPhantom
from .kidney import kidney_phantom as kidney_phantom
