from .kelvinlet import DragModel as DragModel
from .kelvinlet import Kelvinlet as Kelvinlet
from .kelvinlet import KelvinletField as KelvinletField
from .kelvinlet import KelvinletInsertion as KelvinletInsertion
