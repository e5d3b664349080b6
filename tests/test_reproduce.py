"""The paper's results end to end, on meshes small enough for every day."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sonospline import cli
from sonospline.study import claims, report, step_times, study
from sonospline.study.insertions import held_out_insertions
from sonospline.study.models_compared import Scope
from sonospline.study.notebook import Notebook

for package in ("skfem", "pyamg", "pymoo", "matplotlib"):
    pytest.importorskip(package, reason="needs the extras 'tune' and 'plot'")

TIMED = dict.fromkeys(("from_scratch", "multigrid", "direct"), "scikit-fem")
TINY = study.Plan(
    seed=3,
    solver="multigrid",
    timed=TIMED,
    sides=(7, 9),
    depths=4,
    population=4,
    generations=2,
    workers=1,
    scope=Scope(("H3",), fine=33, side=17, depths=2, steps=20, cubes=("homogeneous", "layers")),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A notebook's folder and the results of a tiny study."""
    folder = tmp_path_factory.mktemp("parts")
    return folder, study.run_study(TINY, Notebook(folder))


def test_the_study_measures_every_mesh_depth_insertion_and_model(finished):
    _, results = finished
    seen = {(row["side"], row["depth"], row["insertion"], row["model"]) for row in results["errors"]}
    names = [insertion.name for insertion in held_out_insertions()]
    assert seen == {
        (s, d, i, m) for s in (7, 9) for d in (0.25, 0.5, 0.75, 1.0) for i in names for m in ("tuned", "paper")
    }
    assert [row["nodes"] for row in results["times"]] == [343, 729]
    for row in results["times"]:
        assert min(row["ours_ms"], row["from_scratch_ms"], row["multigrid_ms"], row["direct_ms"]) > 0


def test_errors_at_the_target_are_those_of_the_last_depth(finished):
    _, results = finished
    for model in ("tuned", "paper"):
        by_depth = {
            row["insertion"]: row["mae"]
            for row in results["errors"]
            if (row["side"], row["depth"], row["model"]) == (7, 1.0, model)
        }
        at_target = results["target"][model]["held_out"]
        for name, mae in by_depth.items():
            assert mae == pytest.approx(at_target[name]["mae"], rel=1e-3)
        assert at_target["mean"]["mae"] == pytest.approx(np.mean(list(by_depth.values())), rel=1e-3)


def test_references_are_the_same_bits_however_many_are_solved_at_once(tmp_path, monkeypatch):
    found = []
    for workers in (1, 2):
        monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / f"{workers}"))
        plan = replace(TINY, workers=workers, depths=2)
        study._references.cache_clear()
        found.append([study.reference_of(plan, insertion, 9).displacements for insertion in held_out_insertions()])
    study._references.cache_clear()
    assert len(list((tmp_path / "2").iterdir())) == len(held_out_insertions())
    assert np.array_equal(*found)
    assert np.abs(found[0]).max() > 0.01


def test_a_finished_study_is_read_not_computed(finished, monkeypatch):
    folder, results = finished
    computed = []
    monkeypatch.setattr(step_times, "measure", lambda *_: pytest.fail("timed again"))
    assert study.run_study(TINY, Notebook(folder, computed.append)) == results
    assert computed == []


def test_the_three_models_are_compared_with_finite_elements_in_every_cube(finished):
    _, results = finished
    friction = {(r["cube"], r["model"]): r for r in results["models"]["friction"] if r["depth"] == 1.0}
    for cube in ("homogeneous", "layers"):
        assert friction[cube, "elastic"]["relative"] < 0.05
        assert friction[cube, "elastic"]["tip_share"] < 0.1
    assert friction["homogeneous", "kelvinlet"]["relative"] < 0.2 < friction["homogeneous", "tuned"]["relative"]
    for ignorant in ("tuned", "kelvinlet", "one stiffness"):
        assert friction["layers", ignorant]["relative"] > 0.8
    assert set(friction["layers", "elastic"]["tissues"]) == {"first layer", "stiff layer, x 5", "last layer, x 2"}
    held = {(r["cube"], r["model"]): r["relative"] for r in results["models"]["held"]}
    assert held["homogeneous", "kelvinlet"] < held["homogeneous", "tuned"] < 1
    assert held["layers", "one stiffness"] < held["layers", "tuned"]
    assert np.shape(results["models"]["maps"]["layers"]["elastic"]) == (17, 17)
    assert min(row["elastic_ms"] for row in results["times"]) > 0


