from .engine import StepTimes as StepTimes
from .held_shaft import held_shaft as held_shaft
from .history import history_of as history_of
from .history import reference_history as reference_history
from .model import FiniteElementModel as FiniteElementModel
