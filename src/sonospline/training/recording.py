"""Read a recording: whole, or as far as a kill has left it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np

from .._digest import digest_of_bytes
from .._extras import require
from .._shown import shown
from .recorder import HEADER, READ_FORMATS, STEPS
from .step import Step, made_whole
from .trace import Trace

_MAGIC = b"\x89MCAP0\r\n"
_LARGEST = 2**30
"""Bytes of a file that is read: some sixteen hours."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """What was written down of a session.

    Parameters
    ----------
    header : dict of str to str
        Format, version, backend, instruction set, scene and its hash, when it began.
    steps : tuple of Step
        Each whole, with what it left out.
    whole : bool
        Whether the file ends as it should; else it holds what was kept until half a second before.
    content_hash : str
        Of the file's bytes.
    """

    header: dict[str, str]
    steps: tuple[Step, ...]
    whole: bool
    content_hash: str

    @classmethod
    def read(cls, path: str | PathLike[str]) -> Recording:
        """Read a file.

        Raises
        ------
        ValueError
            No recording of Sonospline's, one of another format, or one that was changed by hand: in one line.
        """
        path = Path(path)
        if path.stat().st_size > _LARGEST:
            raise ValueError(f"{path.name} has {path.stat().st_size} bytes; a recording has {_LARGEST} at most")
        content = path.read_bytes()
        header, messages, whole = _parts(path.name, content)
        if header.get("format") not in READ_FORMATS:
            raise ValueError(
                f"{path.name} is a recording of format {shown(header.get('format'))}; this version reads "
                f"{' and '.join(READ_FORMATS)}: "
                f"replay it with sonospline {header.get('version', '?')}"
            )
        steps = tuple(_steps(path.name, messages))
        if not steps:
            raise ValueError(f"{path.name} holds no step")
        return cls(header, steps, whole, digest_of_bytes(content))

    @property
    def seconds(self) -> float:
        """Of the session's time, from the first step to the last."""
        return _time_of(self.steps[-1]) - _time_of(self.steps[0])

    @property
    def attempt(self) -> tuple[Step, ...]:
        """The steps that the last one goes on from, and itself: without what was undone."""
        before, found, at = parents(self.steps), [], len(self.steps) - 1
        while at >= 0:
            found.append(self.steps[at])
            at = before[at]
        return tuple(reversed(found))

    def trace(self) -> Trace:
        """Return the attempt as metrics take it; steps in which no time passed are left out but for the last."""
        steps = _last_at_each_time(self.attempt)
        needles = [next(iter((step.needles or {}).values()), None) for step in steps]
        nowhere = (np.nan,) * 3
        return Trace(
            time_s=np.array([step.time_s for step in steps]),
            entry=np.array([nowhere if needle is None else needle.entry for needle in needles]),
            tip=np.array([nowhere if needle is None else needle.tip for needle in needles]),
            probe_to_reference=np.array([pose_of(step) for step in steps]),
            target=np.array([step.target_now for step in steps]),
            target_rest=np.array(steps[-1].target_rest),
            out_of_plane=_known([step.out_of_plane for step in steps]),
            half_slice=_known([step.half_slice for step in steps]),
            axial_n=_known([step.axial_n for step in steps]),
            structures=tuple(step.structure for step in steps),
        )

    def __repr__(self) -> str:
        cut = "" if self.whole else ", cut off"
        return f"Recording({self.header['scene']!r}, {len(self.steps)} steps, {self.seconds:.4g} s{cut})"


def pose_of(step: Step) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the probe's pose (4, 4) in a whole step."""
    return np.vstack([np.array(step.probe_to_reference).T, (0.0, 0.0, 0.0, 1.0)])


def parents(steps: tuple[Step, ...]) -> list[int]:
    """Return for each step the place of the one that it goes on from; -1 for a first one."""
    latest: dict[int, int] = {-1: -1}
    found = []
    for at, step in enumerate(steps):
        found.append(latest[step.number - 1])
        latest[step.number] = at
    return found


def _last_at_each_time(steps: tuple[Step, ...]) -> list[Step]:
    """Of steps at one time the last."""
    return [
        step
        for step, after in zip(steps, (*steps[1:], None), strict=True)
        if not after or _time_of(after) > _time_of(step)
    ]


def _time_of(step: Step) -> float:
    """When a whole step is."""
    return cast(float, step.time_s)


def _known(values: list[float | None]) -> Any:
    return np.array([np.nan if value is None else value for value in values])


def _parts(name: str, content: bytes) -> tuple[dict[str, str], list[bytes], bool]:
    """The header, the messages of steps, and whether the file ends as it should."""
    reader = require("mcap.stream_reader")
    if not content.startswith(_MAGIC):
        raise ValueError(f"{name} is no MCAP file; give one that a Recorder wrote")
    header: dict[str, str] = {}
    messages: list[bytes] = []
    channels: dict[int, str] = {}
    whole = len(content) > 2 * len(_MAGIC) and content.endswith(_MAGIC)
    try:
        for record in reader.StreamReader(BytesIO(content), validate_crcs=True, record_size_limit=_LARGEST).records:
            kind = type(record).__name__
            if kind == "Metadata" and record.name == HEADER:
                header = dict(record.metadata)
            elif kind == "Channel":
                channels[record.id] = record.topic
            elif kind == "Message" and channels.get(record.channel_id) == STEPS:
                messages.append(record.data)
    except Exception as error:  # the library's own, struct's, zstandard's: what a file cut off anywhere may raise
        if whole:
            raise ValueError(f"{name} was changed after it was written: {' '.join(str(error).split())[:80]}") from None
    if not header:
        raise ValueError(f"{name} is no recording of Sonospline's; give one that a Recorder wrote")
    return header, messages, whole


def _steps(name: str, messages: list[bytes]) -> Iterator[Step]:
    latest: dict[int, Step] = {}
    for place, message in enumerate(messages):
        try:
            step = msgspec.json.decode(message, type=Step)
            if step.number and step.number - 1 not in latest:
                raise ValueError(f"goes on from frame {step.number - 1}, which is not there")
            whole = made_whole(step, latest.get(step.number - 1))
        except (msgspec.MsgspecError, ValueError) as error:
            raise ValueError(f"{name}, step {place}: {' '.join(str(error).split())[:160]}") from None
        latest[step.number] = whole
        yield whole
