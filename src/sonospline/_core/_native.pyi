from .twin import BmodePlan as BmodePlan
from .twin import CholeskyFactor as CholeskyFactor
from .twin import EchoScene as EchoScene
from .twin import ElasticMultigrid as ElasticMultigrid
from .twin import MultilevelPlan as MultilevelPlan
from .twin import gradient_at_points as gradient_at_points
from .twin import gradient_lattice as gradient_lattice
from .twin import invert_lattice as invert_lattice
from .twin import kelvinlet_sum as kelvinlet_sum
from .twin import kernel_matrix as kernel_matrix
from .twin import line_load as line_load
from .twin import resample_lattice as resample_lattice
from .twin import reslice as reslice
from .twin import sample_lattice as sample_lattice
from .twin import sum_at_points_f32 as sum_at_points_f32
from .twin import sum_at_points_f64 as sum_at_points_f64
from .twin import sum_on_lattice_f32 as sum_on_lattice_f32
from .twin import sum_on_lattice_f64 as sum_on_lattice_f64

def instruction_sets() -> list[str]: ...
def instruction_set() -> str: ...
def use_instruction_set(name: str) -> None: ...
def thread_count() -> int: ...
def set_thread_count(count: int) -> None: ...
