"""What every finite element engine is given, and what it gives back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..mechanics.layers import turned
from ..mechanics.material import Material
from ..mechanics.moduli import Moduli

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SOLVERS = ("multigrid", "direct", "from_scratch")

_LOCKS_ABOVE = 0.47
_MEAN_DILATATION_UP_TO = 0.499


class StepTimes(NamedTuple):
    """Where the seconds of one solve went."""

    assembly_s: float
    """Making the matrices."""
    setup_s: float
    """Making the multigrid hierarchy or the factor."""
    load_s: float
    """Making the right-hand side."""
    solve_s: float
    """Iterating or substituting back."""
    iterations: int
    """Of conjugate gradients; 0 for a back-substitution."""

    @classmethod
    def between(cls, clock: list[float], iterations: int) -> StepTimes:
        """Return the times between five readings of a clock."""
        assembly, setup, load, solve = np.diff(clock).tolist()
        return cls(assembly, setup, load, solve, iterations)

    @property
    def total_s(self) -> float:
        """All of it."""
        return self.assembly_s + self.setup_s + self.load_s + self.solve_s


@dataclass(frozen=True, eq=False)
class System:
    """-div sigma = b on a mesh, with what of it stays for every load.

    Displacements are continuous and linear along each edge; sigma is Hooke's law,
    2 mu eps + lambda tr(eps) I, with the trace replaced by its mean over the element for
    ``integration="mean_dilatation"``, and what layers resist of the mean strain.
    """

    points: Array
    """(N, 3) positions of the nodes, along axes of their own."""
    cells: NDArray[np.int64]
    """(E, 8) or (E, 4) node numbers, as :func:`sonospline.fem.mesh.cells` orders them."""
    pinned: Mask
    """(N,) nodes whose displacement is prescribed, all components of it."""
    material: Material | Moduli
    integration: str
    """One of :data:`~sonospline.mechanics.moduli.INTEGRATIONS`."""
    solver: str
    """One of :data:`SOLVERS`."""
    tolerance: float
    """Largest residual left by conjugate gradients, relative to the right-hand side."""
    axes: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) the axes of the points, as columns along those of the grid, whose layers the material has."""

    @property
    def moduli(self) -> tuple[Array, Array]:
        """First and second Lamé modulus: () of all cells, or (E,) of each."""
        both = (np.asarray(values, float) for values in self.material.lame_moduli)
        lame, shear = (np.repeat(m, len(self.cells) // m.size) if m.ndim else m for m in both)
        return lame, shear

    @property
    def springs(self) -> Array:
        """(N, 3, 3) by which bone that fills cells in part holds the nodes; (0, 3, 3) where there is none."""
        if isinstance(self.material, Material) or not len(self.material.bone.cells):
            return np.zeros((0, 3, 3))
        along = self.material.springs.reshape(3, -1)
        return np.einsum("an,ab,ac->nbc", along, self.axes, self.axes)

    @property
    def layers(self) -> tuple[NDArray[np.int64], Array]:
        """Elements (n,) that are layered, and their excess stiffness (n, 6, 6) as in :class:`Layers`."""
        if isinstance(self.material, Material):
            return np.zeros(0, np.int64), np.zeros((0, 6, 6))
        shape, layers = self.material.shear.shape, self.material.layers
        of_each = len(self.cells) // self.material.shear.size
        first = of_each * np.ravel_multi_index(tuple(layers.cells.T), shape)
        excess = turned(layers.excess, self.axes)
        return (first[:, None] + np.arange(of_each)).ravel(), np.repeat(excess, of_each, axis=0)


class Engine(ABC):
    """Solves a :class:`System` for one load after another."""

    @abstractmethod
    def __init__(self, system: System) -> None: ...

    @abstractmethod
    def solve(self, body_force: Array, prescribed: Array, held: Mask | None = None) -> tuple[Array, StepTimes]:
        """Return the displacement (N, 3) of the nodes, and where the time went.

        Parameters
        ----------
        body_force : (N, 3) array
            Force per volume at the nodes, linear between them: the nodal load is the
            consistent mass matrix times it.
        prescribed : (N, 3) array
            Displacement at the pinned nodes and the held components; not read elsewhere.
        held : (N, 3) array of bool, optional
            Further components with a prescribed displacement.

        Raises
        ------
        RuntimeError
            Conjugate gradients did not converge.
        """


def check_locking(material: Material | Moduli, element: str, integration: str) -> None:
    """Raise ValueError where these elements lock: nearly incompressible tissue then looks too stiff."""
    ratio = material.poissons_ratio
    if integration == "full" or element == "tetrahedron":
        if ratio > _LOCKS_ABOVE:
            what = "linear tetrahedra lock" if element == "tetrahedron" else "integration = 'full' locks"
            raise ValueError(
                f"poissons_ratio = {ratio:g} with element = {element!r}: {what} above {_LOCKS_ABOVE}; "
                "use element='hexahedron' with integration='mean_dilatation'"
            )
    elif ratio > _MEAN_DILATATION_UP_TO:
        raise ValueError(
            f"poissons_ratio = {ratio:g} is too near to 0.5 to be solved accurately; "
            f"give at most {_MEAN_DILATATION_UP_TO}"
        )
