from .drag import DragModel as DragModel
from .field import KelvinletField as KelvinletField
from .insertion import KelvinletInsertion as KelvinletInsertion
from .kernel import Kelvinlet as Kelvinlet
from .model import KelvinletModel as KelvinletModel
