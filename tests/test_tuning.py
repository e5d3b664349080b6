"""The search gives the same front however it is run, and its parameters reach `insert`."""

import csv
import json
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import sonospline as ss
from builds import run_without
from pools import rows_in_threads
from sonospline import cli, models
from sonospline.commands import _parameters, tune
from sonospline.study import front_files, parallel, tuning
from sonospline.study.insertions import tuning_insertions
from sonospline.study.objective import TUNABLES, Objective, errors_at_target, model_of
from sonospline.study.parallel import dask_executor, rows_in_parallel
from sonospline.study.reference import Reference, errors_along
from sonospline.study.tuning import ParetoFront, search

pymoo = pytest.importorskip("pymoo", reason="needs the extra 'tune'")

DESIGN = np.array([0.02, 0.002, 0.15, 0.02, 0.02, 0.03, 0.04])
OUTPUTS = ["front.csv", "front.png", "parameters.toml", "summary.json"]
TINY = ["--side", "9", "--steps", "1", "--population", "4", "--generations", "2", "--workers", "1", "--quiet"]


@pytest.fixture
def references(an_analytic_history):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    plans = tuning_insertions()
    return tuple(Reference.solve(plan, tissue, steps=2, history=an_analytic_history) for plan in plans)


@pytest.fixture
def without_finite_elements(monkeypatch, an_analytic_history):
    """The verb with the stand-in for its references."""

    def solve(plan, tissue, *, steps):
        return Reference.solve(plan, tissue, steps=steps, history=an_analytic_history)

    monkeypatch.setattr(tune, "Reference", type("Reference", (), {"solve": staticmethod(solve)}))


def test_a_design_is_a_model_whose_truncation_follows_its_decay():
    model = model_of(DESIGN, side=80)
    assert model.shaft_radius == pytest.approx(3 * model.shaft_decay)
    assert model.shaft_decay == pytest.approx(80 * 0.15)
    assert [getattr(model_of(DESIGN), tunable.name) for tunable in TUNABLES] == DESIGN.tolist()
    with pytest.raises(ValueError, match="give the 7 numbers"):
        model_of(DESIGN[:6])


def test_the_ranges_hold_table_1_and_only_valid_models():
    paper = ss.NeedleTissueModel.paper()
    for tunable in TUNABLES:
        assert tunable.low < getattr(paper, tunable.name) < tunable.high
    for end in ("low", "high"):
        model_of([getattr(tunable, end) for tunable in TUNABLES])


def test_the_objective_is_the_mean_error_over_the_depths(references):
    by_depth = errors_along(ss.Insertion(references[1].tissue, model_of(DESIGN)), references[1])
    assert Objective(references)(DESIGN)[1] == pytest.approx(np.mean([e.mae for e in by_depth]), abs=2e-6)


def test_errors_at_the_target_are_named_and_averaged(references):
    errors = errors_at_target(references, model_of(DESIGN))
    assert list(errors) == ["T1", "T2", "T3", "mean"]
    assert errors["mean"].mae == pytest.approx(np.mean([errors[name].mae for name in ("T1", "T2", "T3")]))


def test_an_objective_needs_references():
    with pytest.raises(ValueError, match="references is empty"):
        Objective(())


def test_nothing_betters_the_front_and_the_front_betters_the_rest(rng):
    objectives = rng.random((60, 3))
    front = ParetoFront.of(rng.random((60, 7)), objectives)
    for point in objectives:
        on_front = (front.objectives == point).all(axis=1).any()
        bettered = (front.objectives <= point).all(axis=1) & (front.objectives < point).any(axis=1)
        assert on_front != bettered.any()
    assert front.objectives[front.chosen].mean() == objectives.mean(axis=1).min()


def test_equal_designs_count_once():
    front = ParetoFront.of(np.zeros((5, 7)), np.ones((5, 3)))
    assert len(front.designs) == 1


