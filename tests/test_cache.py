"""The cache: what is kept comes back as it was or not at all, and never ends a run."""

import logging
import os
import shutil
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sonospline import _cache
from sonospline.phantoms import kidney_phantom
from sonospline.study.notebook import Notebook

ARRAY = np.random.default_rng(3).standard_normal((9, 11))


def keep_array(file):
    _cache.keep(file, partial(np.save, arr=ARRAY), "an array")
    return lambda: _cache.recall(file, np.load, "an array")


def keep_archive(file):
    def load(stream):
        with np.load(stream) as kept:
            assert int(kept["version"]) == 1
            return kept["array"]

    _cache.keep(file, lambda stream: np.savez(stream, version=1, array=ARRAY), "an archive")
    return lambda: _cache.recall(file, load, "an archive")


def keep_part(file):
    settings = {"of": "ARRAY"}
    Notebook(file.parent).part(file.stem, settings, ARRAY.tolist)

    def recall():
        computed = []
        answer = np.array(Notebook(file.parent, computed.append).part(file.stem, settings, ARRAY.tolist))
        return None if computed else answer

    return recall


KINDS = {"kept.npy": keep_array, "kept.npz": keep_archive, "part.json": keep_part}


def damaged(whole, random):
    """A file that was cut, lengthened, overwritten or had one bit turned, anywhere."""
    at = int(random.integers(len(whole)))
    some = random.bytes(int(random.integers(1, 40)))
    return [
        whole[:at],
        whole[:at] + some + whole[at:],
        whole[:at] + some + whole[at + len(some) :],
        whole[:at] + bytes([whole[at] ^ 1 << int(random.integers(8))]) + whole[at + 1 :],
        whole[:at] + bytes(len(some)) + whole[at + len(some) :],
        whole + some,
    ][int(random.integers(6))]


def read_damaged(name, folder, tries):
    random = np.random.default_rng(tries)
    recall = KINDS[name](folder / name)
    whole = (folder / name).read_bytes()
    assert np.array_equal(recall(), ARRAY)
    refused = 0
    for _ in range(tries):
        found = damaged(whole, random)
        (folder / name).write_bytes(found)
        answer = recall()
        if answer is not None:
            assert np.array_equal(answer, ARRAY), "a damaged file was believed"
        refused += answer is None
        assert (answer is None) or found == whole or name == "part.json"  # JSON may gain or lose a blank
    assert refused > 0.8 * tries


@pytest.mark.parametrize("name", KINDS)
def test_a_damaged_file_is_made_anew(name, tmp_path, caplog):
    caplog.set_level(logging.ERROR)
    read_damaged(name, tmp_path, 60)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_hundreds_of_damaged_files_are_made_anew(name, tmp_path, caplog):
    caplog.set_level(logging.ERROR)
    read_damaged(name, tmp_path, 500)


def test_one_byte_anywhere_in_a_kept_phantom_is_seen(tmp_path, monkeypatch, caplog):
    """In its header, which NumPy would hand to a Python parser, and in its voxels, which it would believe."""
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    labels = kidney_phantom(spacing_mm=4.0, kept=True).phantom.labels.voxels
    (file,) = tmp_path.glob("kidney-*.npy")
    whole = file.read_bytes()
    for at in (whole.index(b")"), whole.index(b"descr"), 8, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:at] + b"(" + whole[at + 1 :])
        caplog.clear()
        assert np.array_equal(kidney_phantom(spacing_mm=4.0, kept=True).phantom.labels.voxels, labels)
        assert "made anew" in caplog.text
        assert file.read_bytes() == whole
    assert np.array_equal(np.load(file), labels)  # NumPy still opens it


def test_whatever_a_loader_raises_counts_as_absent(tmp_path, caplog):
    file = tmp_path / "kept"
    _cache.keep(file, lambda stream: stream.write(b"sound"), "a text")
    for failure in (MemoryError(), OverflowError("wild"), SyntaxError("odd"), RecursionError(), UnicodeError("x")):

        def load(stream, failure=failure):
            raise failure

        assert _cache.recall(file, load, "a text") is None
    assert caplog.text.count("made anew") == 5
    assert _cache.recall(file, lambda stream: stream.read(5), "a text") == b"sound"


