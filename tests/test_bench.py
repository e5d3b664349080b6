"""The race runs, reports absent peers, and judges its claims; no test asserts a time."""

import json

import numpy as np
import pytest

from builds import needs_core
from sonospline import _core, cli
from sonospline.bench import contenders, instruction_sets, machine, promises, timing
from sonospline.bench.problem import Problem


@pytest.mark.parametrize("contender", [*contenders.OURS, *contenders.PEERS], ids=lambda c: c.name)
def test_every_contender_computes_the_same_field(contender):
    problem = Problem.make(13, 60)
    if reason := contender.unable(problem):
        pytest.skip(reason)
    exact = contenders.dense_fit(problem)
    truth = contenders.PaperStep().evaluate(problem, exact)
    result = contender.values(contender.evaluate(problem, contender.fit(problem)))
    assert np.abs(result - truth).max() < 3e-5


def test_a_problem_is_half_anchors_at_rest_and_half_landmarks():
    problem = Problem.make(25, 300)
    assert problem.count == 300
    assert len(np.unique(problem.nodes, axis=0)) == 300
    assert not problem.values[: problem.anchors].any()
    on_a_face = ((problem.nodes == 0) | (problem.nodes == 24)).any(axis=1)
    assert on_a_face[: problem.anchors].all()
    assert np.array_equal(problem.nodes, Problem.make(25, 300).nodes)


def test_ratios_are_taken_pair_by_pair():
    slow, fast = timing.Times((10.0, 40.0, 30.0)), timing.Times((1.0, 2.0, 10.0))
    assert slow.ratio_to(fast) == 10.0
    assert slow.median / fast.median == 15.0


