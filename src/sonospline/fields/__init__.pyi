from .field import ComposedField as ComposedField
from .field import Field as Field
from .field import InverseReport as InverseReport
from .field import KernelField as KernelField
from .grid_field import GridField as GridField
from .kernels import Biharmonic as Biharmonic
from .kernels import Kernel as Kernel
from .kernels import Triharmonic as Triharmonic
