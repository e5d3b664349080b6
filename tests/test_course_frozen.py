"""A trainer freezes a station, and sees the 3-D view of the one that is watched."""

import pytest

pytest.importorskip("sqlalchemy")
pytest.importorskip("websockets")

from lab_course import Lab, Trainee, Trainer
from sonospline.server import wire


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    lab = Lab(tmp_path_factory.mktemp("lab"))
    lab.store.add_participant("K-1")
    yield lab
    lab.stop()


def frozen(header):
    return header["state"]["frozen"]


@pytest.mark.slow
def test_a_frozen_station_stands_still_and_nothing_counts_until_it_goes_on(lab):
    with Trainer(lab) as trainer, Trainee(lab, 1, "K-1") as trainee:
        trainee.begin(seed=3)
        trainee.push(10.0)
        attempt = lab.course.stations["1"].attempt
        trainer.send(type="lock_station", station="1", what="hands", on=True)
        assert trainee.until("station", lambda said: said["hands_locked"])
        assert trainer.station("1", lambda one: one["hands_locked"])["word"] == "frozen"
        still = trainee.until(wire.FRAME, frozen)
        steps, time_s = len(attempt.commands), attempt.last.time_s
        seq = trainee.ask(depth=20.0)
        again = trainee.until(wire.FRAME, lambda header: header["seq"] >= seq)
        assert frozen(again) and again["noise"] == still["noise"]
        assert again["state"]["needle"]["depth"] == still["state"]["needle"]["depth"]
        for message in ("on_target", "give_up", "reset"):
            trainee.send(type=message)
            assert "the trainer has frozen this station" in trainee.until("refused")["message"]
        assert (len(attempt.commands), attempt.last.time_s, attempt.over) == (steps, time_s, False)
        trainer.send(type="lock_station", station="1", what="hands", on=False)
        trainee.until(wire.FRAME, lambda header: not frozen(header))
        trainee.push(20.0, 1)
        assert len(attempt.commands) > steps
        trainee.send(type="on_target")
        assert trainee.until("debrief")


@pytest.mark.slow
def test_whoever_watches_is_sent_surfaces_and_how_they_move_only_where_asked(lab):
    with Trainer(lab) as trainer, Trainee(lab, 2) as trainee:
        trainee.state = trainee.until("scene")["state"]
        trainer.send(type="watch_station", station="2")
        trainer.until("scene")
        trainee.push(12.0)
        assert trainer.until(wire.FRAME, lambda header: header["state"]["needle"]["depth"] > 11)["mesh"] == 0
        trainer.send(type="watch_station", station="2", meshes=True)
        assert trainer.until("scene")["guides"] != []
        surfaces = trainer.until(wire.GEOMETRY)["meshes"]
        moved = trainer.until(wire.FRAME, lambda header: header["mesh"] > 0)
        assert moved["mesh"] == sum(one["vertices"] for one in surfaces if one["name"] != "grid")
