"""A lab over real sockets: who sits where, what the trainer sees and sets, and what is kept when things go wrong."""

import asyncio
import threading
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import numpy as np
import pytest

pytest.importorskip("mcap")
pytest.importorskip("sqlalchemy")
pytest.importorskip("websockets")

from websockets.exceptions import InvalidStatus

from lab_course import ANY, TOKEN, Lab, Trainee, Trainer
from sonospline.course import door as doors
from sonospline.course import schema
from sonospline.course.keeper import Keeper
from sonospline.course.trainer_connection import TrainerConnection
from sonospline.course.trainer_messages import KINDS
from sonospline.lab.database import LabDatabaseError
from sonospline.server import wire
from sonospline.server.client_messages import MessageError, parse
from sonospline.server.outbox import Outbox


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    running = Lab(tmp_path_factory.mktemp("lab"))
    for number in range(1, 9):
        running.store.add_participant(f"K-{number}", group="Tuesday")
    yield running
    running.stop()


def until(holds):
    """Look again and again, until something is so."""
    for _ in range(12_000):
        if holds():
            return
        threading.Event().wait(0.005)
    raise AssertionError("that did not come true")


@pytest.fixture(autouse=True)
def everybody_has_left(request):
    """The next test finds every station free."""
    yield
    if "lab" in request.fixturenames:
        stations = request.getfixturevalue("lab").course.stations.values()
        until(lambda: all(station.connection is None for station in stations))


def kept(lab, code):
    """Attempts of a participant, once all that waits is kept."""
    until(lambda: lab.course.keeper.waiting == 0)
    return list(lab.store.attempts(participant=code))


@pytest.mark.slow
def test_an_attempt_at_a_station_is_watched_commented_and_kept(lab):
    with Trainer(lab) as trainer, Trainee(lab, 1, "K-1") as trainee:
        assert trainer.until("lab_hello")["course"] == "Tuesday"
        trainer.send(type="watch_station", station="1")
        trainee.begin(seed=3)
        trainee.push(20.0)
        assert trainer.until("scene", lambda said: said["id"] == "block")["guides"] != []
        seen = trainer.until(wire.FRAME, lambda header: header["state"]["needle"]["depth"] > 15)
        trainee.push(22.0, 1)
        np.testing.assert_array_equal(seen["pixels"], trainee.pictures[seen["noise"]])
        assert seen["needle"] and seen["readouts"], "the trainer sees what the exercise hides"
        stands = trainer.station("1", lambda one: one["state"] == "running" and one["depth_mm"] > 15)
        assert (stands["participant"], stands["exercise"], stands["passes"]) == ("K-1", "Block, by the image", 1)
        trainer.send(type="comment_on", station="1", time_s=0.5, text="Sweep first. ")
        trainer.station("1", lambda one: one["comments"] != [])
        trainee.send(type="on_target")
        said = trainee.until_all({"station": lambda values: values["comments"], "debrief": ANY})
        assert said["station"]["comments"] == [{"time_s": 0.5, "text": "Sweep first."}]
        assert said["debrief"]["passed"]
        trainer.send(type="comment_on", station="1", time_s=0.25, text="Good entry.")
        said = trainee.until("station", lambda values: len(values["comments"]) == 2)
        assert [one["text"] for one in said["comments"]] == ["Good entry.", "Sweep first."]
        assert trainer.station("1", lambda one: one["state"] == "debrief")["word"] == "passed"
        (attempt,) = kept(lab, "K-1")
        assert (attempt["session"], attempt["seed"], attempt["passed"]) == ("Tuesday", 3, True)
        assert (lab.results.parent / "kept" / attempt["recording"]).is_file()
        assert [text for _, text in lab.store.comments(attempt["attempt"])] == ["Good entry.", "Sweep first."]
        trainer.send(type="list_results", today=True, exercise=None)
        found = trainer.until("results")
        assert found["standings"][0]["participant"] == "K-1" and found["curves"][0]["sums"] == [-0.166]


@pytest.mark.slow
def test_who_sits_down_is_known_and_sits_nowhere_else(lab):
    with Trainee(lab, 1, "K-2") as first, Trainee(lab, 2) as second:
        second.until("scene")
        for code, problem in (
            ("K-2", "sits at another station"),
            ("K-99", "has no place here"),
            ("Anna", "names are not kept"),
        ):
            second.send(type="sit_down", participant=code)
            assert problem in second.until("refused")["message"]
        second.send(type="begin_attempt", exercise="block")
        assert "enter your code" in second.until("refused")["message"]
        first.begin()
        first.send(type="sit_down", participant=None)
        assert "comes while an exercise runs" in first.until("refused")["message"]


