"""Every number on the command line: in its range, or one line and exit code 2 before any work; and how a run ends."""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from importlib import import_module

import pytest

from sonospline import _memory, cli
from sonospline.server import server

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
pytest.importorskip("pymoo", reason="needs the extra 'tune'")

WILD = ["-1", "0", "1e308", "-1e308", "nan", "inf", "1" + "0" * 30, "9" * 5000, "99999999999999", "1e-300", "", "abc"]
SMALL = {
    "insert": ["--nodes", "1000", "--steps", "1"],
    "image": ["--nodes", "1000", "--voxel", "4"],
    "tune": ["--side", "9", "--steps", "1"],
    "reproduce": ["--quick"],
    "bench": ["--quick"],
    "serve": [],
}
MORE = {"insert": ["anchors", "set=shaft_radius", "entry", "target"], "image": ["origin", "look"]}
"""Numbers that argparse takes as text."""
NEEDS = {
    "drag-mm": ["--model", "kelvinlet"],
    "poisson": ["--model", "kelvinlet"],
    "stiffness": ["--model", "elastic"],
    "solver-nodes": ["--model", "elastic"],
    "seconds": ["--live"],
}
FROM_ZERO = {"smoothing", "drag-mm", "build-up-mm", "poisson", "shaft-displacement", "shaft-pull", "tip-displacement"}
ALLOWED = {
    **{option: {"0"} for option in ("seed", "port", "link", "cine", *FROM_ZERO)},
    "gain": {"-1", "0", "1e-300"},
}
TINY = {"gain", *FROM_ZERO}
"""Options for which 1e-300 is as good as zero, and above it."""


def numbers_of(verb):
    """Every option of a verb that takes a number."""
    parser = argparse.ArgumentParser()
    import_module(f"sonospline.commands.{verb}").add_arguments(parser)
    found = [action.option_strings[0][2:] for action in parser._actions if action.type in (int, float)]
    return [*found, *MORE.get(verb, [])]


OPTIONS = [(verb, option) for verb in SMALL for option in numbers_of(verb)]


