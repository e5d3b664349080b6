"""The lab's database, on SQLite and on a real PostgreSQL: what is kept, what is refused, what goes wrong."""

import json
import multiprocessing
import sqlite3
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from lab_stores import fresh, postgresql, record, write_as_a_station
from sonospline import cli
from sonospline.lab import AttemptRecord, Cusum, ResultStore, write_tables
from sonospline.lab.database import LabDatabaseError, LabDataError
from sonospline.simulator import make_scene
from sonospline.training import METRICS, Attempt, Exercise, Novice, performed


@pytest.fixture(scope="session")
def server():
    with postgresql() as port:
        yield port


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def address(request, tmp_path):
    """Of an empty database."""
    if request.param == "sqlite":
        return str(tmp_path / "course.db")
    return fresh(request.getfixturevalue("server"), tmp_path.name)


@pytest.fixture
def store(address):
    with ResultStore(address) as found:
        yield found


def test_what_is_kept_comes_back(store):
    store.add_participant("K-17", group="Tuesday")
    store.add_participant("K-18")
    began = datetime(2026, 5, 4, 9, 30, tzinfo=UTC)
    kept = record(began=began, recording="one.mcap", recording_hash="f00d")
    assert [store.add("K-17", kept, session="morning"), store.add("K-17", record(passed=False))] == [1, 2]
    assert store.participants() == [("K-17", "Tuesday"), ("K-18", None)]
    first, second = store.attempts()
    assert first["began"] == began and first["session"] == "morning" and first["recording"] == "one.mcap"
    assert (first["participant"], first["group"], first["final_error_mm"]) == ("K-17", "Tuesday", 1.5)
    assert second["passed"] is False and second["recording"] is None
    (standing,) = store.standings()
    assert (standing.attempts, standing.passed, standing.last_passed) == (2, 1, False)
    assert (standing.final_error_mm, standing.blind_advance_mm) == (1.5, 0.0)
    assert store.standings(group="Wednesday") == [] and store.standings(since=datetime(2100, 1, 1, tzinfo=UTC)) == []
    assert [one["attempt"] for one in store.attempts(participant="K-18")] == []


def test_the_result_of_an_attempt_is_kept_whole(store):
    exercise = Exercise.shipped("vessel-in-plane")
    result = performed(Attempt(exercise, make_scene(exercise.scene_file()), seed=5), Novice())
    store.add_participant("K-17")
    store.add("K-17", AttemptRecord.of(result))
    (kept,) = store.attempts()
    known = {name: value for name, value in result.metrics.items() if not np.isnan(value)}
    assert {name: kept[name] for name in METRICS if name in kept} == known
    assert (kept["exercise"], kept["ended"], kept["passed"], kept["seed"]) == (exercise.name, "on target", False, 5)


def test_a_code_that_is_taken_or_a_name_is_refused(store):
    store.add_participant("K-17")
    with pytest.raises(ValueError, match=r"^code = 'K-17' is taken; give another one$"):
        store.add_participants(("K-18", "K-17"), group="Friday")
    assert store.participants() == [("K-17", None)], "all of them or none"
    for name in ("Anna Smith", "Anna", "", "K" * 16 + "1", "K 17", 17):
        with pytest.raises(ValueError, match="names are not kept"):
            store.add_participant(name)
    with pytest.raises(ValueError, match="has no place here"):
        store.add("K-99", record())
    assert store.participants() == [("K-17", None)] and list(store.attempts()) == []


def test_comments_and_curves_are_of_their_attempts(store):
    for code in ("K-17", "K-18"):
        store.add_participant(code)
    for code, passed in (("K-17", True), ("K-18", False), ("K-17", False)):
        store.add(code, record(passed=passed))
    store.add_comment(2, 12.5, " Sweep first. ")
    store.add_comment(2, 3.0, "Good.")
    assert store.comments(2) == [(3.0, "Good."), (12.5, "Sweep first.")] and store.comments(1) == []
    curves = store.curves("Vessel")
    assert {code: curve.failed.tolist() for code, curve in curves.items()} == {"K-17": [False, True], "K-18": [True]}
    for code, curve in curves.items():
        np.testing.assert_array_equal(curve.sums, store.curve(code, "Vessel").sums)
    for attempt, time_s, text, problem in ((9, 1, "x", "is not kept here"), (1, -1, "x", "out of range"),
                                           (1, np.nan, "x", "out of range"), (1, 1, "  ", "has 0 letters"),
                                           (1, 1, "x" * 501, "has 501 letters")):  # fmt: skip
        with pytest.raises(ValueError, match=problem):
            store.add_comment(attempt, time_s, text)


