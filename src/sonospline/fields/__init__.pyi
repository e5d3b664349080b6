from .field import ComposedField as ComposedField
from .field import Field as Field
from .field import InverseReport as InverseReport
from .field import KernelField as KernelField
from .grid_field import GridField as GridField
from .kernel import Kernel as Kernel
