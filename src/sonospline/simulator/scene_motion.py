"""How a scene's tissue moves whatever its needle does, as its file has it."""

from __future__ import annotations

from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from ..elasticity.background import BackgroundMotion
from ..elasticity.pressed_tissue import PressedTissue
from ..elasticity.solver import ElasticSolver
from ..geometry import pose
from ..mechanics.breathing import Breathing
from ..mechanics.footprint import Footprint
from ..mechanics.stiffening import Stiffening
from ..ultrasound.probe import Probe
from .scene import Scene

Array = NDArray[np.float64]

_MOST_NODES = 25**3
"""Of the solver that finds dents: they are as wide as the probe."""


def scene_motion(
    scene: Scene, solver: ElasticSolver, *, breathing: Breathing | None = None, pressed: bool = False
) -> BackgroundMotion:
    """Return the background motion of a scene's tissue on the nodes of its elastic solver.

    Parameters
    ----------
    scene : Scene
        Its file says which face is towards the head, and what is measured.
    solver : ElasticSolver
        Of the scene's tissue and materials, as an :class:`~sonospline.models.elastic.ElasticModel` has it.
    breathing : Breathing, optional
        How somebody breathes; nobody by default.
    pressed : bool, default: False
        Whether the probe dents the skin.

    Raises
    ------
    ValueError
        Breathing in a scene that has no part for it, or whose organ is not in the tissue.

    Examples
    --------
    >>> from sonospline.elasticity import ElasticSolver
    >>> from sonospline.mechanics import Breathing
    >>> from sonospline.simulator import make_scene, scene_motion
    >>> scene = make_scene("kidney")
    >>> solver = ElasticSolver(scene.tissue, scene.tissues, nodes=5000)
    >>> motion = scene_motion(scene, solver, breathing=Breathing(seed=1))
    >>> moved = motion.field(motion.at(2.0)).displacement(scene.targets["lower calyx"])
    >>> bool(moved[0] > 1)  # towards the feet
    True
    """
    footprint = housing(scene.probe) if pressed else None
    energy = scene.spec.tissue.stiffening_mj_cm2
    stiffening = None if energy is None else Stiffening(energy)
    if breathing is None:
        return BackgroundMotion(solver, footprint=footprint, stiffening=stiffening)
    part = scene.spec.breathing
    if part is None:
        raise ValueError(
            f"scene {scene.spec.name!r} says nothing of breathing; give its file a [breathing] part with cranial_face "
            "and organ"
        )
    return BackgroundMotion(
        solver,
        breathing=breathing,
        cranial_face=part.cranial_face,
        organ=_nodes_named(scene, part.organ),
        footprint=footprint,
        stiffening=stiffening,
        ratio=part.ratio,
    )


def pressed_tissue(scene: Scene, solver: ElasticSolver) -> PressedTissue:
    """Return how a scene's probe dents its tissue, of which an elastic model has a solver."""
    undented, painted = scene.undented, None
    nodes = min(solver.grid.node_count, _MOST_NODES)
    if undented is not None:
        painted = pose.facing(undented.at, depth=scene.frame.depth, right=scene.frame.right)
        solver = ElasticSolver(scene.tissue, undented.tissues(), nodes=nodes)
    elif nodes < solver.grid.node_count:
        solver = ElasticSolver(scene.tissue, solver.material, nodes=nodes)
    return PressedTissue(scene_motion(scene, solver, pressed=True), painted)


def housing(probe: Probe) -> Footprint:
    """Return what of a probe touches the skin: the housing around its face."""
    length, width = probe.housing_mm
    return Footprint(length, width, probe.radius_mm if probe.curved else 0.0)


def _nodes_named(scene: Scene, patterns: tuple[str, ...]) -> Array:
    """The display grid's nodes in labels of some names."""
    points = scene.tissue.grid.points
    if scene.tissues is None:
        return points[:0]
    names = getattr(scene.tissues.labels, "names", None) or {}
    wanted = [label for label, name in names.items() if any(fnmatchcase(name, pattern) for pattern in patterns)]
    return points[np.isin(scene.tissues.labels_at(points), wanted)]
