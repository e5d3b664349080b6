"""What a trainer asks of a lab with 10,000 attempts: where everybody stands, learning curves, and the page's answer.

Claim: 0.2 s at most, median, with SQLite and with PostgreSQL; the page's answer is the message with standings and the
curves of an exercise, as it is sent.

    python benchmarks/a_lab_of_ten_thousand_attempts_answers_at_once.py [sqlite] [postgresql]

PostgreSQL is the system's, started here on a free port; both by default. Ends with 1 where it takes longer.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from lab_stores import fresh, postgresql, record
from sonospline.course.course import Course
from sonospline.lab import ResultStore
from sonospline.server import wire
from sonospline.server.scene_catalog import SceneCatalog
from sonospline.training import METRICS

ATTEMPTS, PEOPLE, EXERCISES, MOST_S, TIMES = 10_000, 100, 6, 0.2, 15


def filled(store):
    """A lab in which everybody has tried everything some sixteen times, every metric known."""
    for person in range(PEOPLE):
        store.add_participant(f"K-{person}", group=f"group {person % 5}")
    values = dict.fromkeys(METRICS, 1.25)
    for k in range(ATTEMPTS):
        one = replace(record(f"exercise {k % EXERCISES}", passed=k % 3 > 0), metrics=values)
        store.add(f"K-{k // EXERCISES % PEOPLE}", one, session=f"day {k // 1000}")


def taken(ask):
    times = []
    for _ in range(TIMES):
        began = time.perf_counter()
        ask()
        times.append(time.perf_counter() - began)
    return median(times)


def judge(name, address):
    with ResultStore(address) as store:
        began = time.perf_counter()
        filled(store)
        each = (time.perf_counter() - began) / ATTEMPTS
        standings = taken(store.standings)
        curve = taken(lambda: store.curve("K-7", "exercise 1"))
        office = Course(SceneCatalog(), store, stations=1, name="day", keeps_recordings=False)
        page = taken(lambda: wire.text(office.results(today=True, exercise="exercise 1")))
        assert len(store.standings()) == PEOPLE * EXERCISES
    print(
        f"{name:10s}: standings {1e3 * standings:6.1f} ms, a curve {1e3 * curve:5.1f} ms, the page's "
        f"answer {1e3 * page:.1f} ms / {1e3 * MOST_S:g}; an attempt is kept in "
        f"{1e3 * each:.1f} ms"
    )
    return max(standings, curve, page) <= MOST_S


asked = sys.argv[1:] or ["sqlite", "postgresql"]
met = []
if "sqlite" in asked:
    with tempfile.TemporaryDirectory() as folder:
        met.append(judge("SQLite", Path(folder) / "course.db"))
if "postgresql" in asked:
    with postgresql() as port:
        met.append(judge("PostgreSQL", fresh(port, "course")))
sys.exit(not all(met))