def test_what_fails_midway_leaves_nothing(store):
    store.add_participant("K-17")
    with pytest.raises(ValueError, match="could not convert"):
        store.add("K-17", replace(record(), metrics={"passes": "many"}))
    assert list(store.attempts()) == []


@pytest.mark.slow
def test_stations_that_write_at_once_lose_nothing(address):
    """They also make the same tables, group, session and exercise at once."""
    context = multiprocessing.get_context("spawn")
    stations = [context.Process(target=write_as_a_station, args=(address, number, 10)) for number in range(3)]
    for station in stations:
        station.start()
    for station in stations:
        station.join()
        assert station.exitcode == 0
    with ResultStore(address) as store:
        assert [one.attempts for one in store.standings()] == [10, 10, 10]
        assert {group for _, group in store.participants()} == {"one for all"}


def test_tables_are_read_by_pandas(store, tmp_path):
    pandas = pytest.importorskip("pandas")
    store.add_participant("K-17", group="=1+1")
    store.add("K-17", record())
    store.add("K-17", record(passed=False))
    assert write_tables(store.attempts(), tmp_path) == ("attempts.csv", "attempts.parquet")
    text, binary = pandas.read_csv(tmp_path / "attempts.csv"), pandas.read_parquet(tmp_path / "attempts.parquet")
    assert list(text) == list(binary)
    for table in (text, binary):
        assert table["passed"].tolist() == [True, False] and table["final_error_mm"].tolist() == [1.5, 1.5]
        assert table["peak_force_n"].isna().all()
    assert text["group"].tolist() == ["'=1+1"] * 2, "no formula for a spreadsheet"


def test_a_database_that_is_not_the_lab_s_is_refused(tmp_path):
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE songs (id INTEGER)")
    with pytest.raises(LabDatabaseError, match=r"holds tables of something else \(songs\)"):
        ResultStore(path)
    path.write_bytes(b"no database, and long enough to be one" * 100)
    with pytest.raises(LabDatabaseError, match="file is not a database"):
        ResultStore(path)
    with pytest.raises(ValueError, match="is a folder; give a file"):
        ResultStore(tmp_path)
    with pytest.raises(ValueError, match="there is no folder"):
        ResultStore(tmp_path / "none" / "course.db")
    with pytest.raises(ValueError, match="is no address that SQLAlchemy knows"):
        ResultStore("letters://somewhere")


def test_tables_of_another_version_are_refused(tmp_path):
    path = tmp_path / "course.db"
    ResultStore(path).close()
    with sqlite3.connect(path) as kept:
        kept.execute("UPDATE about SET value = '0'")
    with pytest.raises(LabDatabaseError, match="has tables of version 0, this sonospline reads 3"):
        ResultStore(path)


@pytest.mark.parametrize(("version", "lacks"), [("1", ("comments", "keys")), ("2", ("keys",))])
def test_tables_of_a_version_before_get_what_they_lack(tmp_path, version, lacks):
    path = tmp_path / "course.db"
    with ResultStore(path) as store:
        store.add_participant("K-17")
        store.add("K-17", record())
    with sqlite3.connect(path) as kept:
        for table in lacks:
            kept.execute(f"DROP TABLE {table}")
        kept.execute("UPDATE about SET value = ?", (version,))
    for _ in range(2):
        with ResultStore(path) as store:
            assert store.add("K-17", record(), key="a") == 2
            store.add_comment(1, 2.0, "Kept.")
            store.add_comment(2, 2.0, "Kept once.", key="b")
    with ResultStore(path) as store:
        assert store.comments(1) == [(2.0, "Kept.")] * 2 and store.comments(2) == [(2.0, "Kept once.")]
        assert len(list(store.attempts())) == 2


