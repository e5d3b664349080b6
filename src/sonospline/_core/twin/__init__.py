"""NumPy twin of the compiled core: same names, same arguments, same results, slower."""

from .bmode import BmodePlan as BmodePlan
from .cholesky import CholeskyFactor as CholeskyFactor
from .elastic import ElasticMultigrid as ElasticMultigrid
from .elastic import line_load as line_load
from .multilevel import MultilevelPlan as MultilevelPlan
from .sampling import gradient_lattice as gradient_lattice
from .sampling import invert_lattice as invert_lattice
from .sampling import resample_lattice as resample_lattice
from .sampling import reslice as reslice
from .sampling import sample_lattice as sample_lattice
from .scatterers import EchoScene as EchoScene
from .sums import gradient_at_points as gradient_at_points
from .sums import kelvinlet_sum as kelvinlet_sum
from .sums import kernel_matrix as kernel_matrix
from .sums import sum_at_points_f32 as sum_at_points_f32
from .sums import sum_at_points_f64 as sum_at_points_f64
from .sums import sum_on_lattice_f32 as sum_on_lattice_f32
from .sums import sum_on_lattice_f64 as sum_on_lattice_f64
