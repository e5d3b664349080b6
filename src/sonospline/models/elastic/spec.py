"""The elastic model as the registry offers it; what computes is imported when a model is made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...elasticity.state import BUDGET, TOLERANCE
from ...mechanics.continued_walls import WALLS
from ...mechanics.first_touch import BUILD_UP_MM
from ...mechanics.loads import PROCESS_ZONE_MM
from ..option import Option
from ..registry import ModelSpec
from .able import ABLE

if TYPE_CHECKING:
    from ...geometry.tissue import Tissue
    from ...mechanics.material import Material
    from ...mechanics.tissue_map import TissueMap
    from .model import ElasticModel


def _make(tissue: Tissue, materials: Material | TissueMap, *, solver_nodes: int | None, **options: Any) -> ElasticModel:
    from .model import ElasticModel

    given = {name: value for name, value in options.items() if value is not None}
    return ElasticModel(tissue, materials, nodes=solver_nodes, **given)


SPEC = ModelSpec(
    name="elastic",
    title="Elastic",
    summary="live finite elements on label maps, in N and kPa",
    maker=_make,
    options=(
        Option(name="solver_nodes", kind="whole", low=8, high=10**10, live=(1000, 200_000),
               help="solver's nodes, about; by default what resolves the load"),
        Option(name="tolerance", default=TOLERANCE, low=1e-5, high=1, live=(1e-3, 1),
               help="error of the field at which a step ends"),
        Option(name="budget", kind="whole", default=BUDGET, low=1, high=200, live=(1, 100),
               help="iterations of a step, at most"),
        Option(name="needle_radius_mm", unit="mm", low=0.05, high=10, live=(0.05, 10),
               help="of the needle's shaft; of its look in a scene, else of an 18 gauge trocar"),
        Option(name="process_zone_mm", unit="mm", default=PROCESS_ZONE_MM, low=0, high=50, live=(0, 50),
               help="how far around the shaft tissue takes up its force; assumed"),
        Option(name="build_up_mm", default=BUILD_UP_MM, unit="mm", low=0, high=1e4, live=(0, 50),
               help="depth below the skin over which the cutting force builds up"),
        Option(name="load_at", kind="choice", choices=("deformed", "undeformed"), default="deformed",
               help="whether needles load the tissue that they are in, or what was there before any moved"),
        Option(name="walls", kind="choice", choices=WALLS, default="pinned",
               help="whether the box's other faces do not move, or as tissue that goes on beyond them would let them"),
        Option(name="contact", kind="choice", choices=("pose", "track"), default="pose",
               help="forces of the needle's pose, or of the track it has left: friction that remembers, membranes"),
        Option(name="relaxation", kind="choice", choices=("none", "tissue"), default="none",
               help="whether tissue relaxes in time, as its materials say; where contact is a track"),
    ),
    capabilities=ABLE,
    properties=("stiffness_kpa", "poissons_ratio"),
)  # fmt: skip
