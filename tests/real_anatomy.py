"""Needles in tissue that nothing was tuned on: a real abdomen and the kidney scene; paths by rule and seed."""

import csv
from dataclasses import dataclass
from functools import cache
from os import environ
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

import sonospline as ss
from sonospline.geometry.grid import FACES
from sonospline.mechanics import TissueMap

DATA = Path(environ.get("SONOSPLINE_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")
ABDOMEN = DATA / "abdomen_labels.nii.gz"
DISPLAY = 49**3
CLEAR_MM, BESIDE_MM = 4.0, 9.0
"""From bone, at least; and at most, to pass beside it."""
CROPS = ("spine", "ribs", "flank", "soft", "whole")


@dataclass(frozen=True)
class Case:
    """A needle's whole way into tissue."""

    name: str
    tissue: ss.Tissue
    tissues: TissueMap
    needle: ss.Needle

    def at(self, part):
        """The needle a part of the way in."""
        return ss.Needle(self.needle.entry, self.needle.at(part))


class Bone:
    """Where the rigid tissue of a label map is."""

    def __init__(self, tissues):
        self.labels = [label for label, material in tissues.materials.items() if material.rigid]
        rigid = np.isin(tissues.labels.voxels, self.labels)
        self._map = tissues.labels
        self._away = distance_transform_edt(~rigid, sampling=tissues.labels.spacing) if rigid.any() else None

    def distance(self, points):
        """Millimetres from each point (m, 3) to the nearest voxel of bone."""
        if self._away is None:
            return np.full(len(points), np.inf)
        index = np.clip(np.rint(self._map.index(points)), 0, np.array(self._away.shape) - 1).astype(int)
        return self._away[tuple(index.T)]


@cache
def bone_of(tissues):
    return Bone(tissues)


def paths(tissue, tissues, rng, tries):
    """Needles by chance from the entry face, each with its clearance from bone and the number of tissues it crosses."""
    extent, bone = tissue.grid.extent, bone_of(tissues)
    axis, end = divmod(FACES.index(tissue.entry_face), 2)
    for _ in range(tries):
        entry, depth = extent * rng.uniform(0.2, 0.8, 3), extent[axis] * rng.uniform(0.5, 0.75)
        tip = entry + depth * rng.uniform(-0.85, 0.85, 3)
        entry[axis] = extent[axis] if end else 0.0
        tip[axis] = extent[axis] - depth if end else depth
        if (tip < 0.12 * extent).any() or (tip > 0.88 * extent).any():
            continue
        needle = ss.Needle(*tissue.grid.world(np.array([entry, tip])))
        along = needle.at(np.linspace(0, 1, int(needle.depth) + 2))
        yield needle, bone.distance(along).min(), len(np.unique(tissues.labels_at(along)))


def beside_bone(tissue, tissues, rng):
    """The first path that passes bone closely; None where none of them does."""
    return next(
        (needle for needle, clear, _ in paths(tissue, tissues, rng, 3000) if CLEAR_MM <= clear <= BESIDE_MM), None
    )


def through_organs(tissue, tissues, rng):
    """The path that crosses the most tissues and keeps away from bone; None where none of them does."""
    clear = [
        (crossed, -place, needle)
        for place, (needle, away, crossed) in enumerate(paths(tissue, tissues, rng, 400))
        if away >= CLEAR_MM
    ]
    return max(clear)[2] if clear else None


@cache
def abdomen():
    return TissueMap.read(ABDOMEN)


@cache
def abdomen_names():
    with ABDOMEN.with_name("abdomen_labels.csv").open() as file:
        return {int(row["label"]): row["name"] for row in csv.DictReader(file)}


def labels_of(*kinds):
    return [label for label, name in abdomen_names().items() if name.startswith(kinds)]


def _is(kind, voxels):
    """Whether a crop holds what its kind says."""

    def share(*kinds):
        return np.isin(voxels, labels_of(*kinds)).mean()

    if kind == "spine":
        return share("vertebrae") > 0.03
    if kind == "ribs":
        return share("vertebrae") < 0.005 and sum((voxels == rib).sum() > 20 for rib in labels_of("rib")) >= 3
    if kind == "flank":
        return share("kidney") > 0.01 and share("rib") > 0.002 and share("vertebrae") > 0.005
    return share("rib", "vertebrae", "costal") == 0 and len(np.unique(voxels)) >= 6


@cache
def crop(kind, seed=0):
    """The first box of 70 to 120 mm, of random ones in the body, that holds what its kind says; or the whole map."""
    labels, rng = abdomen().labels, np.random.default_rng([sum(kind.encode()), seed])
    if kind == "whole":
        return labels.grid(DISPLAY)
    while True:
        sides = np.minimum(
            np.rint(rng.uniform(70, 120, 3) / labels.spacing).astype(int), np.array(labels.voxels.shape) - 1
        )
        low = rng.integers(0, np.array(labels.voxels.shape) - sides)
        inside = labels.voxels[tuple(slice(a, a + n) for a, n in zip(low, sides, strict=True))]
        if (inside == 0).mean() < 0.5 and _is(kind, inside):
            return ss.Grid.covering(sides * labels.spacing, nodes=DISPLAY, origin=labels.position(low[None])[0])


def finest_parts(box, labels, most=2_500_000):
    """Parts of a voxel along each axis, four or two, whose grid over a box has at most so many nodes."""
    return 4 if np.prod(np.rint(4 * box.extent / labels.spacing) + 1) <= most else 2


def parts_of_voxels(box, labels, parts):
    """A grid over a box whose cells are the voxels of a label map, cut into so many parts along each axis.

    No cell holds two tissues: what a grid lacks then is not where they meet. The box begins at a voxel's middle.
    """
    middle = labels.index(box.world(np.array([[0.0, 0, 0], box.extent])))
    assert np.allclose(middle, np.rint(middle), atol=1e-3), f"{box!r} does not end in the middle of voxels"
    cells = np.rint(parts * box.extent / labels.spacing).astype(int)
    shape = tuple(int(n) + 1 for n in cells)
    return ss.Grid(shape=shape, spacing=tuple(box.extent / cells), origin=box.origin, direction=box.direction)


def abdomen_cases(kind, *, seed=0, faces=3):
    """Paths from several faces of a crop, each beside bone and through organs."""
    rules = {"beside bone": beside_bone, "through organs": through_organs}
    if kind == "soft":
        del rules["beside bone"]
    left = faces
    for face in np.random.default_rng([7, sum(kind.encode()), seed]).permutation(6):
        tissue, rng = (
            ss.Tissue(crop(kind, seed), FACES[face]),
            np.random.default_rng([11, sum(kind.encode()), seed, face]),
        )
        found = {rule: path(tissue, abdomen(), rng) for rule, path in rules.items()}
        if left and None not in found.values():
            left -= 1
            for rule, needle in found.items():
                yield Case(f"{kind} {seed}, {FACES[face]}, {rule}", tissue, abdomen(), needle)


@cache
def kidney():
    from sonospline.simulator import Session

    return Session("kidney").scene


def kidney_cases():
    """To every target: the scene's own way, and the one from the skin that passes the rib most closely."""
    scene, grid = kidney(), kidney().tissue.grid
    bone = bone_of(scene.tissues)
    for name, target in scene.targets.items():
        yield Case(
            f"kidney, {name}", scene.tissue, scene.tissues, ss.Needle(scene.frame.entry(scene.start.needle), target)
        )
        rng, ways = np.random.default_rng(3), []
        for _ in range(1000):
            entry = grid.extent * [*rng.uniform(0.1, 0.9, 2), 0.0]
            needle = ss.Needle(grid.world(entry[None])[0], target)
            clear = bone.distance(needle.at(np.linspace(0, 1, 100))).min()
            if clear >= CLEAR_MM and needle.direction @ scene.frame.depth > 0.6:
                ways.append((clear, len(ways), needle))
        yield Case(f"kidney, {name}, beside the rib", scene.tissue, scene.tissues, min(ways)[2])


def needles_into(tissues, label, grid, rng, count):
    """Pairs of a face and a needle from it into a piece of bone, at all angles, that meets no other bone before."""
    bone, voxels = bone_of(tissues).labels, np.argwhere(tissues.labels.voxels == label)
    found = []
    for _ in range(4000):
        target = tissues.labels.position(voxels[rng.integers(len(voxels))][None].astype(float))[0]
        axis, end = divmod(int(rng.integers(6)), 2)
        entry = grid.local(target[None])[0] + rng.uniform(-60, 60, 3)
        entry[axis] = grid.extent[axis] if end else 0.0
        across = np.delete(entry / grid.extent, axis)
        if not grid.contains(target[None])[0] or (across < 0.02).any() or (across > 0.98).any():
            continue
        needle = ss.Needle(grid.world(entry[None])[0], target)
        along = tissues.labels_at(needle.at(np.linspace(0, 1, 150)))
        met = np.isin(along, bone)
        if 15 < needle.depth < 110 and met.any() and met.argmax() > 20 and along[met.argmax()] == label:
            found.append((FACES[2 * axis + end], needle))
        if len(found) == count:
            break
    return found
