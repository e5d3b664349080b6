"""A pass of a needle of which every frame is judged by the field that its own model converges to."""

import numpy as np

FRAMES = 60
CONVERGED = 2e-5
RESOLVED = 2e-4
"""An error below it says nothing: float32 and the converged field's own error decide."""


def mean_length(u):
    """Mean length of the vectors (3, ...) of a field."""
    return float(np.linalg.norm(u, axis=0).mean())


class JudgedPass:
    """True error of the iteration, published error and error at the tip, frame by frame.

    An error is the mean length of the difference from the converged field under the frame's own load over that of the
    field, or ``at_rest`` from the field at rest at the same pose, once the load is where the needle is; at the tip the
    difference is over the peak.
    """

    def __init__(self, model, case, *, at_rest=False):
        self.model, self.case, self.state, self.at_rest = model, case, model.rest, at_rest
        self.true, self.published, self.tip = [], [], []

    def step(self, part):
        """One frame with the needle a part of its way in; return the response."""
        needle, solver = self.case.at(part), self.model.solver
        response = self.model.step(self.state, {"needle": needle})
        self.state, found = response.state, response.state.solution
        if self.at_rest:
            exact = self.model.settle(response, tolerance=CONVERGED).state.solution
        else:
            exact = solver.settle(found, tolerance=CONVERGED)
        self.true.append(mean_length(found.displacement - exact.displacement) / mean_length(exact.displacement))
        self.published.append(response.error_estimate if self.at_rest else found.error)
        off = solver.field(found).displacement(needle.tip) - solver.field(exact).displacement(needle.tip)
        self.tip.append(float(np.linalg.norm(off) / np.linalg.norm(exact.displacement, axis=0).max()))
        return response

    def push(self, frames=FRAMES):
        """The whole way in, in so many frames; return the last response."""
        return [self.step(k / frames) for k in range(1, frames + 1)][-1]

    def withdraw(self, frames=3):
        """At once to half the depth; return the true errors of the frames there."""
        for _ in range(frames):
            self.step(0.5)
        return self.true[-frames:]

    @property
    def ratios(self):
        """Published over true error, where there is an error."""
        true, published = np.array(self.true), np.array(self.published)
        return published[true > RESOLVED] / true[true > RESOLVED]