def test_what_is_no_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder", "absent", "x" * 300):
        assert _cache.recall(tmp_path / name, lambda stream: stream.read(), "a text") is None


def test_a_full_disk_keeps_nothing_and_is_no_error(tmp_path, caplog):
    def full(stream):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    _cache.keep(tmp_path / "kept", full, "a text")
    assert list(tmp_path.iterdir()) == []
    assert "cannot keep a text" in caplog.text


def test_what_a_killed_run_left_is_removed_in_time(tmp_path):
    old, recent = tmp_path / ".partial-old", tmp_path / ".partial-recent"
    for file in (old, recent):
        file.write_bytes(b"half")
    os.utime(old, (0, time.time() - 2 * 24 * 3600))
    _cache.keep(tmp_path / "kept", lambda stream: stream.write(b"sound"), "a text")
    assert sorted(file.name for file in tmp_path.iterdir()) == [".partial-recent", "kept"]


def test_the_named_folder_is_used_else_the_users_else_none(tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    assert _cache.place("a", "b") == tmp_path / "a" / "b"
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("SONOSPLINE_CACHE", "~/kept")
    assert _cache.place("a") == tmp_path / "home" / "kept" / "a"
    monkeypatch.delenv("SONOSPLINE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert _cache.place("a") == tmp_path / "xdg" / "sonospline" / "a"
    for ignored in ("relative", ""):
        monkeypatch.setenv("XDG_CACHE_HOME", ignored)
        assert _cache.place("a") == tmp_path / "home" / ".cache" / "sonospline" / "a"


HOMELESS = ["setpriv", "--reuid", "54321", "--regid", "54321", "--clear-groups"]
HOMELESS += [f"--{kind}-caps=+dac_override,+dac_read_search" for kind in ("inh", "ambient")]


KEEP_AND_DRAW = """
import sys
from pathlib import Path
from sonospline.io.canvas import picture
from sonospline.phantoms import kidney_phantom
kidney_phantom(spacing_mm=4.0, kept=True)
with picture(Path(sys.argv[1]), 2, 2):
    pass
"""


@pytest.mark.parametrize("named", ["absolute", "~/kept", ""])
def test_without_a_home_nothing_is_kept_and_nothing_fails(named, tmp_path):
    """A user whom no passwd file knows, without HOME, as in many containers."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("needs root and setpriv")
    tmp_path.chmod(0o777)
    cache = str(tmp_path / "kept") if named == "absolute" else named
    environment = ["env", "-i", f"PATH={os.environ['PATH']}", *([f"SONOSPLINE_CACHE={cache}"] if named else [])]
    command = [*HOMELESS, *environment, sys.executable, "-c", KEEP_AND_DRAW, str(tmp_path / "p.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "p.png").exists()
    assert len(list(tmp_path.glob("kept/kidney-*.npy"))) == (named == "absolute")
    assert ("SONOSPLINE_CACHE = '~/kept' names a home folder that is not there" in done.stderr) == (named == "~/kept")


KEEP_AND_RECALL = """
import sys
from functools import partial
from pathlib import Path
import numpy as np
from sonospline import _cache
file, number = Path(sys.argv[1]), float(sys.argv[2])
print("ready", flush=True)
sys.stdin.readline()
for _ in range(100):
    _cache.keep(file, partial(np.save, arr=np.full(5000, number)), "an array")
    found = _cache.recall(file, np.load, "an array")
    assert found is not None and found.shape == (5000,) and found.min() == found.max()
"""


def test_two_processes_share_a_cache(tmp_path):
    file = tmp_path / "shared.npy"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", KEEP_AND_RECALL, str(file), str(number)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for number in range(2)
    ]  # fmt: skip
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.communicate(timeout=60) and process.returncode for process in processes] == [0, 0]
    assert [Path(kept).name for kept in tmp_path.iterdir()] == ["shared.npy"]
