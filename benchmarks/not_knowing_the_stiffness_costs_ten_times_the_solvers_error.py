"""What a stiffness known to 30 % only costs, beside the error of the live solver.

Claim: with every tissue's modulus off by 30 % (log-normal), the field is off by more than ten times
the error of one iteration a step on 25^3 nodes, against 49^3. Means over three held-out insertions
and sixteen draws, each with its opposite, of the difference over the mean displacement; the label map
is also shifted by one cell of 25^3. Minutes.
"""

from dataclasses import replace

import numpy as np

import sonospline as ss
from sonospline.elasticity import ElasticSolver
from sonospline.geometry.volume import Volume
from sonospline.mechanics import LABELLED_CUBES, LineForce, Material, TissueMap, labelled_cube
from sonospline.models.elastic import ElasticInsertion
from sonospline.study.insertions import held_out_insertions

SIDE, FINE, FRAMES, DRAWS = 25, 49, 60, 8
LOAD = LineForce()
tissue = ss.Tissue(ss.Grid.unit_cube(SIDE))
needles = [plan.on(tissue) for plan in held_out_insertions()[:3]]


def converged(material, side=SIDE):
    solver = ElasticSolver(tissue, material, nodes=side**3)
    return np.array([solver.solve(LOAD, needle, tolerance=1e-3).displacement for needle in needles])


def live(tissues):
    insertion = ElasticInsertion(tissue, tissues, LOAD, load_at="undeformed", nodes=SIDE**3)
    fields = []
    for needle in needles:
        insertion.reset()
        *_, field = insertion.run(needle.entry, needle.tip, FRAMES)
        fields.append(np.moveaxis(field.values, -1, 0))
    return np.array(fields)


def away(found, expected):
    return float(np.linalg.norm(found - expected, axis=1).mean() / np.linalg.norm(expected, axis=1).mean())


def perturbed(tissues, logs):
    """The same tissues with every Young's modulus multiplied by a factor."""
    materials = {
        label: replace(material, stiffness_kpa=material.stiffness_kpa * float(np.exp(log)))
        for (label, material), log in zip(tissues.materials.items(), logs, strict=True)
    }
    return TissueMap(tissues.labels, materials)


def off_by(spread, tissues, truth):
    drawn = np.random.default_rng(0).standard_normal((DRAWS, len(tissues.materials)))
    return np.mean([away(converged(perturbed(tissues, s * logs)), truth) for logs in drawn for s in (spread, -spread)])


def shifted(tissues, axis, sign):
    labels = tissues.labels
    origin = labels.origin + sign * np.eye(3)[axis] / (SIDE - 1)
    return TissueMap(Volume(voxels=labels.voxels, spacing=labels.spacing, origin=origin), tissues.materials)


print(f"{'cube':12s} {'off 10 %':>9s} {'off 30 %':>9s} {'shifted':>9s} {'one E':>9s} {'solver':>9s}   30 % over solver")
for name in LABELLED_CUBES:
    tissues = labelled_cube(name)
    truth = converged(tissues)
    fine = converged(tissues, FINE)[:, :, ::2, ::2, ::2]
    off = [off_by(spread, tissues, truth) for spread in (0.1, 0.3)]
    moved = np.mean([away(converged(shifted(tissues, axis, sign)), truth) for axis in range(3) for sign in (-1, 1)])
    ignorant = away(converged(Material()), truth)
    own = away(live(tissues), fine)
    print(
        f"{name:12s} {off[0]:9.3f} {off[1]:9.3f} {moved:9.3f} {ignorant:9.3f} {own:9.3f} {off[1] / own:9.1f}",
        flush=True,
    )
