"""The short form of the elastic model: one needle, pose after pose."""

from __future__ import annotations

from ...elasticity.solver import SETTLED
from ...elasticity.state import ElasticState
from ...fields.grid_field import GridField
from ...fields.strain import Strain, largest_strain
from ...geometry.tissue import Tissue
from ...mechanics.loads import Load
from ...mechanics.material import Material
from ...mechanics.tissue_map import TissueMap
from ..insertion import NeedleInsertion
from .model import ElasticModel
from .tissue_state import ElasticTissueState


class ElasticInsertion(NeedleInsertion):
    """A needle insertion into tissue of known stiffness, in mm, kPa and mN, by an :class:`ElasticModel`.

    Parameters
    ----------
    tissue, material, load, load_at, nodes, integration
        As for :class:`ElasticModel`.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.models.elastic import ElasticInsertion
    >>> from sonospline.mechanics import labelled_cube
    >>> tissue = ss.Tissue(ss.Grid(shape=(25, 25, 25), spacing=100 / 24))
    >>> insertion = ElasticInsertion(tissue, labelled_cube("layers", side=100, stiffness_kpa=10), nodes=13**3)
    >>> fields = list(insertion.run((0, 50, 50), (60, 50, 50), steps=10))
    >>> bool(fields[-1].error_estimate < 0.05), bool(0.5 < abs(fields[-1].on_grid()).max() < 4)
    (True, True)
    """

    tissue_model: ElasticModel

    def __init__(
        self,
        tissue: Tissue,
        material: Material | TissueMap,
        load: Load | None = None,
        *,
        load_at: str = "deformed",
        nodes: int | None = None,
        integration: str = "mean_dilatation",
    ) -> None:
        super().__init__(ElasticModel(tissue, material, load, load_at=load_at, nodes=nodes, integration=integration))
        self.solver = self.tissue_model.solver
        self.load = self.tissue_model.load

    def settle(self, tolerance: float = SETTLED) -> GridField:
        """Iterate at the present pose until the error estimate is at most ``tolerance``.

        Raises
        ------
        NotConvergedError
            It does not get there; :attr:`field` is still the previous one.
        """
        self.response = self.tissue_model.settle(self.response, tolerance=tolerance)
        assert isinstance(self.field, GridField)
        return self.field

    @property
    def solution(self) -> ElasticState:
        """What the solver has so far."""
        assert isinstance(self.state, ElasticTissueState)
        return self.state.solution

    def largest_strain(self) -> Strain:
        """Return the largest displacement gradient of the present field, and where it is."""
        assert isinstance(self.field, GridField)
        return largest_strain(self.field)
