"""A step of a session as a recording keeps it: what was asked, what came of it, and a fingerprint of the picture."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..geometry.needle import Needle
from ..io.records import Record, about
from ..simulator.command import ImageSettings
from ..simulator.simulated_frame import SimulatedFrame
from ..simulator.tissue_settings import TissueSettings
from .trace import Sample

Array = NDArray[np.float64]
Point = tuple[float, float, float]
Place = tuple[Point, Point, Point, Point]


class RecordedNeedle(Record, frozen=True, kw_only=True):
    """A needle, RAS mm."""

    entry: Point
    tip: Point

    @property
    def needle(self) -> Needle:
        """It as a needle."""
        return Needle(self.entry, self.tip)


class Step(Record, frozen=True, kw_only=True, omit_defaults=True):
    """One step; what follows from the step before is left out: poses and settings as there, its time plus dt."""

    number: Annotated[int, about("of the frame; it goes on from the latest of the number before", low=0)]
    time_s: Annotated[float, about("of the session", low=0.0)] | None = None
    dt: Annotated[float, about("seconds that the step took", low=0.0)]
    image: Annotated[str, about("fingerprint of the pixels, BLAKE2b of 8 bytes")]
    target_now: Annotated[Point, about("where the target is, RAS mm")]
    model: Annotated[str, about("which model answered")] | None = None
    target: Annotated[str, about("name of the target")] | None = None
    target_rest: Annotated[Point, about("where it is at rest, RAS mm")] | None = None
    needles: Annotated[dict[str, RecordedNeedle], about("those in the tissue")] | None = None
    probe_to_reference: Annotated[Place, about("its upper three rows, column by column")] | None = None
    settings: ImageSettings | None = None
    tissue: TissueSettings | None = None
    out_of_plane: Annotated[float, about("of the tip, mm")] | None = None
    half_slice: Annotated[float, about("half the slice's thickness at the tip, mm")] | None = None
    axial_n: Annotated[float, about("force of the needle on the tissue, N")] | None = None
    structure: Annotated[str, about("what the tip is in")] = ""
    events: Annotated[tuple[str, ...], about("what happened")] = ()

    def __repr__(self) -> str:
        inside = "as before" if self.needles is None else ", ".join(self.needles) or "no needle"
        now = f"after {self.dt:.4g}" if self.time_s is None else f"{self.time_s:.4g}"
        return f"Step({self.number}, {now} s, {inside})"


_STAYS = ("model", "target", "target_rest", "needles", "probe_to_reference", "settings", "tissue")
"""What a step leaves out where it is as before."""


def fingerprint(pixels: NDArray[np.generic]) -> str:
    """Return a short text that two pictures share where every pixel is equal."""
    return hashlib.blake2b(np.ascontiguousarray(pixels).tobytes(), digest_size=8).hexdigest()


def step_of(frame: SimulatedFrame, sample: Sample, before: Step | None) -> Step:
    """Return the step that made a frame, without what is as in the whole step before."""
    whole = _whole(frame, sample)
    if before is None:
        return whole
    same = {name: None for name in _STAYS if getattr(whole, name) == getattr(before, name)}
    if whole.time_s == _after(before, whole):
        same["time_s"] = None
    return Step(**({name: getattr(whole, name) for name in Step.__struct_fields__} | same))


def made_whole(step: Step, before: Step | None) -> Step:
    """Return a step with what it left out.

    Raises
    ------
    ValueError
        There is no step before from which it could be had.
    """
    missing = [name for name in (*_STAYS, "time_s") if getattr(step, name) is None]
    if missing and before is None:
        raise ValueError(f"step {step.number} lacks {', '.join(missing)}, and nothing before says what they were")
    filled = {name: _after(before, step) if name == "time_s" else getattr(before, name) for name in missing}
    return Step(**({name: getattr(step, name) for name in Step.__struct_fields__} | filled))


def _after(before: Step | None, step: Step) -> float | None:
    """When a step is, where it goes on from a whole one."""
    return None if before is None or before.time_s is None else before.time_s + step.dt


def _whole(frame: SimulatedFrame, sample: Sample) -> Step:
    return Step(
        number=frame.number, time_s=frame.time_s, dt=frame.dt, image=fingerprint(frame.image.shown),
        target_now=_point(sample.target), model=frame.model, target=sample.name,
        target_rest=_point(sample.target_rest), needles=_needles(frame.needles),
        probe_to_reference=tuple(_point(column) for column in frame.probe_to_reference[:3].T),  # type: ignore[arg-type]
        settings=frame.settings, tissue=frame.tissue, out_of_plane=_known(sample.out_of_plane),
        half_slice=_known(sample.half_slice), axial_n=_known(sample.axial_n), structure=sample.structure,
        events=tuple(str(event) for event in frame.events),
    )  # fmt: skip


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _needles(needles: Mapping[str, Needle]) -> dict[str, RecordedNeedle]:
    return {
        name: RecordedNeedle(entry=_point(needle.entry), tip=_point(needle.tip)) for name, needle in needles.items()
    }


def _point(values: Array) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z
