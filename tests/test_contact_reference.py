"""Needles that leave tracks, against the stepwise reference: exact complementarity, direct solves.

On 13^3 nodes; with SONOSPLINE_REFERENCE_NODES=25 on as many along each axis, which takes minutes a case.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from sonospline.contact import Medium
from sonospline.fem import StepwiseNeedle, StepwiseTissue
from sonospline.mechanics import Material, PronySeries, labelled_cube
from sonospline.models.elastic import ElasticModel

NODES = int(os.environ.get("SONOSPLINE_REFERENCE_NODES", "13"))
SIDE, ENTRY = 100.0, np.array([0.0, 50.0, 50.0])
FRICTION, CUTTING = 30.0, 700.0
IN, BACK, AGAIN = (np.arange(*way) for way in ((2.0, 51.0, 2.0), (48.0, 25.0, -2.0), (28.0, 53.0, 2.0)))
WAY = [(depth, 0.1) for depth in (*IN, *BACK, *AGAIN)]
"""Depth of the tip, and seconds of the step that brings it there."""
HELD = [*((depth, 0.1) for depth in IN), *((IN[-1], 1.0),) * 10, *((depth, 0.1) for depth in (*BACK, *AGAIN))]
"""The same, held for ten seconds before it is pulled back."""


class MeanMedium(Medium):
    """The tissue of the reference: what a force does work on is the mean over its Gaussian."""

    def moved(self, displacement, places):
        units = [[self.nodal(place[None], axis[None]) for axis in np.eye(3)] for place in np.asarray(places, float)]
        return np.array([[np.vdot(unit, displacement) for unit in of_place] for of_place in units]).reshape(-1, 3)


def live(material, nodes, way, **options):
    """The forces and the fields of the live model along a way, on nodes of its solver."""
    tissue = ss.Tissue(ss.Grid(shape=(nodes,) * 3, spacing=SIDE / (nodes - 1)))
    model = ElasticModel(tissue, material, nodes=nodes**3, contact="track", grip=False, reuse=1.0, **options)
    in_time = model._in_time
    model._in_time = replace(in_time, medium=MeanMedium(in_time.medium.solver, in_time.medium.width, 1.0))
    state, forces, fields = model.rest, [], []
    for depth, dt in way:
        response = model.step(state, {"needle": ss.Needle(ENTRY, ENTRY + np.array([depth, 0, 0]))}, dt)
        state = response.state
        forces.append(1e3 * response.forces["needle"].axial_n)
        fields.append(np.moveaxis(state.solution.displacement, 0, -1))
    return model, np.array(forces), fields


def reference(model, material, way, series):
    """The same by the reference, whose points are so near each other that it hardly shows when the tip reaches one."""
    apart = model.load.finest_length / 8
    depths = np.arange(apart / 2, 58.0, apart)
    points = ENTRY + depths[:, None] * np.eye(3)[0]
    body = StepwiseTissue(ss.Tissue(model.solver.grid), material, times=series.times_s, fractions=series.fractions)
    needle = StepwiseNeedle(
        body, entry=ENTRY, points=points, width=8 * apart, bounds=FRICTION * apart, cutting=CUTTING
    )  # fmt: skip
    states = [needle.rest]
    for depth, dt in way:
        states.append(needle.step(states[-1], depth, dt))
    return np.array([state.force for state in states[1:]]), [state.displacement for state in states[1:]]


def holds(found, expected):
    """Whether forces are within 2 % of the peak, and fields within 0.03 of the largest mean."""
    (forces, fields), (exact, wanted) = found, expected
    assert np.abs(forces - exact).max() < 0.02 * np.abs(exact).max()
    peak = max(np.linalg.norm(field, axis=-1).mean() for field in wanted)
    apart = [np.linalg.norm(ours - theirs, axis=-1).mean() for ours, theirs in zip(fields, wanted, strict=True)]
    assert max(apart) < 0.03 * peak


def gel():
    return Material(10.0, friction_n_per_mm=FRICTION / 1e3, cutting_force_n=CUTTING / 1e3)


def cube_of(name):
    return labelled_cube(name, side=SIDE, stiffness_kpa=10.0)


CASES = [gel, lambda: cube_of("layers"), lambda: cube_of("sphere")]


@pytest.mark.slow
@pytest.mark.parametrize("make", CASES, ids=["gel", "layers", "sphere"])
def test_pushing_pulling_and_pushing_again_are_those_of_the_reference(make):
    model, *found = live(make(), NODES, WAY)
    holds(found, reference(model, make(), WAY, PronySeries()))


@pytest.mark.slow
def test_in_tissue_that_relaxes_a_hold_of_ten_seconds_is_that_of_the_reference_too():
    relaxing = replace(gel(), relaxation_exponent=0.15)
    model, *found = live(relaxing, NODES, HELD, relaxation="tissue")
    holds(found, reference(model, relaxing, HELD, PronySeries.power_law(0.15)))
