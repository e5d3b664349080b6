"""A needle advances through elastic tissue, one multigrid iteration a frame."""

from __future__ import annotations

from ...fields.grid_field import GridField
from ...geometry.needle import Needle
from ...geometry.tissue import Tissue
from ...mechanics.loads import LineForce
from ...mechanics.material import Material
from ...mechanics.tissue_force import TissueForce
from ...mechanics.tissue_map import TissueMap
from ..spline.insertion import NeedleInsertion
from .solver import ElasticSolver, ElasticState, NotConvergedError
from .strain import Strain, largest_strain

_SETTLE_ITERATIONS = 2
_MOST_ROUNDS = 40


class ElasticInsertion(NeedleInsertion):
    """A needle insertion into tissue of known stiffness, in mm, kPa and mN.

    Each :meth:`advance` loads the tissue with the friction and the tip force of the needle's
    pose and improves the last frame's field by one iteration. A step that fails raises and
    leaves the previous :attr:`field` in force.

    Parameters
    ----------
    tissue : Tissue
        The display grid and its free face.
    material : Material or TissueMap
        One stiffness everywhere, or labelled tissue.
    load : LineForce, optional
        What the needle does. By default, of labelled tissue its own friction and cutting
        force; else :meth:`LineForce.for_cube` of the box and the material.
    nodes : int, default: 15625
        Nodes of the solver's grid, about.
    integration : {"mean_dilatation", "full"}, default: "mean_dilatation"
        As for :class:`ElasticSolver`.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.elastic import ElasticInsertion, scene
    >>> tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    >>> insertion = ElasticInsertion(tissue, scene("layers", side=100, stiffness_kpa=10), nodes=13**3)
    >>> fields = list(insertion.run((0, 50, 50), (60, 50, 50), steps=10))
    >>> bool(fields[-1].error_estimate < 0.05), bool(0.5 < abs(fields[-1].on_grid()).max() < 3)
    (True, True)
    """

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap,
        load: LineForce | None = None,
        *,
        nodes: int = 25**3,
        integration: str = "mean_dilatation",
    ) -> None:
        self.solver = ElasticSolver(tissue, material, nodes=nodes, integration=integration)
        self.tissue = tissue
        self.load = _default_load(tissue, material) if load is None else load
        self.reset()

    def reset(self) -> None:
        """Take the needle out and let the tissue return to its undeformed state."""
        self.needle: Needle | None = None
        self.state: ElasticState = self.solver.rest
        self.field: GridField = self.solver.field(self.state)

    def advance(self, needle: Needle) -> GridField:
        """Move the needle to a pose and return the field one frame later.

        Raises
        ------
        ValueError
            A needle outside the tissue.
        NotConvergedError
            The step broke down; :attr:`field` is still the previous one.
        """
        self._take(self.solver.step(self.state, self.load, needle), needle)
        return self.field

    def settle(self, tolerance: float = 5e-3) -> GridField:
        """Iterate at the present pose until the error estimate is at most ``tolerance``.

        Raises
        ------
        NotConvergedError
            It does not get there; :attr:`field` is the best one found.
        """
        for _ in range(_MOST_ROUNDS):
            if self.needle is None or self.state.error <= tolerance:
                return self.field
            self._take(self.solver.step(self.state, self.load, self.needle, iterations=_SETTLE_ITERATIONS), self.needle)
        raise NotConvergedError(f"the error estimate stays at {self.state.error:.1e}, above tolerance = {tolerance:g}")

    def largest_strain(self) -> Strain:
        """Return the largest displacement gradient of the present field, and where it is."""
        return largest_strain(self.field)

    def _take(self, state: ElasticState, needle: Needle) -> None:
        self.state, self.needle, self.field = state, needle, self.solver.field(state)


def _default_load(tissue: Tissue, material: Material | TissueMap) -> LineForce:
    if isinstance(material, TissueMap):
        return TissueForce(tissues=material, width=LineForce().width * tissue.grid.side)
    return LineForce.for_cube(tissue.grid.side, material.youngs_modulus)
