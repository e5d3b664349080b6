from .twin import BmodePlan as BmodePlan
from .twin import CholeskyFactor as CholeskyFactor
from .twin import EchoScene as EchoScene
from .twin import ElasticMultigrid as ElasticMultigrid
from .twin import ForceLaw as ForceLaw
from .twin import MultilevelPlan as MultilevelPlan
from .twin import clipped_forces as clipped_forces
from .twin import crc64 as crc64
from .twin import displacement_at as displacement_at
from .twin import followed as followed
from .twin import gradient_at_points as gradient_at_points
from .twin import gradient_lattice as gradient_lattice
from .twin import invert_lattice as invert_lattice
from .twin import kelvinlet_sum as kelvinlet_sum
from .twin import kernel_matrix as kernel_matrix
from .twin import nodal_force_vectors as nodal_force_vectors
from .twin import nodal_forces as nodal_forces
from .twin import resample_lattice as resample_lattice
from .twin import reslice as reslice
from .twin import sample_lattice as sample_lattice
from .twin import sum_at_points_f32 as sum_at_points_f32
from .twin import sum_at_points_f64 as sum_at_points_f64
from .twin import sum_on_lattice_f32 as sum_on_lattice_f32
from .twin import sum_on_lattice_f64 as sum_on_lattice_f64
from .twin import undeformed_points as undeformed_points

def instruction_sets() -> list[str]: ...
def instruction_set() -> str: ...
def use_instruction_set(name: str) -> None: ...
def thread_count() -> int: ...
def set_thread_count(count: int) -> None: ...
