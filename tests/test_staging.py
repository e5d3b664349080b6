"""Output folders: whole or as they were, whatever ends a run, and nobody else's files touched."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from sonospline.io import staging
from sonospline.io.staging import staged_folder

OLD = {name: f"old {name}" for name in ("a.txt", "b.txt", "gone.txt")}
NEW = {name: f"new {name}" for name in ("a.txt", "b.txt", "c.txt")}
THEIRS = "theirs.txt"


def summary_of(files, verb="insert"):
    return json.dumps({"verb": verb, "files": sorted([*files, "summary.json"])})


def write_set(folder, files):
    for name, text in files.items():
        (folder / name).write_text(text)
    (folder / "summary.json").write_text(summary_of(files))


def read_set(out):
    """What the final names hold, links followed; someone else's file left out."""
    return {
        file.name: file.read_text()
        for file in out.iterdir()
        if not file.name.startswith(".") and file.name != THEIRS and file.exists()
    }


def whole(files):
    return {**files, "summary.json": summary_of(files)}


def leftovers(out):
    return [file.name for file in out.rglob("*") if file.name.startswith(".partial-") or file.is_symlink()]


@pytest.fixture
def out(tmp_path):
    """A folder that holds an earlier set, and a file of someone else."""
    folder = tmp_path / "out"
    with staged_folder(folder) as staged:
        write_set(staged, OLD)
    (folder / THEIRS).write_text("mine")
    return folder


def test_a_staged_folder_appears_whole_or_not_at_all(tmp_path):
    out = tmp_path / "a" / "b"
    with pytest.raises(ZeroDivisionError), staged_folder(out) as folder:
        (folder / "half").write_text("half")
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with staged_folder(out) as folder:
        (folder / "whole").write_text("whole")
        assert not (out / "whole").exists()
    assert [path.name for path in out.iterdir()] == ["whole"]
    assert not (out / "whole").is_symlink()


def test_a_failed_run_keeps_what_an_earlier_one_left(out):
    with pytest.raises(ZeroDivisionError), staged_folder(out) as folder:
        (folder / "a.txt").write_text("later")
        raise ZeroDivisionError
    assert read_set(out) == whole(OLD)
    assert leftovers(out) == []


def test_a_failed_run_spares_what_others_put_beside_it(tmp_path):
    """The parent was made by the run that fails: what came into it meanwhile is not its own."""
    root = tmp_path / "results"
    with pytest.raises(ZeroDivisionError), staged_folder(root / "a" / "deep"):
        with staged_folder(root / "b") as other:
            (other / "whole").write_text("whole")
        (root / "notes.txt").write_text("mine")
        raise ZeroDivisionError
    assert sorted(str(file.relative_to(root)) for file in root.rglob("*")) == ["b", "b/whole", "notes.txt"]


def test_a_new_set_replaces_the_earlier_one_of_its_verb_and_nothing_else(out):
    with staged_folder(out) as folder:
        write_set(folder, NEW)
    assert read_set(out) == whole(NEW)  # gone.txt, which only the earlier set has, left with it
    assert (out / THEIRS).read_text() == "mine"
    with staged_folder(out) as folder:
        (folder / "summary.json").write_text(summary_of([], verb="image"))
    assert set(read_set(out)) == {*NEW, "summary.json"}  # the results of another verb stay


def test_a_summary_cannot_name_files_elsewhere(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "precious").write_text("mine")
    (out / "folder").mkdir()
    (out / "summary.json").write_text(json.dumps({"verb": "insert", "files": ["../precious", "folder", "", ".", 3]}))
    with staged_folder(out) as folder:
        write_set(folder, NEW)
    assert (tmp_path / "precious").exists() and (out / "folder").is_dir()


def test_a_folder_in_the_way_is_refused_and_stays(out):
    (out / "c.txt").mkdir()
    with pytest.raises(IsADirectoryError, match=r"c\.txt.*move it away"), staged_folder(out) as folder:
        write_set(folder, NEW)
    assert (out / "a.txt").read_text() == OLD["a.txt"]
    assert leftovers(out) == []


