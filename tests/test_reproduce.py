"""The paper's results end to end, on meshes small enough for every day."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from labelled_tissue import torso
from pools import rows_in_threads
from sonospline import cli
from sonospline.study import claims, dense_steps, drift, report, step_times, study, tuning
from sonospline.study.insertions import held_out_insertions
from sonospline.study.models_compared import Scope
from sonospline.study.notebook import Notebook
from sonospline.study.plan import Plan

for package in ("skfem", "pyamg", "pymoo", "matplotlib"):
    pytest.importorskip(package, reason="needs the extras 'tune' and 'plot'")


def a_torso(folder, labels=None):
    """The path of a label map that has its names beside it."""
    labels, path = labels or torso(), folder / "torso.nii.gz"
    ss.write_volume(labels, path)
    path.with_name("torso.csv").write_text(
        "label,name\n" + "".join(f"{number},{name}\n" for number, name in labels.names.items())
    )
    return path


TIMED = dict.fromkeys(("from_scratch", "multigrid", "direct"), "scikit-fem")
TINY = Plan(
    seed=3,
    solver="multigrid",
    timed=TIMED,
    sides=(7, 9),
    depths=4,
    population=4,
    generations=2,
    workers=1,
    drawn=6,
    alone=1,
    fits=30,
    dense_side=13,
    dense_counts=(30,),
    scope=Scope(("H3",), fine=25, side=17, depths=2, steps=20, cubes=("homogeneous", "layers"), real=0, checked=13),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A notebook's folder and the results of a tiny study; of its processes that of the dense steps alone is one."""
    folder = tmp_path_factory.mktemp("parts")
    with pytest.MonkeyPatch.context() as here:
        here.setattr(step_times, "in_one_thread", lambda function, *given: json.loads(json.dumps(function(*given))))
        here.setattr(tuning, "rows_in_parallel", rows_in_threads)
        return folder, study.run_study(TINY, Notebook(folder))


@pytest.mark.slow
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


@pytest.mark.slow
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
    friction = {(r["specimen"], r["model"]): r for r in results["models"]["friction"] if r["depth"] == 1.0}
    for cube in ("homogeneous", "layers"):
        assert friction[cube, "elastic"]["relative"] < 0.05
        assert friction[cube, "elastic"]["tip_share"] < 0.1
    assert friction["homogeneous", "kelvinlet"]["relative"] < 0.2 < friction["homogeneous", "tuned"]["relative"]
    for ignorant in ("tuned", "kelvinlet", "one stiffness"):
        assert friction["layers", ignorant]["relative"] > 0.8
    assert set(friction["layers", "elastic"]["tissues"]) == {"first layer", "stiff layer, x 5", "last layer, x 2"}
    held = {(r["specimen"], r["model"]): r["relative"] for r in results["models"]["held"]}
    assert held["homogeneous", "kelvinlet"] < held["homogeneous", "tuned"] < 1
    assert held["layers", "one stiffness"] < held["layers", "tuned"]
    assert np.shape(results["models"]["maps"]["layers"]["elastic"]) == (13, 13)
    assert min(row["elastic_ms"] for row in results["times"]) > 0


def test_times_are_taken_without_anything_else(tmp_path, monkeypatch):
    """On a machine that is quiet for a while, nothing that any machine could do is in their way."""
    monkeypatch.setattr(dense_steps, "measure", lambda side, counts: [{"landmarks": counts[0]}])
    monkeypatch.setattr(step_times, "measure", lambda side, engines: {"side": side})
    found = study.run_study(TINY, Notebook(tmp_path), only=("times", "dense"))
    assert found["dense"] == [{"landmarks": 30}]
    assert [row["side"] for row in found["times"]] == [7, 9]
    assert sorted(file.stem for file in tmp_path.iterdir()) == ["dense_steps", "times_7", "times_9"]