@pytest.mark.slow
def test_what_the_trainer_sets_and_locks_holds(lab):
    with Trainer(lab) as trainer, Trainee(lab, 2, "K-3") as trainee:
        trainer.send(type="set_exercise", station=None, exercise="other")
        trainer.send(type="lock_station", station="2", what="models", on=True)
        trainer.send(type="lock_station", station="2", what="guides", on=True)
        trainee.until("scene", lambda scene: scene["guides"] == [])
        trainer.send(type="say_to_station", station="2", text="Sweep first")
        said = trainee.until("station", lambda values: values["said"])
        assert (said["exercise"], said["guides_locked"], said["models_locked"]) == ("other", True, True)
        header = trainee.push(8.0)
        assert [header[part] for part in ("needle", "target", "readouts")] == [None] * 3
        assert [header["pass"][part] for part in ("path_mm", "blind_mm")] == [None] * 2
        for message, problem in (
            ({"type": "begin_attempt", "exercise": "block"}, "begin Another block"),
            ({"type": "scene", "id": "small"}, "begin Another block"),
            ({"type": "model", "model": "paper"}, "is locked by the trainer"),
        ):
            trainee.send(**message)
            assert problem in trainee.until("refused")["message"]
        trainee.begin("other")
        trainee.push(5.0, 1)
        for what in ("guides", "models"):
            trainer.send(type="lock_station", station="2", what=what, on=False)
        trainer.send(type="set_exercise", station=None, exercise=None)
        trainer.station("2", lambda one: not one["guides_locked"] and one["exercise_set"] is None)


@pytest.mark.slow
def test_an_attempt_that_is_left_counts_as_given_up(lab):
    with Trainee(lab, 1, "K-4") as trainee:
        trainee.begin()
        trainee.push(8.0)
        trainee.begin()
    (attempt,) = kept(lab, "K-4")
    assert (attempt["ended"], attempt["passed"]) == ("given up", False)


@pytest.mark.slow
def test_a_database_that_is_away_is_said_at_once_and_loses_nothing(lab, monkeypatch):
    monkeypatch.setattr(lab.course.keeper, "_retry_s", 0.01)
    add, away = lab.store.add, threading.Event()

    def failing(*args, **options):
        if away.is_set():
            raise LabDatabaseError("course.db: its disk is full; nothing was kept of this attempt")
        return add(*args, **options)

    monkeypatch.setattr(lab.store, "add", failing)
    away.set()
    with Trainer(lab) as trainer, Trainee(lab, 1, "K-5") as one, Trainee(lab, 2, "K-6") as two:
        for trainee in (one, two):
            trainee.begin()
            trainee.push(6.0)
            trainee.send(type="on_target")
            assert "its disk is full" in trainee.until_all({"notice": ANY, "debrief": ANY})["notice"]["message"]
        assert trainer.until("stations", lambda said: said["waiting"] == 2)["problem"].startswith("course.db")
        two.begin()
        assert two.push(3.0)["state"]["needle"]["depth"] == 3
        away.clear()
        assert trainer.until("stations", lambda said: said["waiting"] == 0)["problem"] == ""
    assert len(kept(lab, "K-5")) == 1 and len(kept(lab, "K-6")) == 1


@pytest.mark.slow
def test_a_station_has_one_page_which_may_come_back(lab):
    with Trainee(lab, 1, "K-7") as trainee:
        key = lab.course.stations["1"].key
        with Trainee(lab, 1) as other, pytest.raises(Exception, match="station 1 is in use; take another"):
            other.until("hello")
        with Trainee(lab, 9) as nowhere, pytest.raises(Exception, match="is not here; take 1 to 2"):
            nowhere.until("hello")
        trainee.push(4.0, 1)
    with Trainee(lab, f"1&session={key}") as again:
        said = again.until_all({"station": ANY, "scene": ANY})
        assert said["station"]["participant"] == "K-7"
        assert said["scene"]["state"]["needle"]["depth"] == 4
    status, _ = lab.get("/station/2")
    assert status == 200, "a short address for a page"


def test_ten_wrong_tokens_lock_the_trainer_s_door_and_let_nothing_in(lab, monkeypatch):
    monkeypatch.setattr(lab.server, "door", doors.Door(TOKEN))
    with Trainer(lab) as inside:
        inside.until("lab_hello")
        for _ in range(doors.MOST_GUESSES):
            with pytest.raises(InvalidStatus), Trainer(lab, "guess"):
                pass
        assert lab.get("/trainer") == (403, doors.LOCKED)
        assert lab.get(f"/trainer?trainer={quote(TOKEN)}")[0] == 426, "the socket would open"
        assert lab.get("/attempts.csv?trainer=guess") == (403, doors.LOCKED)
        with Trainer(lab) as another:
            another.until("lab_hello")
        inside.send(type="ping")
        assert inside.until("pong"), "who is in stays in"


def test_the_door_knows_addresses_apart_and_counts_no_missing_token():
    now = [0.0]
    door = doors.Door(now_s=lambda: now[0])
    assert len(door.token) > 20
    for _ in range(50):
        assert door.refusal("", "10.0.0.1") == doors.WRONG
    assert [door.refusal("guess", "10.0.0.1") for _ in range(10)] == [doors.WRONG] * 9 + [doors.LOCKED]
    assert door.refusal("guess", "10.0.0.2") == doors.WRONG
    assert door.refusal(door.token, "10.0.0.1") is None, "a right token is no guess"
    now[0] = doors.LOCKED_S - 1
    assert door.refusal("guess", "10.0.0.1") == doors.LOCKED
    now[0] = doors.LOCKED_S
    assert door.refusal("guess", "10.0.0.1") == doors.WRONG


