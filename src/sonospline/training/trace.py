"""A trace: where needle, probe and target were over an attempt, sample by sample."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._by_bits import ByBits
from ..fields.field import Field
from ..simulator.scene import Scene
from ..simulator.simulated_frame import SimulatedFrame
from .tool_motion import ToolMotion

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_NOWHERE = np.full(3, np.nan)
_NOWHERE.setflags(write=False)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trace(ByBits):
    """An attempt, of n samples in the world, in mm; what is not known of one is NaN.

    Parameters
    ----------
    time_s : (n,) array_like
        Seconds, each later than the one before.
    entry, tip : (n, 3) array_like
        Where the needle enters the skin and where its tip is; NaN while it is out.
    probe_to_reference : (n, 4, 4) array_like
        Pose of the probe, origin in the middle of its face.
    target : (n, 3) array_like
        Where the target is: deformed tissue, not at rest.
    target_rest : (3,) array_like
        Where it is at rest.
    out_of_plane, half_slice : (n,) array_like
        How far the tip is out of the image plane, and half the slice's thickness there; NaN while the needle is out.
    axial_n : (n,) array_like
        Force on the tissue along the needle, N; NaN where no model knows it.
    structures : sequence of str
        What the tip is in, sample by sample; empty where that has no name, or the needle is out.

    Raises
    ------
    ValueError
        Arrays that do not fit together, fewer than two samples, times that do not grow, a pose or a target that is not
        finite, a needle of which only one end is known.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.training import Trace, measure
    >>> depth = np.linspace(0.5, 20, 40)
    >>> trace = Trace.of_needle(time_s=depth / 10, entry=(0, 0, 0), tip=depth[:, None] * [0, 0, 1.0], target=(0, 0, 21))
    >>> trace, measure(trace)["final_error_along_mm"]
    (Trace(40 samples, 1.95 s, 1 pass), 1.0)
    """

    time_s: Array
    entry: Array
    tip: Array
    probe_to_reference: Array
    target: Array
    target_rest: Array
    out_of_plane: Array
    half_slice: Array
    axial_n: Array
    structures: tuple[str, ...]

    def __post_init__(self) -> None:
        n = np.size(self.time_s)
        if n < 2:
            raise ValueError(f"time_s has {n} samples; a trace has two at least")
        shapes = {
            "time_s": (n,), "entry": (n, 3), "tip": (n, 3), "probe_to_reference": (n, 4, 4), "target": (n, 3),
            "target_rest": (3,), "out_of_plane": (n,), "half_slice": (n,), "axial_n": (n,),
        }  # fmt: skip
        for name, shape in shapes.items():
            object.__setattr__(self, name, _numbers(name, getattr(self, name), shape))
        object.__setattr__(self, "structures", tuple(self.structures))
        if len(self.structures) != n:
            raise ValueError(f"structures has {len(self.structures)} names for {n} samples; give '' for none")
        for name in ("time_s", "probe_to_reference", "target", "target_rest"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} contains NaN or infinity; leave such samples out")
        if not (np.diff(self.time_s) > 0).all():
            at = int(np.flatnonzero(np.diff(self.time_s) <= 0)[0]) + 1
            raise ValueError(f"time_s = {self.time_s[at]:g} of sample {at} is not later than the one before")
        one = np.flatnonzero(_known(self.entry) != _known(self.tip))
        if one.size:
            at = int(one[0])
            raise ValueError(f"entry and tip of sample {at}: only one is known; give both, or NaN for both")

    @classmethod
    def of_needle(
        cls, *, time_s: ArrayLike, entry: ArrayLike, tip: ArrayLike, target: ArrayLike,
        out_of_plane: ArrayLike = 0.0, half_slice: ArrayLike = 1.0, axial_n: ArrayLike = np.nan,
        structures: Iterable[str] | None = None,
    ) -> Trace:  # fmt: skip
        """Return the trace of a needle below a probe that stays; what is given once holds for all samples."""
        n = np.size(time_s)
        goal = np.broadcast_to(np.asarray(target, float), (n, 3))
        return cls(
            time_s=np.asarray(time_s, float), entry=np.broadcast_to(entry, (n, 3)), tip=np.broadcast_to(tip, (n, 3)),
            probe_to_reference=np.broadcast_to(np.eye(4), (n, 4, 4)), target=goal, target_rest=goal[0],
            out_of_plane=np.broadcast_to(out_of_plane, n), half_slice=np.broadcast_to(half_slice, n),
            axial_n=np.broadcast_to(axial_n, n), structures=("",) * n if structures is None else tuple(structures),
        )  # fmt: skip

    @classmethod
    def of_frames(cls, time_s: ArrayLike, frames: Iterable[SimulatedFrame], scene: Scene) -> Trace:
        """Return the trace of a session's frames, with the seconds at which each came.

        Raises
        ------
        ValueError
            As above; or frames about more than one target.
        """
        return cls.of_samples(time_s, (Sample.of(frame, scene) for frame in frames))

    @classmethod
    def of_samples(cls, time_s: ArrayLike, samples: Iterable[Sample]) -> Trace:
        """Return the trace of samples, taken of frames when these came."""
        samples = list(samples)
        if len(targets := dict.fromkeys(sample.name for sample in samples)) > 1:
            raise ValueError(f"frames are about {' and '.join(map(repr, targets))}; a trace has one target")
        if not samples:
            raise ValueError("frames is empty; a trace has two samples at least")
        columns: tuple[Any, ...] = tuple(zip(*samples, strict=True))
        _, entry, tip, pose, target, rest, out_of_plane, half_slice, axial_n, structures = columns
        return cls(
            time_s=np.asarray(time_s, float), entry=np.array(entry), tip=np.array(tip),
            probe_to_reference=np.array(pose), target=np.array(target), target_rest=np.array(rest[-1:]).reshape(-1),
            out_of_plane=np.array(out_of_plane), half_slice=np.array(half_slice), axial_n=np.array(axial_n),
            structures=structures,
        )  # fmt: skip

    @cached_property
    def inside(self) -> Flags:
        """(n,) whether the needle is in."""
        return _known(self.tip)

    @cached_property
    def passes(self) -> tuple[slice, ...]:
        """The samples of each pass, from the skin on until the needle is out."""
        edges = np.diff(np.concatenate([[False], self.inside, [False]]).astype(int))
        return tuple(
            slice(int(a), int(b)) for a, b in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
        )

    @cached_property
    def probe_motion(self) -> ToolMotion:
        """The motion of the middle of the probe's face."""
        return ToolMotion(self.time_s, self.probe_to_reference)

    @cached_property
    def needle_motion(self) -> ToolMotion | None:
        """The motion of the needle's tip while it is in; None where that is one sample at most."""
        inside = self.inside
        if inside.sum() < 2:
            return None
        return ToolMotion.of_needle(self.time_s[inside], self.entry[inside], self.tip[inside])

    @property
    def depth_mm(self) -> Array:
        """(n,) inserted length; NaN while the needle is out."""
        return np.linalg.norm(self.tip - self.entry, axis=1)

    def __repr__(self) -> str:
        count, seconds = len(self.passes), self.time_s[-1] - self.time_s[0]
        return f"Trace({len(self.time_s)} samples, {seconds:.4g} s, {count} pass{'es' if count != 1 else ''})"


