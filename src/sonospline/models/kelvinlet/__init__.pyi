from .drag import DragModel as DragModel
from .insertion import KelvinletInsertion as KelvinletInsertion
from .model import KelvinletModel as KelvinletModel