@pytest.fixture(autouse=True)
def an_environment_of_its_own(monkeypatch):
    """``serve`` asks for one thread of BLAS; processes of later tests must not inherit that."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")


class WorkError(BaseException):
    """The checks are over, and work would begin."""


@pytest.fixture
def no_work(monkeypatch):
    """Have every verb stop where its work begins."""

    @contextmanager
    def begin(*args, **options):
        raise WorkError
        yield

    def serve(self, ready):
        self.socket.close()
        raise WorkError

    for verb in SMALL:
        module = import_module(f"sonospline.commands.{verb}")
        if hasattr(module, "staged_folder"):
            monkeypatch.setattr(module, "staged_folder", begin)
        if hasattr(module, "_notebook"):
            monkeypatch.setattr(module, "_notebook", begin)
    monkeypatch.setattr(server.Server, "run", serve)
    monkeypatch.setattr(_memory, "available_bytes", lambda: 8_000_000_000)
    threads = os.sched_getaffinity(0)
    yield
    os.sched_setaffinity(0, threads)


def accepted(verb, arguments, out):
    """Whether a verb would begin its work; where not, it must have said why in one line."""
    options = [] if verb == "serve" else ["--out", str(out)]
    try:
        code = cli.main([verb, *SMALL[verb], *arguments, *options])
    except WorkError:
        return True
    except SystemExit as end:
        code = end.code
    assert code == 2
    return False


@pytest.mark.parametrize(("verb", "option"), OPTIONS)
def test_a_wild_number_is_refused_in_one_line_before_any_work(verb, option, no_work, tmp_path, capsys):
    for value in WILD:
        taken = accepted(verb, [*NEEDS.get(option, []), f"--{option}={value}"], tmp_path / "out")
        printed = capsys.readouterr()
        allowed = ALLOWED.get(option, set()) | ({"1e-300"} if option in TINY else set())
        assert taken == (value in allowed), (value, printed.err[:200])
        assert printed.err.count("\n") == (not taken), value
        assert printed.out == ""
        assert len(printed.err) < 6000
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (["insert", "--nodes", "99999999999"], "--nodes = 99999999999 is too large; give at most 10000000000"),
        (["insert", "--nodes", "9999999999"], "would take about 4,000 GB, and 6.4 can be had; give at most 16000000"),
        (["tune", "--side", "500"], "would take about 1,250 GB, and 6.4 can be had; give at most 86"),
        (["image", "--cine", "9999"], "--cine = 9999 would take about 20 GB"),
    ],
)
def test_what_would_not_fit_in_memory_is_refused_with_what_would(arguments, remedy, no_work, tmp_path, capsys):
    assert cli.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    assert remedy in capsys.readouterr().err


def test_negative_numbers_are_values_and_not_options(no_work, tmp_path):
    assert accepted("image", ["--gain", "-1e1"], tmp_path)
    assert accepted("image", ["--gain", "-.5"], tmp_path)


def piped(*arguments):
    """Run the command line into a reader that leaves at once; return its exit code and what it says."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "sonospline", *arguments]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments", [["doctor"], ["doctor", "--json"], ["--help"], ["insert", "--help"], ["--version"]]
)
def test_a_reader_that_leaves_early_is_no_failure(arguments):
    assert piped(*arguments) == (0, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
@pytest.mark.parametrize("arguments", [["doctor", "--json"], ["--help"]])
def test_an_answer_that_cannot_be_written_is_one(arguments):
    command = [sys.executable, "-m", "sonospline", *arguments]
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "No space left on device" in done.stderr


def test_closed_streams_are_no_failure(tmp_path):
    small = "insert --quiet --nodes 1000 --steps 1 --out"
    command = f"exec {sys.executable} -m sonospline {small} {tmp_path / 'out'} >&- 2>&-"
    assert subprocess.run(["bash", "-c", command], capture_output=True, check=False).returncode == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["verb"] == "insert"


def test_a_fault_of_ours_is_one_line_that_says_how_to_see_more(monkeypatch, capsys):
    from sonospline.commands import doctor

    def broken(args):
        raise KeyError("self_check")

    monkeypatch.setattr(doctor, "run", broken)
    assert cli.main(["doctor"]) == 1
    assert "please report it with what --traceback shows (KeyError: 'self_check')" in capsys.readouterr().err
    with pytest.raises(KeyError):
        cli.main(["doctor", "--traceback"])


LONG = {
    "insert": ["insert", "--quiet", "--nodes", "20000", "--steps", "50000"],
    "image": ["image", "--quiet", "--voxel", "2", "--nodes", "20000", "--cine", "3000"],
    "tune": ["tune", "--quiet", "--side", "11", "--generations", "5000", "--workers", "2"],
    "reproduce": ["reproduce", "--quick", "--quiet"],
    "bench": ["bench", "--quick", "--quiet", "--rounds", "1000"],
}


def end_while_working(verb, number, tmp_path):
    """Send a signal to a verb at work; return its exit code, what it said, and what it left."""
    out = tmp_path / "results" / "out"
    command = [sys.executable, "-m", "sonospline", *LONG[verb], "--out", str(out)]
    environment = {**os.environ, "SONOSPLINE_CACHE": str(tmp_path / "cache")}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as run:
        watch(lambda: any(out.glob(".partial-*")), run)
        run.send_signal(number)
        printed = run.communicate(timeout=120)
    left = [file.name for file in out.iterdir()] if out.exists() else []
    return run.returncode, printed, left


def watch(condition, run, seconds=120):
    """Wait for a condition while a process runs."""
    end = time.monotonic() + seconds
    while not condition():
        assert run.poll() is None, run.stderr.read()
        assert time.monotonic() < end, "it did not begin its work"
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("verb", "number", "code"),
    [
        ("insert", signal.SIGINT, 130),
        ("image", signal.SIGTERM, 143),
        *(
            pytest.param(verb, number, code, marks=pytest.mark.slow)
            for verb in LONG
            for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143))
        ),
    ],
)
def test_a_verb_that_is_ended_at_work_leaves_nothing(verb, number, code, tmp_path):
    ended, printed, left = end_while_working(verb, number, tmp_path)
    assert ended == code, printed
    assert printed == ("", "")
    assert left == (["parts"] if verb == "reproduce" else [])  # what it has learnt is kept on purpose
    assert verb == "reproduce" or not (tmp_path / "results").exists()
