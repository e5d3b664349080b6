"""The exercises a server offers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..training.attempt_recording import Recordings
from .server_messages import Exercises, OfferedExercise, OfferedMark, Zone

if TYPE_CHECKING:
    from ..training.exercise import Exercise

MOST = 200
"""Exercises of a folder."""


@dataclass(frozen=True)
class ExerciseEntry:
    """An exercise on offer."""

    exercise: Exercise
    folder: Path


class ExerciseCatalog:
    """Exercises by their id.

    Parameters
    ----------
    own : mapping of str to ExerciseEntry, optional
        Exercises of the user's, before the shipped ones.
    recordings : Recordings, optional
        Where attempts are written down.
    """

    def __init__(self, own: dict[str, ExerciseEntry] | None = None, *, recordings: Recordings | None = None) -> None:
        self._own = own or {}
        self.recordings = Recordings() if recordings is None else recordings

    @cached_property
    def entries(self) -> dict[str, ExerciseEntry]:
        """Those on offer; shipped ones are read when somebody asks."""
        from ..training.exercise import SHIPPED_EXERCISES, Exercise

        shipped = [name for name in SHIPPED_EXERCISES if name not in self._own]
        return {**self._own, **{name: ExerciseEntry(Exercise.shipped(name), Path()) for name in shipped}}

    @cached_property
    def offer(self) -> Exercises:
        """What a page is told of them."""
        return Exercises(offered=tuple(offered(name, entry.exercise) for name, entry in self.entries.items()))

    def close(self) -> None:
        """Remove recordings that were to be kept until now."""
        self.recordings.close()


def read_folder(folder: Path) -> dict[str, ExerciseEntry]:
    """Return the exercises of a folder's TOML files, by the names of these.

    Raises
    ------
    ValueError
        No such folder, none in it, too many, or one that is broken: file, line, value and remedy.
    """
    from ..training.exercise import Exercise

    files = sorted(folder.glob("*.toml")) if folder.is_dir() else []
    if not files:
        raise ValueError(f"--exercises = {str(folder)!r} holds no .toml file; give a folder of exercises")
    if len(files) > MOST:
        raise ValueError(f"--exercises = {str(folder)!r} holds {len(files)} files; give at most {MOST}")
    return {file.stem: ExerciseEntry(Exercise.read(file), folder) for file in files}


def offered(id: str, exercise: Exercise) -> OfferedExercise:
    """Return an exercise as its briefing says it."""
    from ..training.metric import METRICS

    zone = exercise.entry_zone
    return OfferedExercise(
        id=id, name=exercise.name, description=exercise.description, level=exercise.level, target=exercise.target,
        guides=exercise.guides, forbidden=exercise.forbidden, breathes=exercise.tissue.breathing != "none",
        time_limit_s=exercise.time_limit_s, most_passes=exercise.most_passes,
        zone=None if zone is None else Zone(u=zone.u, v=zone.v),
        marks=tuple(
            OfferedMark(metric=name, unit=METRICS[name].unit, least=mark.least, most=mark.most)
            for name, mark in exercise.pass_mark.items()
        ),
    )  # fmt: skip