@pytest.mark.slow
def test_the_front_does_not_depend_on_how_it_is_run(references):
    run = {"population": 6, "generations": 3, "seed": 3}
    objective = Objective(references)
    with ThreadPoolExecutor(3) as executor:
        threads = search(objective, **run, workers=3, executor=executor)
        other = search(objective, **{**run, "seed": 4}, workers=1, executor=executor)
    processes = search(objective, **run, workers=2)
    for part in ("designs", "objectives"):
        assert np.array_equal(getattr(threads, part), getattr(processes, part))
    assert not np.array_equal(threads.designs, other.designs)


@pytest.mark.slow
def test_a_longer_search_is_no_worse(references):
    with ThreadPoolExecutor(2) as executor:
        fronts = [
            search(Objective(references), population=8, generations=n, workers=2, executor=executor) for n in (1, 6)
        ]
    best = [front.objectives.mean(axis=1).min() for front in fronts]
    assert best[1] < best[0]


@pytest.mark.parametrize("name", ["population", "generations", "workers"])
def test_a_search_refuses_sizes_of_zero(name):
    with pytest.raises(ValueError, match=f"{name} = 0 is too small"):
        search(np.sum, **{name: 0})


def test_rows_keep_their_order_on_any_executor():
    rows = np.arange(20.0).reshape(10, 2)
    with (
        ThreadPoolExecutor(3) as executor,
        rows_in_parallel(np.cumsum, workers=4, executor=executor) as apply,
    ):
        assert np.array_equal(apply(rows), np.cumsum(rows, axis=1))


