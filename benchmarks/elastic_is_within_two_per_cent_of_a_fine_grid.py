"""Live steps on 25^3 and 49^3 nodes, cubic to 49^3, against converged fields on 97^3 nodes.

Claims, for five held-out insertions of 60 steps: over mean |u| at most 0.02 in the simple cubes and
0.035 in the body, at the tip over max |u| at most 0.04, on 25^3 nodes; 0.01 and 0.02 on 49^3
nodes. After the needle is then withdrawn to half its depth at once, the error of the iteration is
at most 0.05 in the first frame and 0.01 in the third. The published error is never below half of the
true one of the iteration, and within three times of it in 95 % of steps. Five minutes; `--quick`
takes one insertion. Ends with 1 where a claim is missed.
"""

import sys

import numpy as np

import sonospline as ss
from sonospline.elasticity import ElasticSolver
from sonospline.mechanics import LABELLED_CUBES, LineForce, labelled_cube
from sonospline.study.insertions import held_out_insertions

STEPS = 60
LOAD = LineForce()
INSERTIONS = held_out_insertions()[: 1 if "--quick" in sys.argv else 5]
LIMITS = {25: {"simple": 0.02, "body": 0.035, "tip": 0.04}, 49: {"simple": 0.01, "body": 0.02, "tip": 0.04}}
REFERENCE_ERROR, FINISHED_ERROR = 1e-4, 3e-5

display = ss.Tissue(ss.Grid.unit_cube(49))
free = ~display.pinned


def mean_length(values):
    return np.linalg.norm(values, axis=-1).mean()


def unfinished(solver, state, needle):
    """True error of the iteration: distance to the converged field of the same grid, over its mean."""
    finished = solver.solve(LOAD, needle, tolerance=FINISHED_ERROR).displacement
    return np.linalg.norm(state.displacement - finished, axis=0).sum() / np.linalg.norm(finished, axis=0).sum()


def insertion(solver, whole):
    """The last field, true and published error in every third step, and the errors one and three frames after a
    withdrawal."""
    state, errors = solver.rest, []
    for step in range(1, STEPS + 1):
        needle = ss.Needle(whole.entry, whole.at(step / STEPS))
        state = solver.step(state, LOAD, needle)
        if step % 3 == 0 and solver.grid.node_count < 20_000:
            errors.append((unfinished(solver, state, needle), state.error))
    half = ss.Needle(whole.entry, whole.at(0.5))
    back = solver.step(state, LOAD, half)
    third = solver.step(solver.step(back, LOAD, half), LOAD, half)
    return solver.field(state).on_grid(), errors, [unfinished(solver, frame, half) for frame in (back, third)]


judged, missed, drawn_back = [], 0, []
for name in LABELLED_CUBES:
    tissues = labelled_cube(name)
    reference = ElasticSolver(display, tissues, nodes=97**3)
    solvers = {side: ElasticSolver(display, tissues, nodes=side**3) for side in (25, 49)}
    limits = {side: (limit["body" if name == "body" else "simple"], limit["tip"]) for side, limit in LIMITS.items()}
    seen = {side: [] for side in solvers}
    for plan in INSERTIONS:
        needle = plan.on(display)
        fine = reference.solve(LOAD, needle, tolerance=REFERENCE_ERROR)
        expected = np.moveaxis(fine.displacement, 0, -1)[::2, ::2, ::2]
        tip = tuple(np.rint(needle.tip * 48).astype(int))
        for side, solver in solvers.items():
            found, errors, (after, third) = insertion(solver, needle)
            judged += errors
            drawn_back.append((after, third))
            away = mean_length((found - expected)[free]) / mean_length(expected[free])
            at_tip = np.linalg.norm(found[tip] - expected[tip]) / np.linalg.norm(expected, axis=-1).max()
            good = away <= limits[side][0] and at_tip <= limits[side][1] and after <= 0.05 and third <= 0.01
            missed += not good
            seen[side].append((away, at_tip))
            print(
                f"{name:12s} {plan.name} {side}^3: {away:.4f}, tip {at_tip:.4f}, withdrawn {after:.4f}, {third:.4f}"
                f"{'' if good else '  MISSED'}",
                flush=True,
            )
    for side, rows in seen.items():
        (away, at_tip), (most, most_at_tip) = np.mean(rows, axis=0), np.max(rows, axis=0)
        print(f"{name:12s} {side}^3: {away:.3f} ({most:.3f}) | {at_tip:.3f} ({most_at_tip:.3f})", flush=True)
first, third = np.max(drawn_back, axis=0)
true, said = np.array(judged).T
published = said / true
low, near = published.min(), np.mean(published <= 3)
print(f"withdrawn, at worst {first:.4f} in the first frame, {third:.4f} in the third")
print(f"error of the iteration: median {np.median(true):.4f}, 95 % {np.percentile(true, 95):.4f}, {true.max():.4f}")
print(
    f"published over true error: smallest {low:.2f}, median {np.median(published):.2f}, within three times "
    f"{near:.1%}, largest {published.max():.2f}, of {len(published)} steps"
)
missed += (low < 0.5) + (near < 0.95)
print(f"{missed} missed")
sys.exit(int(missed > 0))
