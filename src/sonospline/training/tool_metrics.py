"""Metrics of the two hands' motion, under the names that others gave them."""

from __future__ import annotations

import numpy as np

from .metric_kind import Metric, metric
from .smoothness import log_dimensionless_jerk, spectral_arc_length
from .task import Task
from .trace import Trace

METRICS_OF_TOOLS: list[Metric] = []
_PERK = "PerkTutor"


@metric(METRICS_OF_TOOLS, "mm", source=_PERK)
def probe_path_mm(trace: Trace, task: Task) -> float:
    """Length of the way of the middle of the probe's face."""
    return trace.probe_motion.path_length_mm


@metric(METRICS_OF_TOOLS, "deg", source=_PERK)
def probe_turning_deg(trace: Trace, task: Task) -> float:
    """Sum of the angles by which the probe was turned from sample to sample (Rotation Total)."""
    return trace.probe_motion.rotation_total_deg


@metric(METRICS_OF_TOOLS, "", source="TrainUS")
def probe_movements(trace: Trace, task: Task) -> float:
    """Spells of the probe above 5 mm/s or 10 degrees a second that last longer than 0.2 s."""
    return trace.probe_motion.hand_movements


@metric(METRICS_OF_TOOLS, "", "neither", source=_PERK)
def probe_translational_actions(trace: Trace, task: Task) -> float:
    """Spells of the probe above 50 mm/s that last longer than 0.2 s."""
    return trace.probe_motion.translational_actions


@metric(METRICS_OF_TOOLS, "", "neither", source=_PERK)
def probe_rotational_actions(trace: Trace, task: Task) -> float:
    """Spells of the probe above 50 degrees a second that last longer than 0.2 s."""
    return trace.probe_motion.rotational_actions


@metric(METRICS_OF_TOOLS, "", "more", source="Balasubramanian 2015")
def probe_spectral_arc_length(trace: Trace, task: Task) -> float:
    """Smoothness of the probe's speed, whatever the sampling rate: nearer to zero is smoother (SPARC)."""
    return spectral_arc_length(trace.time_s, trace.probe_to_reference[:, :3, 3])


@metric(METRICS_OF_TOOLS, "%", source=_PERK)
def needle_path_inefficiency_percent(trace: Trace, task: Task) -> float:
    """By how much the way of the tip, while in, is longer than the straight line from its first place to its last."""
    motion = trace.needle_motion
    return np.nan if motion is None else motion.path_inefficiency_percent


@metric(METRICS_OF_TOOLS, "mm/s", "neither", source=_PERK)
def needle_average_velocity_mm_s(trace: Trace, task: Task) -> float:
    """Mean of the tip's speeds between samples, while it is in."""
    motion = trace.needle_motion
    return np.nan if motion is None else motion.average_velocity_mm_s


@metric(METRICS_OF_TOOLS, "mm/s^3", source=_PERK)
def needle_motion_smoothness_mm_s3(trace: Trace, task: Task) -> float:
    """Root of the integral of the tip's squared jerk, by backward differences, while it is in."""
    motion = trace.needle_motion
    return np.nan if motion is None else motion.motion_smoothness_mm_s3


@metric(METRICS_OF_TOOLS, "", source="TrainUS")
def needle_movements(trace: Trace, task: Task) -> float:
    """Spells of the needle above 5 mm/s or 10 degrees a second that last longer than 0.2 s, while it is in."""
    motion = trace.needle_motion
    return np.nan if motion is None else motion.hand_movements


@metric(METRICS_OF_TOOLS, "", "more", source="Balasubramanian 2015")
def needle_spectral_arc_length(trace: Trace, task: Task) -> float:
    """Smoothness of the tip's speed while it is in, whatever the sampling rate: nearer to zero is smoother (SPARC)."""
    motion = trace.needle_motion
    return np.nan if motion is None else spectral_arc_length(motion.time_s, motion.places)


@metric(METRICS_OF_TOOLS, "", "more", source="Balasubramanian 2015")
def needle_log_dimensionless_jerk(trace: Trace, task: Task) -> float:
    """Smoothness of the tip while it is in, whatever the sampling rate: nearer to zero is smoother (LDLJ)."""
    motion = trace.needle_motion
    return np.nan if motion is None else log_dimensionless_jerk(motion.time_s, motion.places)
