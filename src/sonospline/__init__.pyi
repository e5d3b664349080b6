from .fields import ComposedField as ComposedField
from .fields import Field as Field
from .fields import GridField as GridField
from .fields import InverseReport as InverseReport
from .fields import Kernel as Kernel
from .fields import KernelField as KernelField
from .geometry import FACES as FACES
from .geometry import Grid as Grid
from .geometry import LabelMap as LabelMap
from .geometry import Needle as Needle
from .geometry import Tissue as Tissue
from .io.labels import read_labels as read_labels
from .models import Biharmonic as Biharmonic
from .models import DragModel as DragModel
from .models import Insertion as Insertion
from .models import Kelvinlet as Kelvinlet
from .models import KelvinletField as KelvinletField
from .models import KelvinletInsertion as KelvinletInsertion
from .models import NeedleForce as NeedleForce
from .models import NeedleTissueModel as NeedleTissueModel
from .models import PolyharmonicSpline as PolyharmonicSpline
from .models import Response as Response
from .models import State as State
from .models import TissueModel as TissueModel
from .models import Triharmonic as Triharmonic
from .simulator import Session as Session

__version__: str