ENDING = """
import os, pathlib, shutil, signal, sys
sys.path.insert(0, sys.argv[1])
from test_staging import NEW, write_set
from sonospline.io import staging
out, step, number = pathlib.Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
steps = 0
def counted(call):
    def checked(*args, **kwargs):
        global steps
        steps += 1
        if steps == step:
            os.kill(os.getpid(), number)
        return call(*args, **kwargs)
    return checked
with staging.staged_folder(out) as folder:
    write_set(folder, NEW)
    for name in ("replace", "unlink", "symlink_to"):
        setattr(pathlib.Path, name, counted(getattr(pathlib.Path, name)))
    os.link, shutil.rmtree = counted(os.link), counted(shutil.rmtree)
print(steps)
"""


def run_until(out, step, number):
    command = [sys.executable, "-c", ENDING, str(Path(__file__).parent), str(out), str(step), str(int(number))]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def kill_at(out, step):
    done = run_until(out, step, signal.SIGKILL)
    assert done.returncode == -signal.SIGKILL, done.stderr
    found = read_set(out)
    assert found in (whole(OLD), whole(NEW)), f"killed before step {step}: a mixture"
    with staged_folder(out) as folder:  # the next run puts it in order before anything else
        assert read_set(out) == found
        assert not any(file.is_symlink() for file in out.iterdir())
        (folder / "later.txt").write_text("later")
    assert leftovers(out) == [] and (out / THEIRS).read_text() == "mine"
    return found


@pytest.mark.slow
def test_a_kill_while_files_are_published_leaves_one_set_or_the_other(out):
    """Killed right before the link turns, then right after."""
    steps = int(run_until(shutil.copytree(out, out.parent / "counted"), 0, 0).stdout)
    found = []
    for step in (steps // 3, steps - 1):
        folder = shutil.copytree(out, out.parent / f"step{step}")
        found.append(kill_at(folder, step))
    assert found == [whole(OLD), whole(NEW)]


@pytest.mark.slow
def test_a_kill_at_every_step_of_publication_leaves_one_set_or_the_other(out):
    steps = int(run_until(shutil.copytree(out, out.parent / "counted"), 0, 0).stdout)
    assert steps > 15
    found = [kill_at(shutil.copytree(out, out.parent / f"step{step}"), step) for step in range(1, steps + 1)]
    turned = found.index(whole(NEW))
    assert found == [whole(OLD)] * turned + [whole(NEW)] * (steps - turned)  # one moment decides


class Failing:
    """Fails at one of the steps that publish; counts them."""

    def __init__(self, patch, failure=None, step=0):
        self.failure, self.step, self.steps = failure, step, 0
        for owner, name in ((Path, "replace"), (Path, "unlink"), (Path, "symlink_to"), (os, "link")):
            patch.setattr(owner, name, self._watched(getattr(owner, name)))

    def _watched(self, call):
        def watched(*args, **kwargs):
            self.steps += 1
            if self.steps == self.step:
                raise self.failure
            return call(*args, **kwargs)

        return watched


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), SystemExit(143), OSError(errno.EIO, "Input/output error")])
def test_an_interrupt_or_an_error_at_any_step_leaves_one_set_and_no_debris(out, failure, monkeypatch):
    with monkeypatch.context() as patch, staged_folder(shutil.copytree(out, out.parent / "counted")) as folder:
        write_set(folder, NEW)
        counted = Failing(patch)
    assert counted.steps > 15
    for step in range(1, counted.steps + 1):
        folder = shutil.copytree(out, out.parent / f"step{step}")
        with monkeypatch.context() as patch, pytest.raises(type(failure)), staged_folder(folder) as staged:
            write_set(staged, NEW)
            Failing(patch, failure, step)
        assert read_set(folder) in (whole(OLD), whole(NEW)), step
        assert leftovers(folder) == [], step


def test_the_next_run_clears_what_is_certainly_dead(out):
    dead, alive = (out / f"{staging._PREFIX}{staging._kernel()}-{name}" for name in ("dead", "alive"))
    elsewhere, long_ago = (out / f"{staging._PREFIX}01234567-{name}" for name in ("recent", "old"))
    for folder in (dead, alive, elsewhere, long_ago):
        folder.mkdir()
        (folder / "half").write_text("half")
    os.utime(long_ago, (0, 0))
    held = staging._try_lock(alive)
    try:
        with staged_folder(out):
            pass
        assert not dead.exists() and not long_ago.exists()
        assert (alive / "half").exists(), "its process holds the lock"
        assert (elsewhere / "half").exists(), "another machine may be at work in it"
    finally:
        os.close(held)