@pytest.mark.slow
def test_workers_do_not_outlive_a_killed_search(tmp_path):
    (tmp_path / "killed.py").write_text(
        "import os, signal, numpy\n"
        "from sonospline.study.parallel import rows_in_parallel\n"
        "if __name__ == '__main__':\n"
        "    with rows_in_parallel(numpy.cumsum, workers=1) as apply:\n"
        "        print(apply(numpy.ones((1, 2))), flush=True)\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    # Returns when nobody holds its output any longer, the worker included.
    done = subprocess.run(
        [sys.executable, tmp_path / "killed.py"], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout == "[[1. 2.]]\n"


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_front(references):
    distributed = pytest.importorskip("distributed", reason="needs the extra 'dask'")
    run = {"population": 6, "generations": 2, "seed": 3}
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, processes=True
    )
    with cluster, dask_executor(cluster.scheduler_address) as (executor, threads):
        assert threads == 2
        on_cluster = search(Objective(references), **run, workers=threads, executor=executor)
    here = search(Objective(references), **run, workers=1)
    assert np.array_equal(on_cluster.designs, here.designs)
    assert np.array_equal(on_cluster.objectives, here.objectives)


def test_the_verb_writes_a_front_and_parameters_that_insert_accepts(tmp_path, capsys, without_finite_elements):
    assert cli.main(["tune", *TINY, "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == OUTPUTS
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == printed
    assert printed["evaluations"] == 8
    assert len(printed["errors"]["tuned"]["held_out"]) == 9
    with (tmp_path / "out" / "front.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["chosen"] for row in table].count("True") == 1
    assert len(table) == len(printed["front"])
    file = tmp_path / "out" / "parameters.toml"
    side = 50.0
    model = replace(ss.NeedleTissueModel.paper(side), **_parameters.read(file, models.spec("paper"), side))
    for name, value in printed["parameters"].items():
        assert getattr(model, name) == pytest.approx(side * value)


@pytest.mark.slow
def test_insert_scales_tuned_parameters_to_its_tissue(tmp_path, capsys):
    pytest.importorskip("SimpleITK", reason="needs the extra 'io'")
    (tmp_path / "parameters.toml").write_text(_parameters.text(model_of(DESIGN), ["a remark"]))
    options = ["--parameters", str(tmp_path / "parameters.toml"), "--set", "tip_displacement=3"]
    small = ["--nodes", "1000", "--steps", "1", "--quiet", "--json"]
    assert cli.main(["insert", *options, *small, "--out", str(tmp_path / "out")]) == 0
    model = json.loads(capsys.readouterr().out)["model_mm"]
    assert model["shaft_decay"] == pytest.approx(0.15 * 83.25)
    assert model["tip_displacement"] == 3


@pytest.mark.slow
def test_the_verb_tells_a_person_what_it_found(tmp_path, capsys, without_finite_elements, monkeypatch):
    monkeypatch.setattr(tuning, "rows_in_parallel", rows_in_threads)
    assert cli.main(["tune", *TINY, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    for words in ("tuned, held out", "Table I, tuned on", "doing nothing", "sigma_tip", "parameters.toml"):
        assert words in said
    content = tomllib.loads((tmp_path / "out" / "parameters.toml").read_text())
    assert content.pop("unit") == "side"
    assert tuple(content) == _parameters.NAMES


@pytest.mark.slow
def test_the_verb_keeps_its_finite_elements_for_the_next_time(tmp_path, capsys, monkeypatch):
    pytest.importorskip("skfem", reason="needs the extra 'fem'")
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    small = ["--population", "2", "--generations", "1", "--json"]
    for name in "ab":
        assert cli.main(["tune", *TINY, *small, "--out", str(tmp_path / name)]) == 0
    first, second = capsys.readouterr().out.replace("}\n{", "}\n|{").split("|")
    first, second = json.loads(first), json.loads(second)
    assert first["errors"] == second["errors"]
    assert first["errors"]["tuned"]["held_out"]["mean"]["zero_mae"] == pytest.approx(3.64e-3, rel=0.01)
    assert len(list((tmp_path / "cache").iterdir())) == 11


@pytest.mark.slow
def test_the_same_seed_writes_the_same_parameters(tmp_path, without_finite_elements):
    for name, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        assert cli.main(["tune", *TINY, "--seed", seed, "--out", str(tmp_path / name)]) == 0
    texts = [(tmp_path / name / "front.csv").read_text() for name in "abc"]
    assert texts[0] == texts[1] != texts[2]


BAD = {
    "no nodes": (["--side", "4"], "--side = 4 is too small"),
    "no steps": (["--steps", "0"], "--steps = 0 is too small"),
    "one design": (["--population", "1"], "--population = 1 is too small"),
    "no generations": (["--generations", "0"], "--generations = 0 is too small"),
    "negative seed": (["--seed", "-1"], "--seed = -1 is too small"),
    "no workers": (["--workers", "0"], "--workers = 0 is too small"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_exit_code_2_and_no_output(case, tmp_path, capsys):
    arguments, message = BAD[case]
    assert cli.main(["tune", *arguments, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "http://"])
def test_a_scheduler_that_does_not_answer_is_refused(address, tmp_path, capsys, without_finite_elements, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra 'dask'")
    monkeypatch.setattr(parallel, "ANSWER_S", 0.5)
    assert cli.main(["tune", *TINY, "--dask", address, "--out", str(tmp_path / "out")]) == 2
    assert "does not answer" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('unit = "inch"', "unit = 'inch' is not known; choose one of mm, side"),
        ('unit = "side"\nshaft_decay = "wide"', "shaft_decay = 'wide' is not a number"),
        ('unit = "side"\nsigma_s = 1', "sigma_s is no option of model = 'paper'"),
    ],
)
def test_a_parameter_file_that_makes_no_sense_is_refused(content, message, tmp_path):
    (tmp_path / "model.toml").write_text(content)
    with pytest.raises(ValueError, match=message):
        _parameters.read(tmp_path / "model.toml", models.spec("paper"), 1.0)


def test_a_missing_pymoo_is_one_clear_line(tmp_path):
    done = run_without("pymoo", "tune", "--out", tmp_path / "out", *TINY)
    assert done.returncode == 1
    assert done.stderr == "sonospline tune: pymoo is not installed; run: pip install 'sonospline[tune]'\n"
    assert list(tmp_path.iterdir()) == []


def test_the_front_is_drawn_for_any_number_of_insertions(tmp_path, rng):
    front = ParetoFront.of(rng.random((9, 7)), rng.random((9, 2)))
    front_files.draw(front, ("A", "B"), tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 5000