@pytest.mark.parametrize(
    ("name", "says"), [("vertebrae_L1", "meets bone"), ("cyst", "reaches every face"), ("nonsense", "nonsense")]
)
def test_a_label_map_that_cannot_serve_is_refused_before_any_work(name, says, tmp_path, capsys):
    alike = ss.LabelMap(voxels=np.full((9, 9, 9), 1, np.uint8), spacing=(5.0, 5.0, 5.0), names={1: name})
    labels, out = a_torso(tmp_path, alike), tmp_path / "out"
    assert cli.main(["reproduce", "--quick", "--labels", str(labels), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_part_of_another_version_is_computed_anew(tmp_path, monkeypatch):
    notebook = Notebook(tmp_path)
    assert notebook.part("a_sum", {"n": 1}, lambda: 1) == 1
    monkeypatch.setattr("sonospline.study.notebook.version", lambda package: "0.0.0")
    assert notebook.part("a_sum", {"n": 1}, lambda: 2) == 2
    assert json.loads((tmp_path / "a_sum.json").read_text())["seconds"] < 60


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
    assert "anchors prevent drift under repeated updates | yes | yes:" in text
    dense = [row["from_scratch_ms"] / row["dense_ms"] for row in results["times"]]
    assert f"{min(dense):,.0f} to {max(dense):,.0f} with the paper's own dense step" in text
    assert "saturates" not in text
    for symbol, paper in (("f_max", "0.0227"), ("sigma_s", "0.1291"), ("l_tip", "0.0899")):
        assert f"| {symbol} |" in text
        assert f"| {paper} |" in text
    row = results["times"][-1]
    assert f"{row['from_scratch_ms'] / row['ours_ms']:,.0f} times from scratch" in text
    for heading in ("Table I", "Time per step", "thin plate", "Algorithm 1 can be read", "on the same loads"):
        assert heading in text


def test_the_papers_time_says_how_many_landmarks_it_can_have_had():
    rows = [
        {"landmarks": n, "numpy_ms": 0.5 * n, "solve_ms": 0.0, "compiled_sum_ms": 0.1 * n} for n in (10, 50, 100, 1000)
    ]
    found = dense_steps.landmarks_within(rows)
    assert list(found.values()) == pytest.approx([92, 458], abs=1)


@pytest.mark.slow
def test_more_anchors_drift_less_and_no_update_adds_to_it(monkeypatch):
    monkeypatch.setattr(drift, "TIMES_AS_MANY", 2)
    rows = drift.measure(7, held_out_insertions()[:1])
    mapped = [row for row in rows if row["accumulation"] == "maximum"]
    once, again = mapped[::2], mapped[1::2]
    assert [row["anchors"] for row in once] == [8, 89, 193]
    assert [row["drift"] for row in once] == [row["drift"] for row in again]
    assert once[0]["drift"] > 2 * once[1]["drift"] > 1e-4
    assert once[2]["drift"] < 1e-9
    assert "yes: " in claims._drift(rows)
    grown = [row | {"drift": row["drift"] * row["updates"]} for row in rows]
    assert claims._drift(grown).startswith("no: ")


@pytest.mark.slow
def test_a_measurement_that_fails_says_what_its_process_said():
    with pytest.raises(RuntimeError, match=r"timed.*failed: ValueError"):
        dense_steps.measure(-1, (20,))


def test_flattening_is_told_from_the_curve():
    def curve(maes):
        return [{"depth": (k + 1) / len(maes), "mae": mae} for k, mae in enumerate(maes)]

    assert claims._flattening(curve([1, 2, 3, 4, 5, 6])).startswith("no")
    assert claims._flattening(curve([1, 2, 3, 4, 4.1, 4.2])).startswith("yes")
    assert claims._flattening(curve([1, 2])).startswith("not measured")


@pytest.mark.slow
def test_reproduce_writes_report_and_figures_and_keeps_parts_of_a_stopped_run(tmp_path, monkeypatch, capsys, finished):
    parts, results = finished
    real = replace(TINY, scope=replace(TINY.scope, real=1))
    monkeypatch.setattr(Plan, "quick", classmethod(lambda cls, seed, labels: replace(real, labels=labels)))
    out, labels = tmp_path / "paper", a_torso(tmp_path)
    stopped = ["reproduce", "--quick", "--quiet", "--labels", str(labels), "--out", str(out)]
    shutil.copytree(parts, out / "parts", ignore=shutil.ignore_patterns("times_9.json", "errors_9_H8.json"))
    with monkeypatch.context() as broken:
        broken.setattr(step_times, "measure", lambda *_: (_ for _ in ()).throw(RuntimeError("stopped here")))
        assert cli.main(stopped) == 1
    assert "stopped here" in capsys.readouterr().err
    assert (out / "parts" / "errors_9_H8.json").exists()
    assert not (out / "report.md").exists()
    shutil.copy(parts / "times_9.json", out / "parts")
    assert cli.main([*stopped, "--only", "anatomy"]) == 0
    assert sorted(file.name for file in (out / "parts").glob("anatomy_*")) == [
        "anatomy_kidney_scene_H1.json",
        "anatomy_torso_H1.json",
    ]
    assert not (out / "report.md").exists()
    assert "a run without --only writes the report" in capsys.readouterr().out
    assert cli.main([*stopped, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["tuning"] == results["tuning"]
    pictures = ["figure_1.png", "figure_2.png", "figure_3.png", "front.png"]
    pictures += [f"models_{what}.png" for what in ("anatomy", "depth", "maps")]
    assert sorted(file.name for file in out.iterdir()) == [*pictures, "parts", "report.md", "results.json"]
    for name in pictures:
        assert (out / name).stat().st_size > 10_000
    text = (out / "report.md").read_text()
    assert "![Fig. 2" in text
    for row in summary["anatomy"]["scikit_fem"]:
        assert row["difference"] < 3e-4
    live = {row["specimen"]: row for row in summary["anatomy"]["friction"] if row["model"] == "elastic"}
    for name in ("kidney scene", "torso"):
        assert f"| {name} | H1 | {live[name]['published']:.3f} |" in text
        assert live[name]["relative"] < 0.5 * min(
            row["relative"] for row in summary["anatomy"]["friction"] if row["specimen"] == name != row["model"]
            and row["model"] != "elastic" and row["depth"] == 1.0
        )  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seed", "-1"], "--seed"),
        (["--image", "no such.mha"], "no such.mha"),
        (["--labels", "no such.mha"], "no such.mha"),
    ],
)
def test_bad_input_is_one_line_and_nothing_written(arguments, says, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["reproduce", "--quick", "--out", str(out), *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not out.exists()