def test_participants_are_added_by_codes_that_are_free(lab):
    lab.store.add_participant("P-1")
    with Trainer(lab) as trainer:
        for codes, problem in ((["P-2", "P-1"], "code = 'P-1' is taken"), (["Anna"], "names are not kept")):
            trainer.send(type="add_participants", codes=codes, group="Friday")
            assert problem in trainer.until("refused")["message"]
        assert "P-2" not in dict(lab.store.participants()), "all of them or none"
        trainer.send(type="add_participants", codes=["P-2", "P-3"], group="Friday")
        assert {"P-2", "P-3"} <= set(trainer.until("results")["participants"])
    assert dict(lab.store.participants())["P-3"] == "Friday"


def test_results_are_a_table_for_who_has_the_token(lab):
    lab.store.add_participant("T-1")
    assert lab.get("/attempts.csv")[0] == 403
    status, text = lab.get(f"/attempts.csv?trainer={TOKEN.replace(' ', '%20')}")
    assert status == 200 and text.startswith("attempt,participant,group")


def test_bad_messages_of_a_trainer_are_refused_in_a_line():
    for text, problem in (
        ('{"type": "lock_station", "station": "1", "what": "doors", "on": true}', "what = 'doors'"),
        ('{"type": "comment_on", "station": "1", "time_s": -1, "text": "no"}', "time_s = -1"),
        ('{"type": "begin_attempt"}', "is not known; send one of watch_station"),
        ("[]", "is no JSON object"),
    ):
        with pytest.raises(MessageError, match=problem):
            parse(KINDS, text)


def test_small_pictures_wait_for_a_page_that_does_not_read():
    """Sixty-four stations and an outbox of sixty-four: nobody is hung up on, and no station is left out for good."""
    shown = SimpleNamespace(image=SimpleNamespace(pixels=np.zeros((4, 4))))
    names = [str(number) for number in range(1, 65)]

    async def watched():
        page = TrainerConnection(SimpleNamespace(stations=stations), outbox := Outbox())
        order = dict.fromkeys(names, 0)
        for _ in range(3):
            await page._show_small(order)
        waiting = [wire.read(await outbox.get())[1]["station"]]
        assert outbox.is_empty and not page.verdict.done()

        async def read():
            while True:
                waiting.append(wire.read(await outbox.get())[1]["station"])

        reader = asyncio.create_task(read())
        await page._show_small(order)
        await asyncio.sleep(0)
        reader.cancel()
        return waiting

    stations = {name: SimpleNamespace(seen=SimpleNamespace(frame=1, shown=shown)) for name in names}
    assert asyncio.run(watched()) == names


def test_a_job_that_cannot_ever_be_done_is_said_and_holds_up_no_other():
    said, done = [], []
    keeper = Keeper()
    keeper.do(lambda: [][1], said.append)
    keeper.do(lambda: done.append(1), said.append)
    assert keeper.close(5.0) == 0 and done == [1] and "could not be kept" in said[0]


def test_the_trainer_s_schema_is_the_one_in_its_file():
    assert Path(schema.FILE).read_text() == schema.text(schema.trainer_schema()), (
        "run python -m sonospline.course.schema"
    )


@pytest.mark.slow
def test_eight_stations_at_once_lose_nothing(tmp_path):
    lab = Lab(tmp_path, stations=8)
    try:
        codes = [f"K-{number}" for number in range(1, 9)]
        for code in codes:
            lab.store.add_participant(code)
        done = {}

        def work(number):
            """A hand that pushes, in three attempts, to depths of its own."""
            with Trainee(lab, number, f"K-{number}") as trainee:
                for attempt in range(3):
                    trainee.begin(seed=10 * number + attempt)
                    trainee.push(5.0 + number, 3)
                    trainee.send(type="on_target" if attempt % 2 == 0 else "give_up")
                    trainee.until("debrief")
                    done[number] = attempt + 1

        with Trainer(lab) as trainer:
            trainer.send(type="watch_station", station="8")
            hands = [threading.Thread(target=work, args=(number,)) for number in range(1, 9)]
            for hand in hands:
                hand.start()
            trainer.until(
                "stations",
                lambda said: sum(one["participant"] is not None for one in said["stations"]) == 8,
                seconds=240,
            )
            for hand in hands:
                hand.join(240)
            assert done == dict.fromkeys(range(1, 9), 3)
        for number, code in enumerate(codes, 1):
            found = kept(lab, code)
            assert [one["ended"] for one in found] == ["on target", "given up", "on target"]
            assert [one["seed"] for one in found] == [10 * number + k for k in range(3)]
            assert [one["session"] for one in found] == ["Tuesday"] * 3
            assert len({one["recording"] for one in found}) == 3
    finally:
        lab.stop()
