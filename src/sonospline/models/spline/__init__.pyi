from .insertion import Insertion as Insertion
from .insertion import NeedleInsertion as NeedleInsertion
from .interaction import History as History
from .interaction import NeedleTissueModel as NeedleTissueModel
from .landmarks import LandmarkPlan as LandmarkPlan
from .landmarks import plan_landmarks as plan_landmarks
from .landmarks import select_anchors as select_anchors
from .spline import PolyharmonicSpline as PolyharmonicSpline
