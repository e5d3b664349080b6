"""Recording without a page: tables of poses, scripted hands, and what is refused."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonospline as ss
from sonospline import cli
from sonospline.io.pose_table import COLUMNS, PoseRow, read_poses, write_poses
from sonospline.lab import ResultStore
from sonospline.training import Recording
from sonospline.training.recording import pose_of

places = st.tuples(*[st.floats(-1e3, 1e3)] * 3)
needles = st.none() | st.tuples(places, places).filter(lambda ends: np.linalg.norm(np.subtract(*ends)) > 0.1)


@given(ends=st.lists(needles, min_size=1, max_size=5), turn=st.lists(st.floats(-9, 9), min_size=12, max_size=12))
def test_a_table_of_poses_comes_back_to_the_bit(tmp_path_factory, ends, turn):
    path = tmp_path_factory.getbasetemp() / "poses.csv"
    pose = np.array([*turn, 0, 0, 0, 1]).reshape(4, 4)
    rows = [PoseRow(k / 3, end and ss.Needle(*end), pose if k % 2 else None) for k, end in enumerate(ends)]
    write_poses(rows, path)
    for row, read in zip(rows, read_poses(path), strict=True):
        assert row.time_s == read.time_s and row.needle == read.needle
        assert (row.probe_to_reference is None) == (read.probe_to_reference is None)
        assert row.probe_to_reference is None or np.array_equal(row.probe_to_reference, read.probe_to_reference)


def table(path, *lines):
    path.write_text(
        "\n".join([",".join(COLUMNS), *(line + "," * (len(COLUMNS) - 1 - line.count(",")) for line in lines)])
    )
    return path


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([], "has no row"),
        (["now"], r"line 2: time_s = 'now' is no number"),
        (["-1"], r"line 2: time_s = '-1' is no time"),
        ([",1,2,3,4,5,6"], r"line 2: time_s = '' is no time"),
        (["1", "0.5"], "0.5 comes after 1; give rising times"),
        (["0,1,2,3"], r"line 2: tip_x = '' is no number; give one, or leave entry_x to tip_z empty"),
        (["0,1,2,3,4,5,nan"], "are not finite"),
        (["0,1,2,3,1,2,3"], r"line 2: .*tip"),
    ],
)
def test_a_table_that_says_nothing_is_refused_with_its_line(tmp_path, lines, says):
    with pytest.raises(ValueError, match=says):
        read_poses(table(tmp_path / "poses.csv", *lines))


def test_a_recording_from_its_own_poses_has_the_same_pictures(tmp_path, capsys):
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    poses = table(
        tmp_path / "hand.csv", "0", "0.25,26,30,0,30,30,10", "0.5,26,30,0,30,30,20", "0.75", "1,26,30,0,30,30,8"
    )
    words = ["record", "--scene", "gel", "--model", "kelvinlet", "--quiet"]
    assert cli.main([*words, "--poses", str(poses), "--out", str(first)]) == 0
    assert "5 steps, 1.0 s of Gel block" in capsys.readouterr().out
    recording = Recording.read(first)
    write_poses(
        (PoseRow(step.time_s, needle.needle if (needle := (step.needles or {}).get("needle")) else None, pose_of(step))
         for step in recording.steps), poses,
    )  # fmt: skip
    assert cli.main([*words, "--poses", str(poses), "--out", str(second)]) == 0
    assert [step.image for step in Recording.read(second).steps] == [step.image for step in recording.steps]


def test_a_hand_does_an_exercise_and_the_lab_keeps_it(tmp_path, capsys):
    out, database = tmp_path / "novice.mcap", tmp_path / "course.db"
    words = ["record", "--exercise", "vessel-in-plane", "--hand", "novice", "--seed", "4", "--out", str(out)]
    assert cli.main([*words, "--database", str(database), "--participant", "S-1", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["passed"] is False and report["verdict"].startswith("not yet")
    with ResultStore(database) as store:
        (kept,) = store.attempts()
    recording = Recording.read(out)
    assert kept["recording_hash"] == recording.content_hash and kept["seed"] == 4
    assert len(recording.steps) == report["steps"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give --poses CSV, or --exercise NAME"),
        (["--exercise", "vessel-in-plane", "--poses", "p.csv"], "one source is needed"),
        (["--poses", "p.csv", "--hand", "expert"], "--hand belongs to --exercise"),
        (["--exercise", "vessel-in-plane", "--scene", "gel"], "--scene belongs to --poses"),
        (["--exercise", "vessel-in-plane", "--database", "c.db"], "--database and --participant belong together"),
        (["--exercise", "vessel-in-plane", "--seed", "-1"], "seed"),
        (["--poses", "none.csv"], "none.csv"),
    ],
)
def test_what_does_not_fit_is_refused_before_any_work(tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["record", "--out", "new.mcap", *words]) == 2
    assert says in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_pose_outside_the_tissue_leaves_no_file_without_a_step(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table(tmp_path / "far.csv", "0,1,2,900,30,30,10")
    assert (
        cli.main(["record", "--scene", "gel", "--model", "kelvinlet", "--poses", "far.csv", "--out", "new.mcap"]) == 2
    )
    assert "pose 1 of far.csv, at 0 s" in capsys.readouterr().err
    assert not (tmp_path / "new.mcap").exists()
    (tmp_path / "old.mcap").write_bytes(b"kept")
    assert cli.main(["record", "--poses", "far.csv", "--out", "old.mcap"]) == 2
    assert (tmp_path / "old.mcap").read_bytes() == b"kept"
