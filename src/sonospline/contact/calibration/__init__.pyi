from .closed_form import Layer as Layer
from .closed_form import force_along as force_along
from .force_curve import ForceCurve as ForceCurve
from .force_fit import Estimate as Estimate
from .force_fit import ForceFit as ForceFit
from .force_fit import fit_forces as fit_forces
