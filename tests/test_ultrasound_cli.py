"""``sonospline image``: what it writes, and what it refuses."""

import json

import numpy as np
import pytest

from sonospline.cli import main
from sonospline.geometry.layered_block import layered_block
from sonospline.io.volumes import write_volume

pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
QUICK = ["--voxel", "2", "--nodes", "4000", "--quiet", "--json"]


def image(capsys, *arguments):
    assert main(["image", *map(str, arguments)]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_kidney_before_and_after(tmp_path, capsys):
    report = image(capsys, "--out", tmp_path / "out", "--cine", 2, "--depth", 90, *QUICK)
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert (
        written
        == ["after.png", "before.png", "cine.gif", "cine.igs.mha", "image.mha", "summary.json"]
        == report["files"]
    )
    assert 0.5 < report["max_displacement_mm"] < 5
    assert report["picture"][1] == 512
    assert 0 < report["render_ms"] < report["first_ms"]


@pytest.mark.slow
def test_another_probe_at_another_place(tmp_path, capsys):
    report = image(
        capsys, "--probe", "linear", "--depth", 45, "--origin", "110,50,0.5", "--out", tmp_path / "out", *QUICK
    )
    half_a_pixel = report["pixel_mm"] / 2
    middle = [(report["picture"][1] - 1) * half_a_pixel, half_a_pixel, 0, 1]
    shown = (np.array(report["image_to_reference"]) @ middle)[:3]
    assert np.allclose(shown, [110, 50, 0.5 + 2 * half_a_pixel], atol=3 * half_a_pixel)


@pytest.mark.slow
def test_a_real_volume_is_cut_through_the_needle(tmp_path, capsys):
    write_volume(layered_block(), tmp_path / "block.mha")
    where = ["--entry", "0,30,42", "--target", "62,44,42"]
    report = image(capsys, "--volume", tmp_path / "block.mha", *where, "--out", tmp_path / "out", *QUICK)
    assert report["seen_share"] > 0.5
    assert {"after.png", "before.png", "image.mha"} <= set(report["files"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--origin", "1,2"], "--origin '1,2' is not a point"),
        (["--look", "1,0,0", "--origin", "0,0,0"], "parallel to depth"),
        (["--depth", "0"], "--depth = 0.0 is out of range"),
        (["--entry", "1,2,3"], "--target is missing"),
        (["--volume", "none.mha"], "does not exist"),
        (["--labels", "none.nrrd", "--volume", "none.mha"], "both given"),
        (["--names", "organs.csv"], "--names belongs to --labels"),
        (["--labels", "organs.nii.gz", "--table", "t.csv", "--ct", "ct.nii.gz"], "--ct belongs to --names"),
        (["--cine", "-1"], "--cine = -1"),
    ],
)
def test_what_it_cannot_image_is_said_in_one_line(arguments, message, tmp_path, capsys):
    assert main(["image", *arguments, "--out", str(tmp_path / "out"), *QUICK]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