def test_contenders_take_turns():
    order = []
    times = timing.race({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order[:2] == ["a", "b"]
    assert len(times["a"].rounds) == len(times["b"].rounds) == 2


def results_with(**figures):
    step = {"median_ms": figures.get("step_ms", 0.9), "min_ms": 0, "max_ms": 0}
    return {
        "all_nodes": [],
        "whole_step": [
            {"contender": "sonospline step", "landmarks": 300, "step": step},
            {"contender": "scipy RBFInterpolator", "landmarks": 300, "step": step, "ratio_to_ours": figures["scipy"]},
            {"contender": "KeOps float32", "landmarks": 300, "left_out": "pykeops is not installed"},
        ],
        "multilevel_against_direct": [],
        "incremental": [],
        "growth": [],
        "insertion_step": [{"face_drift": 1e-9}],
    }


@pytest.mark.parametrize(("ratio", "kept"), [(159.0, False), (160.0, True)])
def test_a_claim_is_judged_by_its_figure(ratio, kept):
    verdicts = {row["claim"]: row for row in promises.of_the_race(results_with(scipy=ratio))}
    assert verdicts["step at 53^3, n = 300: times faster than SciPy"]["kept"] is kept
    assert verdicts["step at 53^3, n = 300, in ms"]["kept"] is True
    assert verdicts["step at 53^3, n = 300: times faster than KeOps float32 with LAPACK fit"]["kept"] is None
    shown = promises.table_of_promises(list(verdicts.values()))
    assert ("MISSED" in shown) is not kept
    assert "not measured" in shown


@needs_core
@pytest.mark.slow
def test_the_quick_race_writes_tables_json_and_a_picture(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib", reason="needs the extra 'plot'")
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    for contender in contenders.PEERS:  # as on a machine without the peers
        if contender.module in ("torch", "pykeops", "itk"):
            monkeypatch.setattr(contender, "module", "surely_not_installed", raising=False)
    pinned = []
    monkeypatch.setattr("sonospline.bench.machine.pin", lambda threads: pinned.append(threads) or [0])
    arguments = ["bench", "--quick", "--rounds", "1", "--quiet", "--json", "--out", str(tmp_path / "out")]
    assert cli.main(arguments) == 0
    results = json.loads(capsys.readouterr().out)
    assert pinned == [2]
    withheld = results["machine"]["withheld"]
    assert withheld is None or 0 <= withheld <= 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["bench.json", "bench.md", "cost.png"]
    by_name = {row["contender"]: row for row in results["all_nodes"]}
    assert "not installed" in by_name["KeOps float32"]["left_out"]
    assert by_name["sonospline multilevel"]["error"] < 1e-5
    assert by_name["scipy RBFInterpolator"]["evaluate"]["median_ms"] > 0
    assert results["incremental"][0]["weights_error"] < 1e-10
    assert results["insertion_step"][1]["face_drift"] < 1e-6
    assert "surely_not_installed is not installed" in (tmp_path / "out" / "bench.md").read_text()


@needs_core
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--isa", "avx2048"], "--isa avx2048 cannot run here; give some of"),
        (["--isa", "baseline", "--live"], "--isa goes not with --live; leave one out"),
        (["--isa", "baseline", "--quick"], "--isa goes not with --quick; leave one out"),
    ],
)
def test_sets_that_cannot_race_are_refused_before_any_work(options, said, tmp_path, capsys):
    assert cli.main(["bench", *options, "--out", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_sets_are_compared_turn_by_turn_and_judged_each_by_its_own_promise(monkeypatch):
    part = "elastic step, 25^3, one thread"
    raced = {part: {"avx2": timing.Times((2.0, 8.0, 2.4)), "avx512": timing.Times((1.0, 2.0, 1.2))}}
    monkeypatch.setattr(instruction_sets, "_parts", lambda names, rounds, tell: raced)
    poses = {"avx2": timing.Times((15.0,)), "avx512": timing.Times((12.0,))}
    monkeypatch.setattr(instruction_sets, "_poses", lambda names, rounds, seconds: poses)
    results = instruction_sets.measure(("avx2", "avx512"), 3, 1.0, lambda line: None)
    assert results["isa"][0]["ratios"] == {"avx512": 0.5}
    kept = {row["claim"]: row["kept"] for row in results["claims"]}
    assert kept == {f"{part}, avx2, ms": True, f"{part}, avx512, ms": False, f"{instruction_sets.POSE}, avx2, ms": True}
    assert f"| {part} | 2.40 (2.00) | 1.20 (1.00) | 0.50 |" in instruction_sets.report(results)


@needs_core
@pytest.mark.slow
def test_each_set_runs_in_a_process_of_its_own(monkeypatch):
    """The runner checks that it got the set that it asked for."""
    part = "spline step, 53^3, one thread"
    monkeypatch.setattr(instruction_sets, "WORKLOADS", {part: None})
    names = tuple(dict.fromkeys(("baseline", _core.native.instruction_sets()[0])))
    raced = instruction_sets._parts(names, 1, lambda line: None)[part]
    assert set(raced) == set(names)
    assert all(len(times.rounds) == 1 and times.median > 0 for times in raced.values())


@needs_core
def test_a_process_that_ends_ends_the_race(monkeypatch):
    monkeypatch.setattr(instruction_sets.sys, "executable", "/bin/false")
    with pytest.raises(RuntimeError, match=r"a process of the race ended \(exit code 1\)"):
        instruction_sets._parts(("baseline",), 1, lambda line: None)


def test_the_race_needs_the_compiled_core(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(_core, "active", _core.twin)
    monkeypatch.setattr("sonospline.bench.machine.pin", lambda threads: [0])
    assert cli.main(["bench", "--out", str(tmp_path / "out")]) == 1
    assert "compiled core is not in use" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_time_the_host_withheld_is_its_part_of_all_ticks(monkeypatch):
    monkeypatch.setattr("sonospline.bench.machine.processor_ticks", lambda: (130, 1400))
    assert machine.withheld_since((100, 1000)) == pytest.approx(30 / 400)
    assert machine.withheld_since(None) is None