def test_other_settings_a_missing_and_a_damaged_part_are_computed_anew(tmp_path, caplog):
    reported = []
    notebook = Notebook(tmp_path, reported.append)
    assert notebook.part("a_sum", {"n": 1}, lambda: [1, 2]) == [1, 2]
    assert notebook.part("a_sum", {"n": 2}, lambda: 3) == 3
    assert notebook.part("a_sum", {"n": 2}, lambda: pytest.fail("computed again")) == 3
    for damage in ("{", "[]", '{"format": 1}'):
        (tmp_path / "a_sum.json").write_text(damage)
        assert notebook.part("a_sum", {"n": 2}, lambda: 4) == 4
    assert reported == ["a sum"] * 5
    assert caplog.text.count("made anew") == 3


def test_mean_rows_are_means_over_what_the_keys_leave_out():
    rows = [{"side": 7, "insertion": i, "mae": i, "rmse": 2 * i, "at_tip": None} for i in (1, 2, 3)]
    assert study.mean_rows(rows, "side") == [{"side": 7, "mae": 2.0, "rmse": 4.0}]


def test_the_report_puts_the_papers_figure_beside_ours(finished):
    _, results = finished
    about = {
        "date": "2026-01-02",
        "seed": 3,
        "machine": {"processor": "P", "memory_gb": 1, "platform": "L", "python": "3"},
        "versions": {"numpy": "2", "pypardiso": None},
    }
    text = report.write(results, about)
    for said in (
        "410 times",
        "220 to 410",
        "18.9 s",
        "45.8 ms",
        "a single solution",
        "2026-01-02",
        "seed 3",
        "numpy 2",
    ):
        assert said in text
    assert "pypardiso" not in text
    assert "| layers | stiff layer, x 5 |" in text
    assert "no: a step costs" in text
    for symbol, paper in (("f_max", "0.0227"), ("sigma_s", "0.1291"), ("l_tip", "0.0899")):
        assert f"| {symbol} |" in text
        assert f"| {paper} |" in text
    row = results["times"][-1]
    assert f"{row['from_scratch_ms'] / row['ours_ms']:,.0f} times from scratch" in text
    for heading in ("Table I", "Time per step", "thin plate", "Algorithm 1 can be read", "on the same loads"):
        assert heading in text


def test_flattening_is_told_from_the_curve():
    def curve(maes):
        return [{"depth": (k + 1) / len(maes), "mae": mae} for k, mae in enumerate(maes)]

    assert claims._flattening(curve([1, 2, 3, 4, 5, 6])).startswith("no")
    assert claims._flattening(curve([1, 2, 3, 4, 4.1, 4.2])).startswith("yes")
    assert claims._flattening(curve([1, 2])).startswith("not measured")


@pytest.mark.slow
def test_reproduce_writes_report_and_figures_and_keeps_parts_of_a_stopped_run(tmp_path, monkeypatch, capsys, finished):
    parts, results = finished
    monkeypatch.setattr(study.Plan, "quick", classmethod(lambda cls, seed: TINY))
    out = tmp_path / "paper"
    stopped = ["reproduce", "--quick", "--quiet", "--out", str(out)]
    shutil.copytree(parts, out / "parts", ignore=shutil.ignore_patterns("times_9.json", "errors_9_H8.json"))
    with monkeypatch.context() as broken:
        broken.setattr(step_times, "measure", lambda *_: (_ for _ in ()).throw(RuntimeError("stopped here")))
        assert cli.main(stopped) == 1
    assert "stopped here" in capsys.readouterr().err
    assert (out / "parts" / "errors_9_H8.json").exists()
    assert not (out / "report.md").exists()
    shutil.copy(parts / "times_9.json", out / "parts")
    assert cli.main([*stopped, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["tuning"] == results["tuning"]
    pictures = ["figure_1.png", "figure_2.png", "figure_3.png", "front.png", "models_depth.png", "models_maps.png"]
    assert sorted(file.name for file in out.iterdir()) == [*pictures, "parts", "report.md", "results.json"]
    for name in pictures:
        assert (out / name).stat().st_size > 10_000
    assert "![Fig. 2" in (out / "report.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["--seed", "-1"], "--seed"), (["--image", "no such.mha"], "no such.mha")],
)
def test_bad_input_is_one_line_and_nothing_written(arguments, says, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["reproduce", "--quick", "--out", str(out), *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not out.exists()
