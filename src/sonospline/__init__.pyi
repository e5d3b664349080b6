from .fields import Biharmonic as Biharmonic
from .fields import ComposedField as ComposedField
from .fields import Field as Field
from .fields import GridField as GridField
from .fields import InverseReport as InverseReport
from .fields import Kernel as Kernel
from .fields import KernelField as KernelField
from .fields import Triharmonic as Triharmonic
from .geometry import FACES as FACES
from .geometry import Grid as Grid
from .geometry import LabelMap as LabelMap
from .geometry import Needle as Needle
from .geometry import Tissue as Tissue
from .io.labels import read_labels as read_labels
from .models.kelvinlet import DragModel as DragModel
from .models.kelvinlet import Kelvinlet as Kelvinlet
from .models.kelvinlet import KelvinletField as KelvinletField
from .models.kelvinlet import KelvinletInsertion as KelvinletInsertion
from .models.spline import Insertion as Insertion
from .models.spline import NeedleTissueModel as NeedleTissueModel
from .models.spline import PolyharmonicSpline as PolyharmonicSpline

__version__: str