def test_a_link_named_like_a_staging_folder_is_not_followed(out, tmp_path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").write_text("mine")
    (out / f"{staging._PREFIX}{staging._kernel()}-trap").symlink_to(tmp_path / "precious")
    with staged_folder(out):
        pass
    assert (tmp_path / "precious" / "file").read_text() == "mine"


def test_without_links_the_summary_is_published_last(out, monkeypatch):
    """A file system such as FAT."""

    def refused(*args, **kwargs):
        raise OSError(errno.EPERM, "Operation not permitted")

    order = []
    replace = Path.replace
    monkeypatch.setattr(os, "link", refused)
    monkeypatch.setattr(Path, "symlink_to", refused)
    monkeypatch.setattr(Path, "replace", lambda self, to: (order.append(to.name), replace(self, to))[1])
    with staged_folder(out) as folder:
        write_set(folder, NEW)
    assert order == [*sorted(NEW), "summary.json"]
    assert read_set(out).items() >= whole(NEW).items()
    assert leftovers(out) == []


def test_two_runs_publish_into_one_folder_one_after_the_other(tmp_path):
    out, sets = tmp_path / "out", [{f"{k}.txt": f"set {n}" for k in range(6)} for n in range(2)]

    def publish(files):
        for _ in range(15):
            with staged_folder(out) as folder:
                write_set(folder, files)

    with ThreadPoolExecutor() as pool:
        list(pool.map(publish, sets))
    assert read_set(out) in [whole(files) for files in sets]
    assert leftovers(out) == []


WAITING = """
import pathlib, sys, time
from sonospline import _terminal
from sonospline.io.staging import staged_folder
with _terminal.signals_that_clean_up(), staged_folder(sys.argv[1]) as folder:
    (folder / "half").write_text("half")
    print("ready", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_run_that_is_told_to_end_leaves_nothing(tmp_path, number, code):
    run = subprocess.Popen([sys.executable, "-c", WAITING, tmp_path / "a" / "b"], stdout=subprocess.PIPE, text=True)
    with run:
        assert run.stdout.readline() == "ready\n"
        run.send_signal(number)
        assert run.wait(30) == code
    assert list(tmp_path.iterdir()) == []


SWALLOWING = WAITING.replace(
    """    print("ready", flush=True)
    time.sleep(60)""",
    """
    try:
        try:
            print("ready", flush=True)
            time.sleep(60)
        except:
            pass
        time.sleep(60)
    finally:
        time.sleep(2)  # what cleans up is not interrupted
        pathlib.Path(sys.argv[1]).with_name("cleaned").touch()
""",
)


@pytest.mark.slow
def test_a_signal_that_a_library_swallows_is_raised_again(tmp_path):
    command = [sys.executable, "-c", SWALLOWING, tmp_path / "out"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout.readline() == "ready\n"
        run.send_signal(signal.SIGTERM)
        assert run.wait(30) == 143
    assert [file.name for file in tmp_path.iterdir()] == ["cleaned"]


@pytest.mark.slow
def test_a_signal_that_becomes_another_error_still_ends_the_run_with_its_code():
    code = """
import os, signal, sys
from sonospline import cli
from sonospline.commands import doctor
def run(args):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except SystemExit:
        raise ImportError("numpy failed to import") from None
doctor.run = run
sys.exit(cli.main(["doctor"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (143, "")


def test_a_run_that_is_killed_is_cleared_by_the_next_one_alone(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    command = [sys.executable, "-c", WAITING, out]
    killed, alive = (subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2))
    with killed, alive:
        try:
            assert killed.stdout.readline() == alive.stdout.readline() == "ready\n"
            killed.kill()
            killed.wait(30)
            assert len(list(out.iterdir())) == 2
            with staged_folder(out):
                pass
            assert len(list(out.iterdir())) == 1
        finally:
            alive.terminate()
        assert alive.wait(30) == 143
    assert list(out.iterdir()) == []
