from .insertion import Insertion as Insertion
from .model import SplineModel as SplineModel
from .model import SplineState as SplineState
from .spline import PolyharmonicSpline as PolyharmonicSpline
