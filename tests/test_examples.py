"""Every example runs and gives its one number."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def run(name):
    return runpy.run_path(str(EXAMPLES / name))


def test_every_example_is_tested():
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == [
        "01_push_a_needle.py",
        "02_warp_an_image.py",
        "03_choose_a_reading.py",
        "04_see_a_needle.py",
        "05_drive_the_simulator.py",
        "06_push_and_pull_back.py",
    ]


def test_push_a_needle():
    assert run("01_push_a_needle.py")["largest"] == pytest.approx(0.0266, abs=1e-5)


def test_warp_an_image():
    assert run("02_warp_an_image.py")["target_shift"] == pytest.approx(2.25, abs=0.02)


def test_choose_a_reading():
    means = run("03_choose_a_reading.py")["mean_displacement"]
    assert list(means.values()) == pytest.approx([0.00270, 0.00303, 0.00210], rel=0.01)


def test_see_a_needle():
    assert run("04_see_a_needle.py")["calyx_shift"] == pytest.approx(2.699, abs=0.01)


def test_drive_the_simulator():
    assert run("05_drive_the_simulator.py")["vessel_moved"] == pytest.approx(0.871, abs=0.01)


@pytest.mark.slow
def test_push_and_pull_back():
    assert run("06_push_and_pull_back.py")["middle"] == pytest.approx(-2.61, abs=0.05)  # outward of rest
