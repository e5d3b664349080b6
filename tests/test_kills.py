"""Verbs that are ended at any moment: the earlier set or the new one is there, and the next run puts all in order."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

SEEDS = {"earlier": "1", "new": "2"}
VERBS = {
    "insert": (["insert", "--quiet", "--nodes", "1000", "--steps", "1"], 3),
    "image": (["image", "--quiet", "--nodes", "1000", "--voxel", "4", "--depth", "40"], 2),
}
"""What is run, and how many seconds at most a moment lies after its work began."""


def run(verb, out, seed, cache, **options):
    command = [sys.executable, "-m", "sonospline", *VERBS[verb][0], "--seed", SEEDS[seed], "--out", str(out)]
    environment = {**os.environ, "SONOSPLINE_CACHE": str(cache)}
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, **options
    )


def finish(process):
    said = process.communicate(timeout=300)
    assert process.returncode == 0, said


def seed_of(out):
    """Which set the final names hold: read through, whole, and all of one run."""
    files = {file.name: file for file in out.iterdir() if not file.name.startswith(".")}
    summary = json.loads(files["summary.json"].read_text())
    assert sorted(files) == summary["files"]
    times = [file.stat().st_mtime for file in files.values()]
    assert max(times) - min(times) < 60
    return next(name for name, seed in SEEDS.items() if int(seed) == summary["seed"])


def end_at_a_moment(verb, out, number, delay, cache):
    """Start a second run over an earlier set, end it, look, and run once more; return which set was left."""
    finish(run(verb, out, "earlier", cache))
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    process = run(verb, out, "new", cache)
    end = time.monotonic() + 120
    while process.poll() is None and not any(out.glob(".partial-*")) and time.monotonic() < end:
        time.sleep(0.001)
    time.sleep(delay)  # the moment: any
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode in (0, -number, 128 + number)
    left = seed_of(out)
    if left == "earlier":
        assert {name: (out / name).read_bytes() for name in before} == before
    if number == signal.SIGTERM:
        assert not list(out.glob(".partial-*"))
    finish(run(verb, out, "new", cache))
    assert seed_of(out) == "new"
    assert not list(out.glob(".*")) and not any(file.is_symlink() for file in out.iterdir())
    return left


def moments(tries):
    random = np.random.default_rng(tries)
    return [
        (("insert", "image")[k % 2], (signal.SIGKILL, signal.SIGTERM)[k // 2 % 2], float(random.random()))
        for k in range(tries)
    ]


@pytest.mark.parametrize(("verb", "number", "moment"), moments(1))
def test_a_run_that_is_killed_leaves_one_set_and_the_next_one_no_debris(verb, number, moment, tmp_path):
    end_at_a_moment(verb, tmp_path / "out", number, moment * VERBS[verb][1], tmp_path / "cache")


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "number", "moment"), moments(16))
def test_many_kills_leave_one_set_and_no_debris(verb, number, moment, tmp_path):
    end_at_a_moment(verb, tmp_path / "out", number, moment * VERBS[verb][1], tmp_path / "cache")
