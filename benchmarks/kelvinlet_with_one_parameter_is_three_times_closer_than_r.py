"""The Kelvinlet's drag, one parameter, against U = r with seven, both tuned on the same insertions.

Claims, means over eight held-out insertions on 25^3 nodes at full depth: on load case F (friction and
tip force) the drag leaves at most 0.13 of the mean displacement; on case D (a shaft that is held)
it is at least twice closer than U = r. Parameters of both models are found on the three tuning
insertions of each case: the drag by least squares, the seven of U = r by NSGA-II. Minutes.
"""

import sys

import numpy as np

import sonospline as ss
from sonospline.elasticity import ElasticSolver
from sonospline.fem.held_shaft import held_shaft
from sonospline.mechanics import LineForce, ShaftDisplacement
from sonospline.study.insertions import held_out_insertions, tuning_insertions
from sonospline.study.objective import Objective, errors_at_target
from sonospline.study.reference import Reference, errors_along
from sonospline.study.tuning import search

tissue = ss.Tissue(ss.Grid.unit_cube(25))
solver = ElasticSolver(tissue, integration="full")  # as the reference of the paper's study


def friction(needle):
    return solver.field(solver.solve(LineForce(), needle)).values


def held(needle):
    return held_shaft(solver, ShaftDisplacement(), needle)


def reference(plan, displacement):
    whole, depths = plan.on(tissue), (0.5, 1.0)
    moved = np.array([displacement(ss.Needle(whole.entry, whole.at(depth))) for depth in depths], float)
    return Reference(plan, tissue, depths, moved)


def kelvinlet(drag, width=0.1):
    return ss.DragModel(drag=drag, spacing=0.04, kernel=ss.Kelvinlet(0.45, width))


def fitted_drag(references, width):
    """The drag is a factor of the field: least squares over all nodes."""
    ours, theirs = [], []
    for one in references:
        ours.append(ss.KelvinletInsertion(tissue, kelvinlet(1.0, width)).advance(one.needle(0)).on_grid().ravel())
        theirs.append(one.displacements[0].ravel())
    ours, theirs = np.concatenate(ours), np.concatenate(theirs)
    return float(ours @ theirs / (ours @ ours))


def shown(name, errors):
    relative = np.mean([one.relative for one in errors])
    print(f"  {name:44s} rel {relative:.3f}, at the tip {np.mean([one.at_tip for one in errors]):.2e}", flush=True)
    return relative


def main():
    budget = {"population": 12, "generations": 8} if "--quick" in sys.argv else {}
    ratios = {}
    for case, displacement in (("F", friction), ("D", held)):
        tuned_on = tuple(reference(plan, displacement) for plan in tuning_insertions())
        held_out = tuple(reference(plan, displacement).last for plan in held_out_insertions())
        print(f"case {case}")
        last = [one.last for one in tuned_on]
        ours = {}
        for width in (0.1, 0.08, 0.05):
            drag = fitted_drag(last, width)
            errors = [errors_along(ss.KelvinletInsertion(tissue, kelvinlet(drag, width)), one)[0] for one in held_out]
            ours[width] = shown(f"Kelvinlet, eps {width}, drag {drag:.4f}", errors)
        default = ss.DragModel.kelvinlet()
        shown(
            "Kelvinlet as it comes", [errors_along(ss.KelvinletInsertion(tissue, default), one)[0] for one in held_out]
        )
        front = search(Objective(tuned_on), seed=0, workers=2, **budget)
        by_insertion = errors_at_target(held_out, front.model())
        theirs = shown("U = r, seven parameters", [e for name, e in by_insertion.items() if name != "mean"])
        print(f"    its parameters: {np.round(front.designs[front.chosen], 5).tolist()}")
        ratios[case] = theirs / ours[0.1]
        print(f"  U = r over the Kelvinlet of eps 0.1: {ratios[case]:.2f}")


if __name__ == "__main__":  # the search starts processes that import this file
    main()
