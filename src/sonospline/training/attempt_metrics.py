"""Metrics of an attempt as a teacher of needle guidance would ask for them. Each is a function of trace and task."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from .metric_kind import Metric, metric
from .task import Task
from .trace import Trace

Array = NDArray[np.float64]

REVERSAL_MM = 5.0
"""Of the way back and of the way on, from which on a needle was redirected: PerkTutor's hysteresis of a puncture."""
THROUGH_MM = 2.0
"""Beyond a wall, from which on it was perforated and not dented."""
METRICS_OF_ATTEMPTS: list[Metric] = []
_ALONG, _WEIGHTS = leggauss(16)


def _ways(trace: Trace) -> Iterator[tuple[slice, Array]]:
    """Of each pass: its samples, and the way of the tip (m + 1, 3) from the skin on."""
    for samples in trace.passes:
        yield samples, np.concatenate([trace.entry[samples][:1], trace.tip[samples]])


def _directions(trace: Trace, samples: slice) -> Array:
    """(m, 3) of the needle in each sample of a pass; none where it only touches the skin."""
    along = trace.tip[samples] - trace.entry[samples]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.divide(along, length, out=np.zeros_like(along), where=length > 0)


def advances(trace: Trace) -> Iterator[tuple[slice, Array]]:
    """Of each pass: its samples, and by how much the tip went on along the needle to come to each, mm."""
    for samples, way in _ways(trace):
        yield samples, (np.diff(way, axis=0) * _directions(trace, samples)).sum(axis=1)


def _seconds(trace: Trace) -> Array:
    """(n,) that a sample stands for: until the next."""
    return np.append(np.diff(trace.time_s), 0.0)


def is_blind(trace: Trace) -> NDArray[np.bool_]:
    """(n,) whether the tip is out of the image plane by more than half the slice."""
    with np.errstate(invalid="ignore"):
        found: NDArray[np.bool_] = np.abs(trace.out_of_plane) > trace.half_slice
    return found


@metric(METRICS_OF_ATTEMPTS, "s")
def time_s(trace: Trace, task: Task) -> float:
    """Time from the first sample to the last."""
    return float(trace.time_s[-1] - trace.time_s[0])


@metric(METRICS_OF_ATTEMPTS, "s")
def time_to_skin_s(trace: Trace, task: Task) -> float:
    """Time until the needle is in for the first time."""
    return float(trace.time_s[trace.passes[0].start] - trace.time_s[0]) if trace.passes else np.nan


@metric(METRICS_OF_ATTEMPTS, "s")
def insertion_time_s(trace: Trace, task: Task) -> float:
    """Time during which the needle is in, over all passes."""
    return float(_seconds(trace)[trace.inside].sum())


@metric(METRICS_OF_ATTEMPTS, "")
def passes(trace: Trace, task: Task) -> float:
    """How often the needle was put into the skin."""
    return len(trace.passes)


@metric(METRICS_OF_ATTEMPTS, "")
def redirections(trace: Trace, task: Task) -> float:
    """How often a needle that is in was pulled back by more than 5 mm and then pushed on by more than 5 mm."""
    return sum(_reversals(np.cumsum(advance)) for _, advance in advances(trace))


def _reversals(along: Array) -> int:
    """Valleys of a way that are deeper than the hysteresis on both sides."""
    count, highest, lowest, back = 0, 0.0, np.inf, False
    for place in along:
        if back:
            lowest = min(lowest, place)
            if place > lowest + REVERSAL_MM:
                count, back, highest = count + 1, False, place
        else:
            highest = max(highest, place)
            if place < highest - REVERSAL_MM:
                back, lowest = True, place
    return count


@metric(METRICS_OF_ATTEMPTS, "mm")
def needle_path_mm(trace: Trace, task: Task) -> float:
    """Length of the way of the tip in tissue, from the skin on, over all passes."""
    return float(sum(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for _, way in _ways(trace)))


@metric(METRICS_OF_ATTEMPTS, "%", "more")
def needle_path_economy_percent(trace: Trace, task: Task) -> float:
    """Straight way from the skin to where the tip ended, of the way that it travelled over all passes."""
    if not trace.passes:
        return np.nan
    last = trace.passes[-1]
    straight = np.linalg.norm(trace.tip[last][-1] - trace.entry[last][0])
    return float(100 * straight / max(needle_path_mm(trace, task), np.finfo(float).tiny))


@metric(METRICS_OF_ATTEMPTS, "mm")
def blind_advance_mm(trace: Trace, task: Task) -> float:
    """By how much the needle was advanced to places where its tip is out of plane by more than half the slice."""
    blind = is_blind(trace)
    return float(sum(advance[(advance > 0) & blind[samples]].sum() for samples, advance in advances(trace)))


@metric(METRICS_OF_ATTEMPTS, "%")
def blind_advance_percent(trace: Trace, task: Task) -> float:
    """The same of all that the needle was advanced; 100 % less what others call the share of advance in plane."""
    advanced = sum(advance[advance > 0].sum() for _, advance in advances(trace))
    return float(100 * blind_advance_mm(trace, task) / advanced) if advanced > 0 else np.nan


@metric(METRICS_OF_ATTEMPTS, "%", "more")
def tip_in_plane_percent(trace: Trace, task: Task) -> float:
    """Share of the time with the needle in during which its tip is within half the slice of the image plane."""
    seconds = _seconds(trace)
    inside = seconds[trace.inside].sum()
    return float(100 * seconds[trace.inside & ~is_blind(trace)].sum() / inside) if inside > 0 else np.nan