def test_values_that_break_a_rule_of_the_tables_are_told_from_a_database_that_is_away(store):
    lost = store._tables.metrics.insert().values(attempt_id=9, name="passes", value=1.0)
    with pytest.raises(LabDataError, match=r"(?i)foreign key"):
        store._database.write(lambda connection: connection.execute(lost))


def test_a_database_that_is_away_is_said_without_its_password():
    with pytest.raises(LabDatabaseError) as raised:
        ResultStore("postgresql+pg8000://lab:secret@127.0.0.1:1/course")
    assert "secret" not in str(raised.value) and "\n" not in str(raised.value)


def test_a_full_disk_is_said_and_what_was_kept_stays(tmp_path):
    path = tmp_path / "course.db"
    with ResultStore(path) as store:
        store.add_participant("K-17")
        store.add("K-17", record())
        engine, event = store._database._engine, store._database.sql.event
        event.listen(engine, "begin", lambda one: one.exec_driver_sql("PRAGMA max_page_count=1"))
        with pytest.raises(LabDatabaseError, match="its disk is full; nothing was kept of this attempt"):
            for _ in range(200):
                store.add("K-17", record())
    with ResultStore(path) as store:
        assert [one["final_error_mm"] for one in store.attempts()][:1] == [1.5]


rates = st.tuples(st.floats(0.02, 0.3), st.floats(0.32, 0.8), st.floats(0.01, 0.4), st.floats(0.01, 0.4))


@given(rates=rates, failed=st.lists(st.booleans(), max_size=60))
def test_the_curve_is_the_likelihood_ratio(rates, failed):
    test = Cusum(*rates)
    curve = test.curve(failed)
    scale = np.log(rates[1] / rates[0]) + np.log((1 - rates[0]) / (1 - rates[1]))
    for n, at in enumerate(curve.sums, 1):
        k = sum(failed[:n])
        assert at * scale == pytest.approx(binom.logpmf(k, n, rates[1]) - binom.logpmf(k, n, rates[0]), abs=1e-8)


def test_wald_s_error_rates_hold():
    """Of those who fail as rarely as is acceptable a tenth at most is found wanting, and the other way round."""
    test, rng = Cusum(), np.random.default_rng(0)
    for rate, wrong in ((0.10, "needs teaching"), (0.25, "proficient")):
        first = [test.curve(rng.random(300) < rate).decisions[0][1] for _ in range(300)]
        assert first.count(wrong) / 300 <= 0.13


def test_a_curve_without_attempts_decides_nothing():
    curve = Cusum().curve([])
    assert curve.decision == "undecided" and curve.sums.shape == (0,)


@pytest.mark.parametrize("bad", [{"acceptable": 0.3}, {"unacceptable": 1.0}, {"acceptable": 0}, {"alpha": 0.5}])
def test_a_test_that_cannot_be_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Cusum(**bad)


def test_the_verb_adds_shows_and_exports(tmp_path, capsys):
    path = tmp_path / "course.db"
    assert cli.main(["results", str(path)]) == 2
    assert "--add CODE makes it" in capsys.readouterr().err
    assert cli.main(["results", str(path), "--add", "K-17", "K-18", "--group", "Tuesday"]) == 0
    with ResultStore(path) as store:
        for passed in [False] * 3 + [True] * 20:
            store.add("K-17", record(passed=passed))
    capsys.readouterr()
    out = tmp_path / "tables"
    words = ["results", str(path), "--curve", "K-17", "Vessel", "--export", str(out), "--json"]
    assert cli.main(words) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["database"] == "course.db"
    assert report["standings"][0]["passed"] == 20 and report["curve"]["decision"] == "proficient"
    assert sorted(file.name for file in out.iterdir()) == ["attempts.csv", "attempts.parquet"]
    assert cli.main(words[:-1]) == 0
    shown = capsys.readouterr().out
    assert "20 of 23" in shown and "needs teaching" in shown and "proficient" in shown
