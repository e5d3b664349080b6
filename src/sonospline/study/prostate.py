"""A phantom prostate in soft gel, and how far a needle that is pushed into it slowly or fast takes its middle along.

Published (McLaughlin et al., AAPM 2022, abstract 66524): by hand a phantom prostate went up to 20 mm along with the
needle, with a fast pneumatic device its base went 1 mm. The gland has 46 ml; all of the phantom's values are assumed,
and chosen so that these magnitudes come out: a capsule that breaks at less the faster the tip is, and gel that relaxes.
The gland's inertia, which holds it back from a device that takes milliseconds, is not in the model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.grid import Grid
from ..geometry.label_map import LabelMap
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..mechanics.material import Material
from ..mechanics.membranes import Membrane
from ..mechanics.tissue_map import TissueMap
from ..models.elastic import ElasticModel
from ..models.insertion import NEEDLE

SIDE_MM, VOXEL_MM, NODES = 120.0, 2.0, 15625
MIDDLE_MM, SEMI_AXES_MM = (65.0, 60.0, 60.0), (22.0, 25.0, 20.0)
"""Of the gland; the needle comes along the first axis."""
DEEPEST_MM = 80.0
"""Of a pass, which ends in the gland where it stays in place."""
RELAXES = 0.25
GEL = Material(5.0, friction_n_per_mm=0.002, cutting_force_n=0.1, relaxation_exponent=RELAXES)
GLAND = Material(20.0, friction_n_per_mm=0.01, cutting_force_n=0.2, relaxation_exponent=RELAXES)
CAPSULE = Membrane("prostate capsule", ["prostate"], rupture_force_n=2.5, rate=-0.2)


class Pass(NamedTuple):
    """A needle pushed into the phantom."""

    moved_mm: float
    """Largest displacement of the gland's middle along the needle."""
    left_mm: float
    """That at the end."""
    force_n: float
    """Largest force."""
    punctured_mm: float
    """Depth at which the capsule broke; infinite where it did not."""


def prostate_model() -> ElasticModel:
    """Return the phantom, relaxing, under needles that leave tracks."""
    axis = VOXEL_MM * (np.arange(round(SIDE_MM / VOXEL_MM)) + 0.5)
    places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    inside = (((places - MIDDLE_MM) / SEMI_AXES_MM) ** 2).sum(axis=-1) < 1
    labels = LabelMap(
        voxels=inside.astype(np.uint8), spacing=(VOXEL_MM,) * 3, origin=(VOXEL_MM / 2,) * 3,
        names={0: "gel", 1: "prostate"},
    )  # fmt: skip
    tissues = TissueMap(labels, {0: GEL, 1: GLAND}, (CAPSULE,))
    tissue = Tissue(Grid(shape=(31, 31, 31), spacing=SIDE_MM / 30), entry_face="x-")
    return ElasticModel(tissue, tissues, nodes=NODES, contact="track", relaxation="tissue")


def pushed_at(model: ElasticModel, speed_mm_s: float, *, step_mm: float = 1.0) -> Pass:
    """Return what a needle does to the phantom that is pushed through its middle at a speed."""
    state, moved, forces, punctured = model.rest, [], [], np.inf
    entry = (0.0, *MIDDLE_MM[1:])
    for depth in np.arange(step_mm, DEEPEST_MM + step_mm / 2, step_mm):
        needle = Needle(entry, (float(depth), *entry[1:]))
        response = model.step(state, {NEEDLE: needle}, step_mm / speed_mm_s)
        state = response.state
        punctured = min(punctured, float(depth)) if response.events else punctured
        moved.append(float(response.field.displacement(np.array([MIDDLE_MM]))[0, 0]))
        forces.append(response.forces[NEEDLE].axial_n)
    return Pass(max(moved), moved[-1], max(forces), punctured)
