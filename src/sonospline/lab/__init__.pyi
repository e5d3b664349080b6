from .attempt_record import AttemptRecord as AttemptRecord
from .cusum import Cusum as Cusum
from .cusum import LearningCurve as LearningCurve
from .result_store import ResultStore as ResultStore
from .result_tables import write_tables as write_tables
from .standing import Standing as Standing
