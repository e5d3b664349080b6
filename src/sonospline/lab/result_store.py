"""What a skills lab keeps: groups, participants by code, sessions, and every attempt with its metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from .. import _validate
from .._shown import shown
from .attempt_record import AttemptRecord
from .cusum import Cusum, LearningCurve
from .database import Database
from .kept_text import check_code, check_comment, check_name
from .schema import schema
from .standing import Standing

_SHOWN = ("final_error_mm", "blind_advance_mm")
"""Metrics of a standing."""


class ResultStore:
    """The results of a lab, in a database.

    Parameters
    ----------
    address : str or Path
        A file for SQLite, made where there is none, or an address as SQLAlchemy takes it, e.g.
        ``postgresql+pg8000://lab@localhost/course``.

    Raises
    ------
    ValueError
        No address of a database.
    LabDatabaseError
        It cannot be reached, or its tables are of another version.
    MissingExtraError
        ``pip install 'sonospline[lab]'``.

    Notes
    -----
    Many processes and threads may write at once. Each method is one transaction: a kill leaves all of it or nothing.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from sonospline.lab import AttemptRecord, ResultStore
    >>> store = ResultStore(pathlib.Path(tempfile.mkdtemp()) / "course.db")
    >>> store.add_participant("K-17", group="Tuesday")
    >>> kept = store.add("K-17", AttemptRecord("Vessel", "a1", 3, "on target", True, "passed", 41.0, {"passes": 1.0}))
    >>> store.standings(), store.curve("K-17", "Vessel")
    ([Standing(K-17 at 'Vessel': 1 of 1 passed)], LearningCurve(1 attempts, 0 failed, undecided))
    >>> store.close()
    """

    def __init__(self, address: str | Path) -> None:
        self._database = Database(address)
        self._tables = schema()
        self._sql = self._database.sql

    @property
    def name(self) -> str:
        """What the database is called: a file without its folder, an address without its password."""
        return self._database.name

    def add_group(self, name: str) -> None:
        """Make a group, where there is none of its name."""
        self._database.write(lambda connection: self._group(connection, name))

    def add_participant(self, code: str, *, group: str | None = None) -> None:
        """Add somebody by a code: no name belongs here.

        Raises
        ------
        ValueError
            The code is taken, or is no code: at most 16 letters, digits, - and _, with a digit.
        """
        self.add_participants((code,), group=group)

    def add_participants(self, codes: Iterable[str], *, group: str | None = None) -> None:
        """Add some by their codes; none of them where one cannot be.

        Raises
        ------
        ValueError
            A code is taken, or is no code.
        """
        codes, people = tuple(dict.fromkeys(check_code(code) for code in codes)), self._tables.participants

        def work(connection: Any) -> None:
            group_id = None if group is None else self._group(connection, group)
            for code in codes:
                if self._found(connection, people, code=code) is not None:
                    raise ValueError(f"code = {code!r} is taken; give another one")
                self._inserted(connection, people, code=code, group_id=group_id)

        self._database.write(work)

    def begin_session(self, name: str) -> None:
        """Make a session of the lab, to which attempts may belong; one of that name goes on."""
        self._database.write(lambda connection: self._session(connection, name))

    def add(
        self, participant: str, record: AttemptRecord, *, session: str | None = None, key: str | None = None
    ) -> int:
        """Keep an attempt; return its number.

        Under a key of its own it is kept once: a repeat, where an answer was lost, returns the number of the first.

        Raises
        ------
        ValueError
            Nobody has the code.
        LabDatabaseError
            The database is away or full: nothing of it is kept.
        """
        return self._once(key, lambda connection: self._kept(connection, participant, record, session))

    def add_comment(self, attempt: int, time_s: float, text: str, *, key: str | None = None) -> None:
        """Keep what the trainer says of a moment of an attempt.

        Parameters
        ----------
        attempt : int
            Its number, as :meth:`add` returns it.
        time_s : float
            Seconds from its beginning.
        text : str
            At most 500 letters.
        key : str, optional
            Of this comment alone, which is kept once then.

        Raises
        ------
        ValueError
            No such attempt, a time before its beginning, or a text that is empty or too long.
        """
        table, attempts = self._tables.comments, self._tables.attempts
        values = {"time_s": _validate.number("time_s", time_s), "text": check_comment(text)}

        def work(connection: Any) -> int:
            if self._found(connection, attempts, id=attempt) is None:
                raise ValueError(f"attempt = {attempt} is not kept here")
            return self._inserted(connection, table, attempt_id=attempt, **values)

        self._once(key, work)

    def comments(self, attempt: int) -> list[tuple[float, str]]:
        """Return the comments on an attempt, each with its time in seconds, in the order of their times."""
        table = self._tables.comments
        query = self._sql.select(table.c.time_s, table.c.text).where(table.c.attempt_id == attempt)
        with self._database.reading() as connection:
            return [(time, text) for time, text in connection.execute(query.order_by(table.c.time_s, table.c.id))]

    def participants(self) -> list[tuple[str, str | None]]:
        """Return the codes, each with its group, in order."""
        people, groups = self._tables.participants, self._tables.groups
        query = (
            self._sql.select(people.c.code, groups.c.name).select_from(people.outerjoin(groups)).order_by(people.c.code)
        )
        with self._database.reading() as connection:
            return [(code, group) for code, group in connection.execute(query)]

    def standings(self, *, group: str | None = None, since: datetime | None = None) -> list[Standing]:
        """Return where each participant stands at each exercise, those who last did something first."""
        sql, tables = self._sql, self._tables
        attempts, people = tables.attempts, tables.participants
        newest = sql.func.max(attempts.c.id)
        counted = sql.select(
            attempts.c.participant_id, attempts.c.exercise_id, sql.func.count().label("attempts"),
            sql.func.sum(sql.cast(attempts.c.passed, sql.Integer)).label("passed"), newest.label("newest"),
        ).group_by(attempts.c.participant_id, attempts.c.exercise_id)  # fmt: skip
        if since is not None:
            counted = counted.where(attempts.c.began >= _naive(since))
        counts = counted.subquery()
        last = sql.alias(attempts)
        columns = [people.c.code, tables.groups.c.name, tables.exercises.c.name, counts.c.attempts, counts.c.passed]
        query = sql.select(*columns, last.c.began, last.c.passed, last.c.verdict, last.c.id).select_from(
            counts.join(last, last.c.id == counts.c.newest)
            .join(people, people.c.id == counts.c.participant_id)
            .outerjoin(tables.groups, tables.groups.c.id == people.c.group_id)
            .join(tables.exercises, tables.exercises.c.id == counts.c.exercise_id)
        )
        if group is not None:
            query = query.where(tables.groups.c.name == group)
        with self._database.reading() as connection:
            rows = connection.execute(query.order_by(last.c.id.desc())).all()
            known = self._metrics_of(connection, [row[-1] for row in rows], of=_SHOWN)
        return [
            Standing(
                code, group, exercise, attempts, passed, began.replace(tzinfo=UTC), last_passed, verdict,
                *(known.get((number, name)) for name in _SHOWN),
            )
            for code, group, exercise, attempts, passed, began, last_passed, verdict, number in rows
        ]  # fmt: skip

    def curve(self, participant: str, exercise: str, *, test: Cusum | None = None) -> LearningCurve:
        """Return the learning curve of a participant at an exercise.

        Raises
        ------
        ValueError
            Nobody has the code.
        """
        attempts, exercises = self._tables.attempts, self._tables.exercises
        query = (
            self._sql.select(attempts.c.passed)
            .join(exercises, exercises.c.id == attempts.c.exercise_id)
            .where(exercises.c.name == exercise)
            .order_by(attempts.c.id)
        )
        with self._database.reading() as connection:
            who = self._participant(connection, participant)
            passed = connection.scalars(query.where(attempts.c.participant_id == who)).all()
        return (test or Cusum()).curve(not one for one in passed)

    def curves(self, exercise: str, *, test: Cusum | None = None) -> dict[str, LearningCurve]:
        """Return the learning curves of all who have attempted an exercise, by their codes."""
        attempts, exercises, people = self._tables.attempts, self._tables.exercises, self._tables.participants
        query = (
            self._sql.select(people.c.code, attempts.c.passed)
            .select_from(attempts.join(exercises).join(people))
            .where(exercises.c.name == exercise)
            .order_by(attempts.c.id)
        )
        failed: dict[str, list[bool]] = {}
        with self._database.reading() as connection:
            for code, passed in connection.execute(query):
                failed.setdefault(code, []).append(not passed)
        return {code: (test or Cusum()).curve(found) for code, found in sorted(failed.items())}

    def attempts(self, *, participant: str | None = None, exercise: str | None = None) -> Iterator[dict[str, Any]]:
        """Yield every attempt in the order in which they were kept, its metrics among its values."""
        sql, tables = self._sql, self._tables
        attempts, people = tables.attempts, tables.participants
        query = (
            sql.select(
                attempts.c.id.label("attempt"), people.c.code.label("participant"),
                tables.groups.c.name.label("group"), tables.sessions.c.name.label("session"),
                tables.exercises.c.name.label("exercise"), tables.exercises.c.content_hash.label("exercise_hash"),
                attempts.c.seed, attempts.c.began, attempts.c.ended, attempts.c.passed, attempts.c.seconds,
                attempts.c.verdict, tables.recordings.c.name.label("recording"),
                tables.recordings.c.content_hash.label("recording_hash"),
            )
            .select_from(
                attempts.join(people).join(tables.exercises).outerjoin(tables.groups).outerjoin(tables.sessions)
                .outerjoin(tables.recordings)
            )
            .order_by(attempts.c.id)
        )  # fmt: skip
        if participant is not None:
            query = query.where(people.c.code == participant)
        if exercise is not None:
            query = query.where(tables.exercises.c.name == exercise)
        with self._database.reading() as connection:
            rows = [dict(row) for row in connection.execute(query).mappings()]
            known = self._metrics_of(connection, None if participant is exercise is None else [
                row["attempt"] for row in rows
            ])  # fmt: skip
        values: dict[int, dict[str, float]] = {}
        for (attempt, name), value in known.items():
            values.setdefault(attempt, {})[name] = value
        for row in rows:
            yield row | {"began": row["began"].replace(tzinfo=UTC)} | values.get(row["attempt"], {})

    def close(self) -> None:
        """Leave the database."""
        self._database.close()

    def __enter__(self) -> ResultStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _once(self, key: str | None, work: Callable[[Any], int]) -> int:
        """Do some work and return its number; under a key that is known, the number of the first time."""
        table = self._tables.keys

        def once(connection: Any) -> int:
            known: int | None = connection.scalar(self._sql.select(table.c.number).where(table.c.key == key))
            if known is not None:
                return known
            number = work(connection)
            connection.execute(table.insert().values(key=key, number=number))
            return number

        return self._database.write(work if key is None else once)

    def _kept(self, connection: Any, participant: str, record: AttemptRecord, session: str | None) -> int:
        tables = self._tables
        recording = record.recording and self._found(connection, tables.recordings, content_hash=record.recording_hash)
        if record.recording and not recording:
            recording = self._inserted(
                connection, tables.recordings, name=record.recording, content_hash=record.recording_hash
            )
        number = self._inserted(
            connection, tables.attempts, participant_id=self._participant(connection, participant),
            exercise_id=self._one(
                connection, tables.exercises, name=record.exercise, content_hash=record.exercise_hash
            ),
            recording_id=recording or None, session_id=None if session is None else self._session(connection, session),
            seed=record.seed, began=_naive(record.began), ended=record.ended, passed=record.passed,
            verdict=record.verdict, seconds=record.seconds,
        )  # fmt: skip
        values = [
            {"attempt_id": number, "name": name, "value": float(value)}
            for name, value in record.metrics.items()
            if value == value
        ]
        if values:
            connection.execute(tables.metrics.insert(), values)
        return number

    def _metrics_of(
        self, connection: Any, attempts: list[int] | None, *, of: Iterable[str] | None = None
    ) -> dict[tuple[int, str], float]:
        """Metrics of some attempts, or of all, by attempt and name."""
        table = self._tables.metrics
        query = self._sql.select(table.c.attempt_id, table.c.name, table.c.value)
        if of is not None:
            query = query.where(table.c.name.in_(of))
        if attempts is None:
            return {(attempt, name): value for attempt, name, value in connection.execute(query)}
        found = {}
        for part in _parts(attempts):
            rows = connection.execute(query.where(table.c.attempt_id.in_(part)))
            found.update({(attempt, name): value for attempt, name, value in rows})
        return found

    def _participant(self, connection: Any, code: str) -> int:
        found = self._found(connection, self._tables.participants, code=code)
        if found is None:
            raise ValueError(f"participant = {shown(code)} has no place here; add_participant() first")
        return found

    def _group(self, connection: Any, name: str) -> int:
        return self._one(connection, self._tables.groups, name=check_name("group", name))

    def _session(self, connection: Any, name: str) -> int:
        table, name = self._tables.sessions, check_name("session", name)
        found = self._found(connection, table, name=name)
        return found or self._inserted(connection, table, name=name, began=_naive(datetime.now(UTC)))

    def _one(self, connection: Any, table: Any, **values: Any) -> int:
        """The number of a row, which is made where there is none."""
        return self._found(connection, table, **values) or self._inserted(connection, table, **values)

    def _found(self, connection: Any, table: Any, **values: Any) -> int | None:
        query = self._sql.select(table.c.id).where(*(table.c[name] == value for name, value in values.items()))
        number: int | None = connection.scalar(query)
        return number

    def _inserted(self, connection: Any, table: Any, **values: Any) -> int:
        number: int = connection.scalar(table.insert().values(**values).returning(table.c.id))
        return number

    def __repr__(self) -> str:
        return f"ResultStore({self.name!r})"


def _naive(moment: datetime) -> datetime:
    """UTC without its name: SQLite keeps none."""
    if moment.tzinfo is None:
        raise ValueError(f"{moment} has no time zone; give one, e.g. datetime.now(UTC)")
    return moment.astimezone(UTC).replace(tzinfo=None)


def _parts(numbers: list[int], most: int = 10_000) -> Iterable[list[int]]:
    return (numbers[at : at + most] for at in range(0, len(numbers), most))
