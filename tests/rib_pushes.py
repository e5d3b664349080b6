"""Pushes into the bones of a label map, from every side and at many angles, and what the tissue does meanwhile."""

from dataclasses import dataclass

import numpy as np

import sonospline as ss
from sonospline import models

PUSH_MM = 2.0
BOX_MM = 80.0
TILTS_DEG = (0.0, 30.0, 60.0)
MOST_MM, LEAST_DET = 10.0, 0.2
SOLID_KPA = 2.0
"""Lungs are softer, and fluids flow: both are squeezed flat by a needle beside a rib, beyond any linear theory."""


@dataclass(frozen=True)
class Step:
    """One frame of a push."""

    needle: ss.Needle
    bone: str | None
    moved_mm: float
    det: float
    iterations: int
    """What its time is made of; the milliseconds are in benchmarks/elastic_holds_on_real_anatomy.py."""

    @property
    def gentle(self):
        """Whether the tissue moves as far as tissue does, and folds nowhere near."""
        return self.moved_mm <= MOST_MM and self.det >= LEAST_DET


class Site:
    """A crop around the middle of a bone, entered from one of its faces."""

    def __init__(self, tissues, label, face):
        lattice = tissues.labels.lattice
        voxels = np.argwhere(tissues.labels.voxels == label)
        off = np.linalg.norm((voxels - voxels.mean(axis=0)) * lattice.spacing, axis=1)
        middle = voxels[off.argmin()] * lattice.spacing
        low = np.clip(middle - BOX_MM / 2, 0, np.maximum(lattice.extent - BOX_MM, 0))
        extent = np.minimum(BOX_MM, lattice.extent - low)
        self.grid = ss.Grid.covering(
            extent, nodes=20_000, origin=lattice.world(low[None])[0], direction=lattice.direction
        )
        self.tissues, self.face, self.aim = tissues, face, lattice.world(middle[None])[0]
        self.model = models.make("elastic", ss.Tissue(self.grid, face), tissues)
        self.solid = solid_cells(tissues, self.grid)

    def needles(self):
        """Entries and directions through the middle of the bone: square to the face, and tilted along it."""
        axis, end = divmod(ss.FACES.index(self.face), 2)
        inward, place = np.zeros(3), self.grid.local(self.aim[None])[0]
        inward[axis] = -1.0 if end else 1.0
        deep = self.grid.extent[axis] - place[axis] if end else place[axis]
        for tilt in np.radians(TILTS_DEG):
            for turn in np.radians((0, 90, 180, 270) if tilt else (0,)):
                along = np.zeros(3)
                along[(axis + 1) % 3], along[(axis + 2) % 3] = np.cos(turn), np.sin(turn)
                direction = np.cos(tilt) * inward + np.sin(tilt) * along
                entry = place - deep / np.cos(tilt) * direction
                if ((entry >= 0) & (entry <= self.grid.extent)).all():
                    yield self.grid.world(entry[None])[0], self.grid.direction @ direction

    def push(self, entry, direction):
        """Yield the frames of a push through the bone, until it stops the needle."""
        state, way = self.model.rest, np.linalg.norm(self.aim - entry) + 2 * PUSH_MM
        for depth in np.arange(PUSH_MM, way, PUSH_MM):
            needle = ss.Needle(entry, entry + depth * direction)
            response = self.model.step(state, {"needle": needle})
            state = response.state
            blocked = response.blocked.get("needle")
            moved, det = strain_of(response, self.solid)
            yield Step(dict(state.needles)["needle"], blocked and blocked.by, moved, det, state.solution.iterations)
            if blocked:
                return


def solid_cells(tissues, grid):
    """Whether the middle of each cell of a grid is in tissue that neither flows nor is as soft as a lung."""
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) + 0.5 for n in grid.shape), indexing="ij"), axis=-1)
    labels = tissues.labels_at(grid.node(cells.reshape(-1, 3))).reshape(cells.shape[:3])
    soft = [label for label, one in tissues.materials.items() if one.fluid or one.stiffness_kpa < SOLID_KPA]
    return ~np.isin(labels, soft)


def strain_of(response, cells):
    """How far tissue moves at most in some cells, and the smallest volume over what it was, at one corner of each."""
    field, grid = response.field.on_grid(), response.field.grid
    local, kept = field @ grid.direction, tuple(slice(n - 1) for n in grid.shape)
    gradient = np.stack([np.diff(local, axis=a)[kept] / h for a, h in enumerate(grid.spacing)], axis=-1)
    moved = np.linalg.norm(field, axis=-1)[kept][cells]
    return float(moved.max()), float(np.linalg.det(gradient + np.eye(3))[cells].min())