class Sample(NamedTuple):
    """What a trace keeps of a frame, which holds the tissue's whole field."""

    name: str
    """Of the target."""
    entry: Array
    tip: Array
    probe_to_reference: Array
    target: Array
    target_rest: Array
    out_of_plane: float
    half_slice: float
    axial_n: float
    structure: str

    @classmethod
    def of(cls, frame: SimulatedFrame, scene: Scene | None) -> Sample:
        """Return that of a frame; without a scene it does not say what the tip is in."""
        needle, force = frame.needle, next(iter(frame.forces.values()), None)
        entry, tip = (_NOWHERE, _NOWHERE) if needle is None else (needle.entry, needle.tip)
        seen = (np.nan, np.nan) if needle is None else (frame.readouts.out_of_plane, frame.readouts.half_slice)
        return cls(
            frame.target, entry, tip, frame.probe_to_reference, frame.target_now, frame.target_rest, *seen,
            np.nan if force is None else force.axial_n,
            "" if needle is None or scene is None else structure_at(scene, frame.field, needle.tip),
        )  # fmt: skip

    def __repr__(self) -> str:
        return f"Sample({self.name!r}, tip at {self.tip.round(2).tolist()}, in {self.structure!r})"


def structure_at(scene: Scene, field: Field, point: Array) -> str:
    """Return the name of the tissue that is at a point now; empty where it has none."""
    if scene.tissues is None:
        return ""
    rest = field.inverse(point[None])
    if not np.isfinite(rest).all():
        return ""
    names = getattr(scene.tissues.labels, "names", None) or {}
    return str(names.get(int(scene.tissues.labels_at(rest)[0]), ""))


def _known(points: Array) -> Flags:
    found: Flags = np.asarray(np.isfinite(points).all(axis=1))
    return found


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(value, float, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} is not numeric; give numbers") from None
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; give {shape}, as many as time_s has samples")
    array.setflags(write=False)
    return array
