"""A course: its stations, and the results it writes to."""

from __future__ import annotations

import asyncio
from datetime import datetime
from uuid import uuid4

from ..lab.cusum import Cusum
from ..lab.database import LabDatabaseError
from ..lab.result_store import ResultStore
from ..server.scene_catalog import SceneCatalog
from ..server.server_messages import Choice
from .finished_attempt import FinishedAttempt
from .keeper import Keeper, Say
from .station import Station
from .trainer_messages import CurveRow, Results, StandingRow

MOST_CURVES = 24
"""Learning curves that are shown at once."""


class Course:
    """Stations by their names, and what they keep.

    Parameters
    ----------
    catalog : SceneCatalog
        Scenes and exercises on offer.
    store : ResultStore
        The results.
    stations : int
        How many there are; they are called by their numbers.
    name : str
        The session of the lab to which attempts belong.
    keeps_recordings : bool
        Whether files of attempts stay, so that results may name them.

    Raises
    ------
    ValueError
        The name is empty, or has more than 200 letters.
    LabDatabaseError
        The results are away.
    """

    def __init__(
        self, catalog: SceneCatalog, store: ResultStore, *, stations: int, name: str, keeps_recordings: bool
    ) -> None:
        store.begin_session(name)
        self.catalog, self.store, self.name, self.keeps_recordings = catalog, store, name, keeps_recordings
        self.stations = {str(number): Station(str(number), self) for number in range(1, stations + 1)}
        self.keeper = Keeper()

    def place(self, asked: str, key: str) -> Station | str:
        """Return the station for a page, or why there is none.

        Parameters
        ----------
        asked : str
            Name of a station; empty for any.
        key : str
            Of the session that the page wants to go on with; empty for a new one.
        """
        own = next((one for one in self.stations.values() if key and one.key == key), None)
        if not asked:
            free = (one for one in self.stations.values() if one.connection is None)
            return own or next(free, None) or f"all {len(self.stations)} stations are in use"
        station = self.stations.get(asked)
        if station is None:
            return f"station {asked[:20]!r} is not here; take 1 to {len(self.stations)}"
        return station if station is own or station.connection is None else f"station {asked} is in use; take another"

    def seat_of(self, code: str) -> Station | None:
        """Return where a participant sits now."""
        here = (one for one in self.stations.values() if one.connection is not None)
        return next((one for one in here if one.participant == code), None)

    def title(self, exercise: str) -> str:
        """Return what an exercise on offer is called."""
        return self.catalog.exercises.entries[exercise].exercise.name

    @property
    def exercises(self) -> tuple[Choice, ...]:
        """Those on offer."""
        return tuple(Choice(id=one.id, name=one.name) for one in self.catalog.exercises.offer.offered)

    async def why_unknown(self, code: str) -> str | None:
        """Return why nobody has a code; None where somebody has, or where the results are away."""
        try:
            people = await asyncio.to_thread(self.store.participants)
        except LabDatabaseError:
            return None
        if code in {known for known, _ in people}:
            return None
        return f"code = {code!r} has no place here; ask the trainer to add it"

    def keep(self, finished: FinishedAttempt, say: Say) -> None:
        """Have an attempt kept; in any thread."""
        self.keeper.do(lambda: finished.keep(self.store, self.name), say)

    def keep_comment(self, finished: FinishedAttempt, time_s: float, text: str, say: Say) -> None:
        """Have a comment kept, after its attempt."""
        key = uuid4().hex
        self.keeper.do(lambda: finished.comment(self.store, time_s, text, key=key), say)

    def results(self, *, today: bool, exercise: str | None) -> Results:
        """Return where participants stand, and the learning curves of an exercise.

        Raises
        ------
        LabDatabaseError
            They are away.
        """
        midnight = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)
        standings = self.store.standings(since=midnight if today else None)
        attempted = tuple(dict.fromkeys(one.exercise for one in standings))
        exercise = exercise or next(iter(attempted), None)
        test = Cusum()
        curves = {} if exercise is None else self.store.curves(exercise, test=test)
        return Results(
            standings=tuple(
                StandingRow(**one._asdict() | {"last": one.last.isoformat(timespec="seconds")}) for one in standings
            ),
            exercise=exercise, exercises=attempted,
            curves=tuple(
                CurveRow(participant=code, sums=tuple(curve.sums.round(4).tolist()), decision=curve.decision)
                for code, curve in list(curves.items())[:MOST_CURVES]
            ),
            acceptable=test.acceptable, unacceptable=test.unacceptable, upper=test.upper, lower=test.lower,
            participants=tuple(code for code, _ in self.store.participants()),
        )  # fmt: skip

    def close(self) -> int:
        """Keep what waits, leave the results, and return how many attempts could not be kept."""
        lost = self.keeper.close(within_s=_LAST_S)
        self.store.close()
        return lost


_LAST_S = 30.0
"""How long an end waits for results to be kept: longer than a database waits for another writer."""
