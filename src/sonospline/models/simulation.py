"""The whole of a simulation in one object: tissue, a model of it, and where the needles are."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from typing import Any

from numpy.typing import ArrayLike

from .. import _validate
from .._shown import shown
from ..geometry.grid import Grid
from ..geometry.label_map import LabelMap
from ..geometry.needle import Needle, equal_steps
from ..geometry.needles import NO_NEEDLES, Needles
from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.material_table import Materials
from ..mechanics.tissue_map import TissueMap
from .contract import Response, TissueModel
from .insertion import NEEDLE, until_blocked
from .maker import make

logger = logging.getLogger(__name__)

_MOST_ROUNDS = 200
"""Steps at the target until the tissue has come to rest, at most."""


class Simulation:
    """Tissue, and a model that answers to needles in it.

    Parameters
    ----------
    tissue : LabelMap, TissueMap, Grid or Tissue
        A label map with names (of :func:`sonospline.read_labels`), labels whose materials are known, or a box of
        one tissue.
    model : str, default: "elastic"
        One of :func:`sonospline.models.names`; label maps need one that can do ``"labels"``.
    entry_face : str, default: "x-"
        The free face, one of ``sonospline.FACES``; the other five are pinned. A Tissue has its own.
    materials : path-like, MaterialTable, mapping or Material, optional
        What the tissue is made of: of labels a TOML file or a table by name, over the assumed ones; of a box a
        Material, by default soft tissue.
    nodes : int, default: 150000
        Nodes of the display grid over a label map, about.
    **options
        Of the model, as :func:`sonospline.models.spec` lists them.

    Raises
    ------
    ValueError
        Tissue that is none, labels without names or materials, an unknown model or option, or a model that
        knows no labels and is given some.

    Examples
    --------
    >>> import sonospline as ss
    >>> sim = ss.Simulation(ss.Grid(shape=(25, 25, 25), spacing=4), model="elastic", solver_nodes=13**3)
    >>> response = sim.insert(entry=(0, 48, 48), target=(60, 48, 48), steps=5)
    >>> round(response.forces["needle"].axial_n, 1), response.settled
    (2.5, True)
    """

    def __init__(
        self,
        tissue: LabelMap | TissueMap | Grid | Tissue,
        *,
        model: str = "elastic",
        entry_face: str | None = None,
        materials: Materials | Material | None = None,
        nodes: int = 150_000,
        **options: Any,
    ) -> None:
        made, contents = _box(tissue, entry_face, nodes), _contents(tissue, materials)
        self.model: TissueModel = make(model, made, contents, **options)
        self.tissue = self.model.tissue
        self.reset()

    def reset(self) -> None:
        """Take all needles out and let the tissue return to its undeformed state."""
        self.response: Response = self.model.step(self.model.rest)

    def step(self, needles: Needles = NO_NEEDLES, dt: float = 0.0) -> Response:
        """Return, and keep as :attr:`response`, what the tissue answers to needles some time after the last step.

        As :meth:`sonospline.models.TissueModel.step` from the last state; a step that fails leaves it in force.
        """
        self.response = self.model.step(self.response.state, needles, dt)
        return self.response

    def run(self, entry: ArrayLike | Needle, target: ArrayLike | None = None, *, steps: int = 20) -> Iterator[Response]:
        """Insert a needle, ``"needle"``, from the rest state in equal steps, yielding the response to each.

        Where it meets bone the way ends: the last response says so in ``blocked``.
        """
        _validate.count("steps", steps)
        whole = _whole(entry, target)
        self.tissue.check_inside(entry=whole.entry, target=whole.tip)
        self.reset()
        way = (self.step({NEEDLE: needle}) for needle in equal_steps(whole, steps))
        return until_blocked(way, lambda: self.response)

    def insert(
        self,
        entry: ArrayLike | Needle,
        target: ArrayLike | None = None,
        *,
        steps: int = 20,
        progress: Callable[[int, int], object] | None = None,
    ) -> Response:
        """Insert a needle, ``"needle"``, from the rest state and wait until the tissue has come to rest.

        Parameters
        ----------
        entry, target : (3,) array_like
            Where it enters and where its tip ends, in the world; or one Needle that is there.
        steps : int, default: 20
            Steps of the way.
        progress : callable, optional
            Called with the number of steps made, and of all, after each.

        Returns
        -------
        Response
            At the target, or where bone stops the needle, as ``blocked`` says: ``field``, ``forces["needle"]``,
            ``error_estimate``.
        """
        for made, _ in enumerate(self.run(entry, target, steps=steps), start=1):
            if progress:
                progress(made, steps)
        for _ in range(_MOST_ROUNDS):
            if self.response.settled:
                return self.response
            self.step(self.response.state.needles)
        if not self.response.settled:
            logger.warning("the tissue has not come to rest: error estimate %.1g", self.response.error_estimate)
        return self.response

    def __repr__(self) -> str:
        return f"Simulation({self.model.name}, {self.tissue!r})"


def _whole(entry: ArrayLike | Needle, target: ArrayLike | None) -> Needle:
    """The needle at the end of its way."""
    if isinstance(entry, Needle) and target is None:
        return entry
    if isinstance(entry, Needle) or target is None:
        raise ValueError("target goes with an entry point; give both, or one Needle")
    return Needle(entry, target)


def _box(tissue: Any, entry_face: str | None, nodes: int) -> Tissue:
    if isinstance(tissue, Tissue):
        return tissue if entry_face is None else Tissue(tissue.grid, entry_face)
    if isinstance(tissue, TissueMap):
        tissue = tissue.labels
    if isinstance(tissue, LabelMap):
        tissue = tissue.grid(_validate.count("nodes", nodes, least=8))
    if not isinstance(tissue, Grid):
        raise ValueError(f"tissue = {shown(tissue)} is none; give labels, e.g. of read_labels, or a Grid")
    return Tissue(tissue, "x-" if entry_face is None else entry_face)


def _contents(tissue: Any, materials: Any) -> Material | TissueMap | None:
    if isinstance(tissue, LabelMap):
        return TissueMap.of(tissue, materials)
    if isinstance(tissue, TissueMap):
        if materials is not None:
            raise ValueError("materials were given for a TissueMap, which has its own; leave them out")
        return tissue
    if materials is None or isinstance(materials, Material):
        return materials
    raise ValueError(f"materials = {shown(materials)} is for labels; give a Material for a box of one tissue")
