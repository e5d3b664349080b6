"""What a lab must not lose: results behind one that fails, comments on an attempt that moves; and nothing twice."""

from datetime import UTC, datetime
from types import SimpleNamespace

import pytest

pytest.importorskip("sqlalchemy")

from lab_stores import record
from sonospline.course.attempt_notes import AttemptNotes
from sonospline.course.course import Course
from sonospline.course.finished_attempt import FinishedAttempt
from sonospline.course.keeper import Keeper
from sonospline.course.station import Station
from sonospline.lab import AttemptRecord, ResultStore
from sonospline.lab.database import LabDatabaseError, LabDataError


def failing(error):
    def job():
        raise error

    return job


def test_at_the_end_each_job_is_tried_and_one_that_fails_stops_no_other():
    said, done = [], []
    keeper = Keeper(retry_s=60)
    keeper.do(failing(LabDatabaseError("course.db: is away")), said.append)
    keeper.do(lambda: done.append(1), said.append)
    keeper.do(lambda: done.append(2), said.append)
    assert keeper.close(5.0) == 1 and done == [1, 2] and "is away" in keeper.problem


def test_what_the_database_never_takes_is_said_and_tried_once():
    said, done = [], []
    keeper = Keeper(retry_s=60)
    keeper.do(failing(LabDataError("course.db: invalid byte sequence")), said.append)
    keeper.do(lambda: done.append(1), said.append)
    assert keeper.close(5.0) == 0 and done == [1]
    assert said == ["The result could not be kept: course.db: invalid byte sequence"]


def test_a_repeat_under_a_key_is_no_double(tmp_path):
    """As after a commit whose answer was lost."""
    with ResultStore(tmp_path / "course.db") as store:
        store.add_participant("K-17")
        first = store.add("K-17", record(), key="a")
        assert store.add("K-17", record(), key="a") == first != store.add("K-17", record(), key="b")
        assert len(list(store.attempts())) == 2
        for key in ("c", "c", "d"):
            store.add_comment(first, 0.5, "Sweep first.", key=key)
        assert len(store.comments(first)) == 2
        with pytest.raises(ValueError, match="holds a zero character"):
            store.add_comment(first, 0.5, "a\0b")


def test_a_comment_says_that_its_attempt_was_not_kept():
    with pytest.raises(ValueError, match=r"was not kept, and neither is its comment 'Good\.'"):
        FinishedAttempt("K-1", None, None).comment(None, 0.5, "Good.", key="a")


class Office:
    """Keeps nothing, and knows what it was given."""

    keeps_recordings = False

    def __init__(self):
        self.stations = [Station(name, self) for name in "12"]
        self.kept, self.comments = [], []

    def seat_of(self, code):
        return next((one for one in self.stations if one.connection and one.participant == code), None)

    def keep(self, finished, say):
        self.kept.append(finished.participant)

    def keep_comment(self, finished, time_s, text, say):
        self.comments.append((finished.participant, text))


def page(key):
    sender = SimpleNamespace(say=lambda message: None, call=lambda work, argument: work(argument))
    return SimpleNamespace(key=key, sender=sender)


def begun(station):
    """An attempt of somebody, with a comment."""
    recording = SimpleNamespace(path=None, problem="")
    attempt = SimpleNamespace(
        exercise="block", over=False, on_result=None, recording=recording, attempt=SimpleNamespace(result="passed")
    )
    station.take(page("one"))
    station.participant = "K-1"
    station.began("block", attempt)
    station.comment(0.5, "Sweep first.")
    station.leave(station.connection)
    station.take(page("two"))
    station.participant = "K-2"
    return attempt


def test_comments_on_an_attempt_that_nobody_comes_back_to_are_kept():
    office = Office()
    attempt = begun(office.stations[0])
    attempt.on_result(attempt)
    assert office.kept == ["K-1"] and office.comments == [("K-1", "Sweep first.")]
    assert office.stations[0].comments == []


def test_an_attempt_that_goes_on_at_another_station_takes_its_comments_there():
    office = Office()
    attempt, there = begun(office.stations[0]), office.stations[1]
    there.take(page("one"))
    there.began("block", attempt)
    assert there.participant == "K-1" and isinstance(attempt.on_result, AttemptNotes)
    there.comment(0.25, "Good entry.")
    attempt.over = True
    attempt.on_result(attempt)
    there.comment(0.75, "Slower.")
    assert [one.text for one in there.comments] == ["Good entry.", "Sweep first.", "Slower."]
    assert office.comments == [("K-1", text) for text in ("Good entry.", "Sweep first.", "Slower.")]
    assert office.kept == ["K-1"]


def test_who_sat_down_while_the_results_were_away_is_added_with_the_attempt(tmp_path, monkeypatch):
    monkeypatch.setattr(AttemptRecord, "of", lambda *args, **options: record())
    with ResultStore(tmp_path / "course.db") as store:
        for _ in range(2):
            FinishedAttempt("K-1", None, datetime.now(UTC)).keep(store, "Tuesday")
        with pytest.raises(ValueError, match=r"session = .* give 1 to 200"):
            FinishedAttempt("K-1", None, datetime.now(UTC)).keep(store, " ")
        assert store.participants() == [("K-1", None)] and len(list(store.attempts())) == 2


def test_a_course_that_the_results_cannot_keep_is_refused_at_its_start(tmp_path):
    with ResultStore(tmp_path / "course.db") as store:
        for name in (" ", "x" * 201):
            with pytest.raises(ValueError, match="give 1 to 200"):
                Course(None, store, stations=1, name=name, keeps_recordings=False)
