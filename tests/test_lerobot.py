"""Episodes as a data set of LeRobot v3, read with pandas and FFmpeg, which know nothing of who wrote them."""

import json
import os

import numpy as np
import pytest

from sonospline import cli
from sonospline.envs import NeedleSteering, at_random, lerobot_files, write_lerobot

pytest.importorskip("gymnasium", reason="needs the extra 'envs'")
pandas = pytest.importorskip("pandas", reason="reads LeRobot's tables")
av = pytest.importorskip("av", reason="needs the extra 'lerobot'")

CAMERA = "observation.images.ultrasound"
SEEDS = (4, 9)
NODES = 1000


@pytest.fixture(scope="module")
def env():
    return NeedleSteering(observe="pixels", nodes=NODES, limit_s=0.4)


@pytest.fixture(scope="module")
def written(env, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lerobot") / "needles"
    seen = []
    found = write_lerobot(env, at_random, folder, SEEDS, licence="cc-by-4.0", progress=lambda *at: seen.append(at))
    assert seen == [(0, 2, 0), (1, 2, 1), (2, 2, 2)]
    assert (found.episodes, found.frames, found.solved) == (2, 8, 0)
    assert found.bytes == sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return folder


def info_of(folder):
    return json.loads((folder / "meta/info.json").read_text())


def episodes_of(folder):
    return pandas.concat([pandas.read_parquet(file) for file in sorted(folder.glob("meta/episodes/*/*.parquet"))])


def frames_of(file):
    with av.open(str(file)) as held:
        return [(float(frame.time), frame.to_ndarray(format="rgb24")) for frame in held.decode(video=0)]


@pytest.fixture(scope="module")
def played(env):
    """What the episodes' steps observe, do and get."""
    found = []
    for number, seed in enumerate(SEEDS):
        observation, _ = env.reset(seed=seed)
        over = False
        while not over:
            hand, image, state, action = observation["hand"], observation["image"], env.state, at_random(env)
            observation, reward, ended, late, _ = env.step(action)
            over = ended or late
            found.append((number, hand, image, state, action, reward, over))
    return found


def test_tables_hold_what_was_observed_done_and_got(env, written, played):
    info = info_of(written)
    data = pandas.read_parquet(written / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.columns) == set(info["features"]) - {CAMERA}
    assert len(played) == len(data) == info["total_frames"]
    for index, ((number, hand, _, state, action, reward, over), row) in enumerate(
        zip(played, data.to_dict("records"), strict=True)
    ):
        assert np.array_equal(row["observation.state"], hand)
        assert np.array_equal(row["observation.environment_state"], state)
        assert np.array_equal(row["action"], action)
        assert (row["next.reward"], row["next.done"], row["next.success"]) == (np.float32(reward), over, False)
        assert (row["index"], row["episode_index"], row["frame_index"]) == (index, number, index % 4)
        assert row["timestamp"] == pytest.approx(0.1 * (index % 4))
    assert info["features"]["action"] == {"dtype": "float32", "shape": [3], "names": ["push", "angle", "swing"]}
    assert info["features"]["observation.state"]["names"] == list(env.by_hand)


def test_the_video_shows_what_was_observed_and_says_that_it_is_lossy(written, played):
    info = info_of(written)
    about = info["features"][CAMERA]
    frames = frames_of(written / info["video_path"].format(video_key=CAMERA, chunk_index=0, file_index=0))
    images = [image for _, _, image, *_ in played]
    assert [time for time, _ in frames] == pytest.approx([0.1 * n for n in range(8)])
    rows, columns = images[0].shape[:2]
    for (_, frame), image in zip(frames, images, strict=True):
        assert frame.shape == tuple(about["shape"]) == (rows + rows % 2, columns + columns % 2, 3)
        assert np.abs(frame[:rows, :columns].astype(float) - image).mean() < 5
    assert (about["info"]["video.codec"], about["info"]["video.lossy"]) == ("av1", True)
    assert "**The video is lossy**" in (written / "README.md").read_text()


def test_a_thread_that_writes_videos_is_scheduled_as_before(tmp_path):
    """As root the encoder takes the highest priority in real time: browsers started afterwards starved a machine.

    Here it takes what any user may take and give back, so that the test shows it whoever runs it.
    """

    class Greedy:
        def __init__(self, stream, *, fails=False):
            self.stream, self.fails, self.taken = stream, fails, 0

        def encode(self, frame=None):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
            assert os.sched_getscheduler(0) == os.SCHED_BATCH
            self.taken += 1
            if self.fails:
                raise OSError("disk full")
            return self.stream.encode(frame)

    def scheduled():
        return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

    pictures, videos, before = np.zeros((3, 64, 64, 3), np.uint8), lerobot_files.Videos(tmp_path, 10), scheduled()
    videos.add(pictures)
    assert scheduled() == before == (os.SCHED_OTHER, 0)
    stream, videos._stream = videos._stream, Greedy(videos._stream)
    videos.add(pictures)
    assert (scheduled(), videos._stream.taken) == (before, 3)
    videos._stream = Greedy(stream, fails=True)
    with pytest.raises(OSError, match="disk full"):
        videos.add(pictures)
    assert scheduled() == before
    videos._stream = Greedy(stream)
    videos.close()
    assert (scheduled(), videos._stream.taken) == (before, 1)


def test_episodes_and_tasks_say_where_everything_is(written):
    episodes = episodes_of(written)
    assert episodes["length"].tolist() == [4, 4]
    assert episodes["dataset_from_index"].tolist() == [0, 4] and episodes["dataset_to_index"].tolist() == [4, 8]
    assert episodes[f"videos/{CAMERA}/from_timestamp"].tolist() == pytest.approx([0, 0.4])
    assert episodes[f"videos/{CAMERA}/to_timestamp"].tolist() == pytest.approx([0.4, 0.8])
    tasks = pandas.read_parquet(written / "meta/tasks.parquet")
    assert tasks.index.tolist() == [episodes["tasks"][0][0]] and tasks["task_index"].tolist() == [0]


def test_statistics_are_those_of_all_frames(written, played):
    found = json.loads((written / "meta/stats.json").read_text())
    states = np.stack([state for _, _, _, state, *_ in played]).astype(float)
    images = np.stack([image for _, _, image, *_ in played]) / 255
    of_states, of_images = found["observation.environment_state"], found[CAMERA]
    for name in ("min", "max", "mean", "std"):
        assert np.allclose(of_states[name], getattr(states, name)(axis=0), atol=1e-6)
    assert of_states["count"] == of_images["count"] == [8]
    assert np.shape(of_images["mean"]) == (3, 1, 1)
    padded = images.size / images.shape[2] * (images.shape[2] + images.shape[2] % 2)
    assert np.allclose(of_images["mean"], images.sum() / padded)
    assert episodes_of(written)["stats/action/q50"].iloc[1].shape == (3,)


def test_large_sets_have_several_files(env, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot_files, "DATA_MB", -1)
    monkeypatch.setattr(lerobot_files, "VIDEO_MB", -1)
    monkeypatch.setattr("sonospline.envs.lerobot._TOGETHER", 1)
    write_lerobot(env, at_random, tmp_path / "out", SEEDS)
    info, episodes = info_of(tmp_path / "out"), episodes_of(tmp_path / "out")
    for number, row in enumerate(episodes.to_dict("records")):
        where = {name: row[f"data/{name}"] for name in ("chunk_index", "file_index")}
        data = pandas.read_parquet(tmp_path / "out" / info["data_path"].format(**where))
        assert set(data["episode_index"]) == {number} == {row["meta/episodes/file_index"]}
        where = {name: row[f"videos/{CAMERA}/{name}"] for name in ("chunk_index", "file_index")}
        frames = frames_of(tmp_path / "out" / info["video_path"].format(video_key=CAMERA, **where))
        assert len(frames) == 4 and row[f"videos/{CAMERA}/from_timestamp"] == 0


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"env": "numbers"}, "observes no pixels; make it with observe='pixels'"),
        ({"seeds": ()}, "seeds is empty; give one for each episode"),
        ({"out": "."}, "is there already; give a new folder"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(asked, said, env, tmp_path):
    (tmp_path / "kept.txt").write_text("kept")
    given = NeedleSteering(nodes=NODES) if "env" in asked else env
    with pytest.raises(ValueError, match=said) as refused:
        write_lerobot(given, at_random, tmp_path / asked.get("out", "out"), asked.get("seeds", SEEDS))
    assert "\n" not in str(refused.value)
    assert [file.name for file in tmp_path.iterdir()] == ["kept.txt"]


def test_a_hand_that_fails_leaves_nothing(env, tmp_path):
    with pytest.raises(ZeroDivisionError):
        write_lerobot(env, lambda env: 1 / 0, tmp_path / "out", SEEDS)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_verb_writes_episodes_of_the_scripted_hand(tmp_path, capsys):
    arguments = ["dataset", "episodes", "probe-navigation", "--out", str(tmp_path / "out"), "--episodes", "1"]
    assert cli.main(arguments) == 0
    assert "1 in" in (said := capsys.readouterr().out) and "1 of them solved" in said
    assert episodes_of(tmp_path / "out")["stats/next.success/max"].iloc[0].tolist() == [1]
    assert cli.main(arguments) == 2
    assert "is there already; give a new folder" in capsys.readouterr().err
    assert cli.main([*arguments[:-1], "0"]) == 2
    assert "episodes = 0" in capsys.readouterr().err