def _final(trace: Trace) -> tuple[float, float]:
    """How far the tip is from the target at last, along the needle (short of it is above zero) and across it."""
    if not trace.passes:
        return np.nan, np.nan
    last = trace.passes[-1].stop - 1
    missing = trace.target[last] - trace.tip[last]
    axis = _directions(trace, slice(last, last + 1))[0]
    along = float(missing @ axis)
    return along, float(np.linalg.norm(missing - along * axis))


@metric(METRICS_OF_ATTEMPTS, "mm", "neither")
def final_error_along_mm(trace: Trace, task: Task) -> float:
    """How far the tip ended short of the target, where that then is, along the needle; beyond it is below zero."""
    return _final(trace)[0]


@metric(METRICS_OF_ATTEMPTS, "mm")
def final_error_across_mm(trace: Trace, task: Task) -> float:
    """How far the needle's axis ended beside the target, where that then is."""
    return _final(trace)[1]


@metric(METRICS_OF_ATTEMPTS, "mm")
def final_error_mm(trace: Trace, task: Task) -> float:
    """Distance of the tip from the target, where that then is, at the end of the last pass."""
    return float(np.hypot(*_final(trace)))


@metric(METRICS_OF_ATTEMPTS, "mm")
def target_motion_mm(trace: Trace, task: Task) -> float:
    """How far the target was from where it is at rest, at most."""
    return float(np.linalg.norm(trace.target - trace.target_rest, axis=1).max())


@metric(METRICS_OF_ATTEMPTS, "mm^2", source="after PerkTutor's potential tissue damage")
def tissue_swept_mm2(trace: Trace, task: Task) -> float:
    """Area that the shaft swept sideways in tissue: of each of its points the way across it, along its length."""
    return float(sum(_swept(trace.entry[samples], trace.tip[samples]) for samples in trace.passes))


def _swept(entry: Array, tip: Array) -> float:
    """Of a shaft from sample to sample: by 16 points along what is in before and after."""
    along = tip - entry
    depth = np.linalg.norm(along, axis=1)
    axis = along / np.maximum(depth, np.finfo(float).tiny)[:, None]
    common = np.minimum(depth[1:], depth[:-1])
    at = 0.5 * common[:, None] * (1 + _ALONG)
    moved = (entry[1:] - entry[:-1])[:, None] + at[..., None] * (axis[1:] - axis[:-1])[:, None]
    middle = axis[1:] + axis[:-1]
    middle /= np.maximum(np.linalg.norm(middle, axis=1), np.finfo(float).tiny)[:, None]
    across = moved - (moved @ middle[..., None]) * middle[:, None]
    return float((0.5 * common * (np.linalg.norm(across, axis=2) @ _WEIGHTS)).sum())


def _hits(trace: Trace, task: Task) -> NDArray[np.bool_]:
    """(n,) whether the tip is in what must not be hit."""
    forbidden = {name for name in set(trace.structures) if task.forbids(name)}
    return np.array([name in forbidden for name in trace.structures])


@metric(METRICS_OF_ATTEMPTS, "")
def structures_hit(trace: Trace, task: Task) -> float:
    """How often the tip came into a structure that must not be hit, from another or from outside."""
    names = ("", *trace.structures)
    came = np.array([before != now for before, now in pairwise(names)])
    return float((_hits(trace, task) & came).sum())


@metric(METRICS_OF_ATTEMPTS, "mm")
def structures_hit_mm(trace: Trace, task: Task) -> float:
    """By how much the needle was advanced in structures that must not be hit."""
    hits = _hits(trace, task)
    return float(sum(advance[(advance > 0) & hits[samples]].sum() for samples, advance in advances(trace)))


@metric(METRICS_OF_ATTEMPTS, "")
def back_wall_perforations(trace: Trace, task: Task) -> float:
    """How often the needle was advanced by more than 2 mm beyond the structure with the target, from inside it."""
    inside = np.array([task.aims_into(name) for name in trace.structures])
    return sum(_perforations(inside[samples], advance) for samples, advance in advances(trace))


def _perforations(inside: NDArray[np.bool_], advance: Array) -> int:
    count, beyond = 0, np.nan  # not a number while the tip has not come out of it
    for there, on in zip(inside, advance, strict=True):
        before = beyond
        beyond = 0.0 if there else beyond + on
        count += bool(before <= THROUGH_MM < beyond)
    return count


@metric(METRICS_OF_ATTEMPTS, "deg")
def papillary_angle_deg(trace: Trace, task: Task) -> float:
    """Angle between the needle at the end of the last pass and the direction in which it should come."""
    if task.axis is None or not trace.passes:
        return np.nan
    axis, last = np.asarray(task.axis, float), trace.passes[-1].stop - 1
    needle = _directions(trace, slice(last, last + 1))[0]
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(needle, axis)), needle @ axis)))


@metric(METRICS_OF_ATTEMPTS, "N")
def peak_force_n(trace: Trace, task: Task) -> float:
    """Largest force along the needle, pushed or pulled."""
    known = np.abs(trace.axial_n[np.isfinite(trace.axial_n)])
    return float(known.max()) if known.size else np.nan


@metric(METRICS_OF_ATTEMPTS, "N")
def mean_force_n(trace: Trace, task: Task) -> float:
    """Mean of the force along the needle, pushed or pulled, over the time in which it is known."""
    known, seconds = np.isfinite(trace.axial_n), _seconds(trace)
    held = seconds[known].sum()
    return float((np.abs(trace.axial_n[known]) * seconds[known]).sum() / held) if held > 0 else np.nan
