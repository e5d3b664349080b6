"""The benchmark that learns an environment: a few steps of it, and what it keeps of them."""

import json
import runpy
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra 'learn'")
pytest.importorskip("matplotlib", reason="needs the extra 'plot'")

pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).parents[1] / "benchmarks" / "a_learner_finds_the_plane_in_minutes.py"


@pytest.fixture(scope="module")
def main():
    script = runpy.run_path(str(SCRIPT))["main"]
    script.__globals__["GLANCE"] = 1
    return script


def test_some_steps_are_learnt_from_and_kept_with_a_picture(main, tmp_path, capsys):
    missed = main(["--steps", "520", "--judged", "1", "--seed", "3", "--out", str(tmp_path)])
    found = json.loads((tmp_path / "learning-3.json").read_text())
    assert (found["steps"], found["episodes"], len(found["curve"])) == (520, 1, 1)
    assert missed == (found["solved"] < 0.95) and (tmp_path / "learning.png").stat().st_size > 1000
    assert f"{found['solved']:.1%} of 1 held-out episodes solved" in capsys.readouterr().out


def test_nothing_to_learn_from_is_one_line(main, capsys):
    with pytest.raises(SystemExit):
        main(["--steps", "0"])
    assert "--steps 0 and --judged 200: give at least 1 of each" in capsys.readouterr().err
