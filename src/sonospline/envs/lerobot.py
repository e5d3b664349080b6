"""Episodes of the environments as a data set of LeRobot v3: what robots learn from by imitation."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require
from .lerobot_files import (
    CHUNK,
    CODEC,
    DATA_MB,
    VIDEO_MB,
    Statistics,
    Tables,
    Videos,
    as_lists,
    joined,
    picture_statistics,
    place_of,
    statistics,
    write_tasks,
)  # fmt: skip
from .scripted import Policy
from .training_env import TrainingEnv

CAMERA = "observation.images.ultrasound"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_TOGETHER = 100
"""Episodes whose rows are written at once."""
_COUNTED = ("frame_index", "episode_index", "index", "task_index")
_CARD = """---
license: {licence}
task_categories: [robotics]
tags: [LeRobot, ultrasound, needle, synthetic]
configs:
- config_name: default
  data_files: data/*/*.parquet
---
# {task}

{episodes} episodes of `{env}`, {frames} frames at {fps} a second, in the form of LeRobot v3.0. {solved} of them end
solved (`next.success`). Made by Sonospline {version}; not for clinical use.

Images are synthetic B-mode. **The video is lossy** (AV1, crf {crf}): speckle is not that of the simulator to the bit.
Numbers of `observation.state` are what a hand knows without a picture, those of `observation.environment_state` also
where the target is now; `meta/info.json` names them. An action goes with the observation of its frame, and `next.`
is what came of it.
"""


@dataclass(frozen=True, kw_only=True)
class Written:
    """What was written."""

    episodes: int
    frames: int
    solved: int
    """Episodes that end with success."""
    bytes: int
    """Of all files."""


def write_lerobot(
    env: TrainingEnv,
    policy: Policy,
    out: str | PathLike[str],
    seeds: Iterable[int],
    *,
    licence: str = "unknown",
    progress: Callable[[int, int, int], None] | None = None,
) -> Written:
    """Write episodes of a hand as a data set of LeRobot v3.0: Parquet, and AV1 video, which is lossy.

    Parameters
    ----------
    env : TrainingEnv
        One that observes pixels: ``NeedleSteering(observe="pixels")``.
    policy : callable
        Returns an action for an environment as it is: :func:`steer`, :func:`navigate`, or a learner's.
    out : path-like
        A new folder. Everything is written beside it and moved at the end.
    seeds : iterable of int
        Of the episodes, in order.
    licence : str, default: "unknown"
        Under which they are handed on, as Hugging Face writes it: ``cc-by-4.0``.
    progress : callable, optional
        Called with episodes done, all, and how many were not solved.

    Raises
    ------
    ValueError
        An environment that observes numbers alone, a folder that is there, no seeds.
    MissingExtraError
        ``pip install 'sonospline[lerobot]'``.

    Notes
    -----
    ``observation.images.ultrasound`` is padded with black to even sides, which AV1's colours need. An episode that
    fails stays in, its ``next.success`` false throughout.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sonospline.envs import NeedleSteering, steer, write_lerobot
    >>> out = Path(tempfile.mkdtemp()) / "needles"
    >>> written = write_lerobot(NeedleSteering(observe="pixels"), steer, out, seeds=range(2))  # doctest: +SKIP
    >>> written.episodes, sorted(file.name for file in (out / "meta").iterdir())  # doctest: +SKIP
    (2, ['episodes', 'info.json', 'stats.json', 'tasks.parquet'])
    """
    for module in ("av", "pyarrow"):
        require(module)
    place, chosen = Path(out), [int(seed) for seed in seeds]
    if env.observe != "pixels":
        raise ValueError(f"env = {env!r} observes no pixels; make it with observe='pixels'")
    if not chosen:
        raise ValueError("seeds is empty; give one for each episode")
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise ValueError(f"out = {str(place)!r} is there already; give a new folder")
    staging = place.with_name(f".partial-{place.name}-{secrets.token_hex(4)}")
    try:
        try:
            staging.mkdir(parents=True)
        except OSError as error:
            raise ValueError(f"out = {str(place)!r} cannot be written ({error.strerror}); give another") from None
        written = _Export(env, staging, licence).write(policy, chosen, progress or (lambda done, of, failed: None))
        staging.replace(place)
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        raise
    return written


class _Export:
    """A data set that is being written."""

    def __init__(self, env: TrainingEnv, folder: Path, licence: str) -> None:
        self._env, self._folder, self._licence = env, folder, licence
        self._fps = int(env.metadata["render_fps"])
        self._task = env.world.exercise.name
        self._data, self._about = Tables(folder / "data"), Tables(folder / "meta/episodes")
        self._videos = Videos(folder / "videos" / CAMERA, self._fps)
        self._statistics: dict[str, Statistics] = {}
        self._rows: list[dict[str, Any]] = []
        """Of the table of episodes, not yet written: it has more columns than episodes have numbers."""
        self._frames = self._solved = 0
        self._shape: tuple[int, ...] = ()

    def write(self, policy: Policy, seeds: list[int], progress: Callable[[int, int, int], None]) -> Written:
        progress(0, len(seeds), 0)
        for number, seed in enumerate(seeds):
            columns, pictures = _episode(self._env, policy, seed)
            self._add(number, columns, pictures)
            progress(number + 1, len(seeds), number + 1 - self._solved)
        self._write_rows()
        for files in (self._data, self._about, self._videos):
            files.close()
        write_tasks(self._folder / "meta/tasks.parquet", [self._task])
        self._say("meta/stats.json", json.dumps(as_lists(self._statistics), indent=4))
        self._say("meta/info.json", json.dumps(self._info(len(seeds)), indent=4))
        self._say("README.md", self._card(len(seeds)))
        size = sum(file.stat().st_size for file in self._folder.rglob("*") if file.is_file())
        return Written(episodes=len(seeds), frames=self._frames, solved=self._solved, bytes=size)

    def _add(self, number: int, columns: dict[str, NDArray[Any]], pictures: NDArray[np.uint8]) -> None:
        count, first = len(pictures), self._frames
        self._frames += count
        self._solved += bool(columns["next.success"][-1])
        self._shape = pictures.shape[1:]
        frame = np.arange(count)
        columns |= {
            "timestamp": (frame / self._fps).astype(np.float32), "frame_index": frame,
            "episode_index": np.full(count, number), "index": first + frame, "task_index": np.zeros(count, int),
        }  # fmt: skip
        found = {key: statistics(values) for key, values in columns.items()}
        found[CAMERA] = picture_statistics(pictures)
        known = self._statistics
        self._statistics = {key: joined([known[key], one]) if known else one for key, one in found.items()}
        about = {
            "episode_index": number, "tasks": [self._task], "length": count,
            **_under("data", place_of(self._data.number)), "dataset_from_index": first,
            "dataset_to_index": first + count, **_under(f"videos/{CAMERA}", self._videos.add(pictures)),
            **{f"stats/{key}/{name}": one for key, each in as_lists(found).items() for name, one in each.items()},
            **_under("meta/episodes", place_of(self._about.number)),
        }  # fmt: skip
        self._data.add(_table(columns))
        self._rows.append(about)
        if len(self._rows) == _TOGETHER:
            self._write_rows()

    def _write_rows(self) -> None:
        if self._rows:
            self._about.add(require("pyarrow").Table.from_pylist(self._rows))
        self._rows = []

    def _info(self, episodes: int) -> dict[str, Any]:
        rows, columns, _ = self._shape
        video = {
            "video.height": rows, "video.width": columns, "video.channels": 3, "video.fps": self._fps,
            "video.codec": "av1", "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "is_depth_map": False,
            "has_audio": False, "video.lossy": True, **{f"video.{name}": value for name, value in CODEC.items()},
        }  # fmt: skip
        features: dict[str, Any] = {
            CAMERA: {
                "dtype": "video", "shape": list(self._shape), "names": ["height", "width", "channels"], "info": video
            },
            "observation.state": _numbers(self._env.by_hand),
            "observation.environment_state": _numbers(self._env.numbers),
            "action": _numbers(tuple(self._env.rates)),
        }  # fmt: skip
        kinds = {"next.reward": "float32", "next.done": "bool", "next.success": "bool", "timestamp": "float32"}
        kinds |= dict.fromkeys(_COUNTED, "int64")
        features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in kinds.items()}
        return {
            "codebase_version": "v3.0", "robot_type": "sonospline", "total_episodes": episodes,
            "total_frames": self._frames, "total_tasks": 1, "chunks_size": CHUNK, "data_files_size_in_mb": DATA_MB,
            "video_files_size_in_mb": VIDEO_MB, "fps": self._fps, "splits": {"train": f"0:{episodes}"},
            "data_path": f"data/{_FILE}.parquet", "video_path": f"videos/{{video_key}}/{_FILE}.mp4",
            "features": features,
        }  # fmt: skip

    def _card(self, episodes: int) -> str:
        return _CARD.format(
            licence=self._licence, task=self._task, episodes=episodes, env=type(self._env).__name__,
            frames=self._frames, fps=self._fps, solved=self._solved, crf=CODEC["crf"], version=version("sonospline"),
        )  # fmt: skip

    def _say(self, name: str, text: str) -> None:
        (self._folder / name).write_text(text, encoding="utf-8")


def _episode(env: TrainingEnv, policy: Policy, seed: int) -> tuple[dict[str, NDArray[Any]], NDArray[np.uint8]]:
    """Play one: its columns, and its pictures (n, rows, columns, 3)."""
    observation, _ = env.reset(seed=seed)
    held: dict[str, list[Any]] = {}
    pictures, over = [], False
    while not over:
        action = np.asarray(policy(env), np.float32)
        row = {"observation.state": observation["hand"], "observation.environment_state": env.state, "action": action}
        pictures.append(_even(observation["image"]))
        observation, reward, ended, late, info = env.step(action)
        over = ended or late
        row |= {"next.reward": np.float32(reward), "next.done": over, "next.success": info.get("is_success", False)}
        for name, value in row.items():
            held.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in held.items()}, np.stack(pictures)


def _even(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A grey picture (rows, columns, 1) in colours, with black beside it to even sides."""
    rows, columns = picture.shape[:2]
    return np.repeat(np.pad(picture, ((0, rows % 2), (0, columns % 2), (0, 0))), 3, axis=2)


def _numbers(names: tuple[str, ...]) -> dict[str, Any]:
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def _under(name: str, held: dict[str, Any]) -> dict[str, Any]:
    return {f"{name}/{key}": value for key, value in held.items()}


def _table(columns: dict[str, NDArray[Any]]) -> Any:
    arrow = require("pyarrow")
    held = {
        name: arrow.array(values) if values.ndim == 1
        else arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), values.shape[1])
        for name, values in columns.items()
    }  # fmt: skip
    return arrow.table(held)
