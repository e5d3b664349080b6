"""The table of metrics: what each is called, its unit, its definition, and who defined it."""

from __future__ import annotations

from .attempt_metrics import METRICS_OF_ATTEMPTS
from .metric_kind import Metric
from .task import Task
from .tool_metrics import METRICS_OF_TOOLS
from .trace import Trace

METRICS: dict[str, Metric] = {metric.name: metric for metric in (*METRICS_OF_ATTEMPTS, *METRICS_OF_TOOLS)}
"""Every metric by its name."""


def measure(trace: Trace, task: Task | None = None) -> dict[str, float]:
    """Return every metric of a trace: the same bits live and from a file.

    Parameters
    ----------
    trace : Trace
        What happened.
    task : Task, optional
        What was asked for, as far as metrics depend on it.

    Returns
    -------
    dict of str to float
        By the names of :data:`METRICS`; NaN for what this trace does not tell: an error without a needle, a force where
        no model knows it.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.training import Trace, measure
    >>> depth = np.linspace(1, 30, 30)
    >>> trace = Trace.of_needle(time_s=depth, entry=(0, 0, 0), tip=depth[:, None] * [0, 0, 1.0], target=(3, 0, 30))
    >>> found = measure(trace)
    >>> found["passes"], found["needle_path_mm"], found["final_error_across_mm"]
    (1.0, 30.0, 3.0)
    """
    task = Task() if task is None else task
    return {name: float(metric.of(trace, task)) for name, metric in METRICS.items()}
