"""Pictures do not depend on anybody's matplotlib settings, and a run does not depend on its picture."""

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from builds import run_without
from sonospline import cli
from sonospline.io import canvas as _canvas
from sonospline.io.canvas import attempt, picture

pytest.importorskip("matplotlib", reason="needs the extra 'plot'")

DRAW = """
import sys
from pathlib import Path
from sonospline.io.canvas import attempt, picture

def draw():
    with picture(Path(sys.argv[1]), 4, 3) as figure:
        panel = figure.subplots()
        panel.plot([1, 2])
        panel.set_title("x_1")

attempt(draw)
"""
SMALL = ["--nodes", "2000", "--steps", "2", "--quiet"]


def drawn_with(path, **environment):
    done = subprocess.run(
        [sys.executable, "-c", DRAW, str(path)], capture_output=True, check=True, env={**os.environ, **environment}
    )
    return path.read_bytes(), done.stderr


@pytest.mark.slow
def test_the_picture_is_the_same_whatever_the_settings_are(tmp_path):
    plain, _ = drawn_with(tmp_path / "plain.png")
    (tmp_path / "wild").write_text("text.usetex: True\nsavefig.dpi: 3\nbackend: TkAgg\naxes.titlesize: 90\nno colon\n")
    (tmp_path / "binary").write_bytes(b"\xff\xfe: bad\n")
    settings = [
        {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "MATPLOTLIBRC": str(tmp_path / "wild")},
        {"MPLBACKEND": "TkAgg", "MATPLOTLIBRC": str(tmp_path / "binary")},
    ]
    for number, environment in enumerate(settings):
        assert drawn_with(tmp_path / f"{number}.png", **environment)[0] == plain, environment


@pytest.mark.slow
def test_a_picture_leaves_the_users_settings_alone(tmp_path):
    import matplotlib

    with matplotlib.rc_context({"lines.linewidth": 7.0}):
        before = dict(matplotlib.rcParams)
        with picture(tmp_path / "p.png", 4, 3) as figure:
            (line,) = figure.subplots().plot([1, 2])
        assert line.get_linewidth() != 7.0
        assert dict(matplotlib.rcParams) == before
    code = (
        f"import sys, matplotlib; sys.argv = ['', {str(tmp_path / 'q.png')!r}]\n{DRAW}\nprint(matplotlib.get_backend())"
    )
    environment = {**os.environ, "MPLBACKEND": "svg"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "svg\n"


def test_a_picture_that_fails_is_one_line_and_a_full_disk_is_an_error(tmp_path, caplog):
    def broken():
        with picture(tmp_path / "p.png", 4, 3):
            raise ZeroDivisionError("no such thing\nas this")

    with caplog.at_level(logging.WARNING):
        attempt(broken)
    assert caplog.messages == ["p.png could not be drawn: as this"]
    assert list(tmp_path.iterdir()) == []

    def full():
        raise OSError("p.png could not be written")

    with pytest.raises(OSError, match=r"p\.png"):
        attempt(full)


@pytest.mark.slow
def test_a_run_whose_figure_fails_keeps_its_other_files(tmp_path, capsys, monkeypatch, caplog):
    def no_canvas(*size):
        raise RuntimeError("latex was not found")

    arguments = ["insert", "--out", str(tmp_path / "out"), "--json", *SMALL]
    assert cli.main(arguments) == 0
    assert (tmp_path / "out" / "figure.png").exists()
    capsys.readouterr()
    monkeypatch.setattr(_canvas, "blank", no_canvas)
    assert cli.main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    left = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert left == summary["files"] == ["displacement.h5", "displacement.vti", "summary.json", "warped.nrrd"]
    assert caplog.messages == ["figure.png could not be drawn: latex was not found"]


@pytest.mark.slow
def test_without_matplotlib_a_run_has_no_figure_and_says_which_extra_brings_it(tmp_path):
    done = run_without("matplotlib", "insert", "--out", tmp_path / "out", *SMALL)
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert (
        "figure.png could not be drawn: matplotlib is not installed; run: pip install 'sonospline[plot]'" in done.stderr
    )
    assert "picture" not in done.stdout
    assert not (Path(tmp_path) / "out" / "figure.png").exists()
