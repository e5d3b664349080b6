"""Metrics of attempts: by hand on analytic paths, whatever the sampling, and as PerkTutor's own scripts have them."""

import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import perk_oracle
import sonospline as ss
from sonospline.training import METRICS, Task, ToolMotion, Trace, log_dimensionless_jerk, measure, spectral_arc_length

NAN = np.full(3, np.nan)
Z = np.array([0.0, 0.0, 1.0])


def of_depths(depths, rate=20.0, **more):
    """A needle from the origin along z; out of the tissue where a depth is NaN."""
    depths = np.asarray(depths, float)
    entry = np.where(np.isnan(depths)[:, None], NAN, 0.0)
    given = {"time_s": np.arange(len(depths)) / rate, "entry": entry, "tip": entry + depths[:, None] * Z}
    return Trace.of_needle(**given, **({"target": (0, 0, 50)} | more))


def way(*depths, step=0.5):
    """From depth to depth in steps, without the first."""
    return np.concatenate([np.linspace(a, b, round(abs(b - a) / step) + 1)[1:] for a, b in pairwise(depths)])


def test_a_straight_needle_by_hand():
    found = measure(of_depths(way(0, 40), target=(3, 4, 46)))
    assert found["passes"] == 1
    assert found["needle_path_mm"] == pytest.approx(40, abs=1e-9)  # the first step, from the skin, counts
    assert found["needle_path_economy_percent"] == pytest.approx(100, abs=1e-9)
    assert found["final_error_along_mm"] == pytest.approx(6, abs=1e-9)
    assert found["final_error_across_mm"] == pytest.approx(5, abs=1e-9)
    assert found["final_error_mm"] == pytest.approx(np.sqrt(61), abs=1e-9)
    assert found["time_s"] == pytest.approx(79 / 20)
    assert found["insertion_time_s"] == pytest.approx(79 / 20)
    assert found["redirections"] == found["blind_advance_mm"] == found["tissue_swept_mm2"] == 0
    assert found["tip_in_plane_percent"] == 100
    assert np.isnan(found["peak_force_n"]) and np.isnan(found["papillary_angle_deg"])


@pytest.mark.parametrize("shift", [0.0, 300.0])
@pytest.mark.parametrize("count", [2, 3, 11])
def test_a_needle_that_goes_on_evenly_has_no_jerk_to_measure(count, shift):
    depths = shift + np.linspace(5, 15, count)
    found = measure(of_depths(depths, rate=10 * (count - 1)))
    assert np.isnan(found["needle_log_dimensionless_jerk"])
    assert np.isfinite(found["needle_spectral_arc_length"])
    still = measure(of_depths(np.full(count, shift + 0.1), rate=10))
    assert np.isnan([still["needle_log_dimensionless_jerk"], still["needle_spectral_arc_length"]]).all()


@given(
    st.lists(st.sampled_from([np.nan, 0.0, 1e-12, 5.0, 5.5, 6.0, 40.0]) | st.floats(0, 50), min_size=2, max_size=12),
    st.sampled_from([0.2, 1.0, 20.0, 60.0]),
)
def test_no_short_or_odd_motion_has_an_infinite_metric(depths, rate):
    """Of a slow machine, whose frames are few, too: floating-point errors are exceptions here."""
    assert not np.isinf(list(measure(of_depths(depths, rate)).values())).any()


def test_a_zigzag_by_hand():
    """30 in, 10 back, on to 40, 4 back (too little to count), on to 45, 6 back: one redirection."""
    found = measure(of_depths(way(0, 30, 20, 40, 36, 45, 39)))
    assert found["redirections"] == 1
    assert found["needle_path_mm"] == pytest.approx(30 + 10 + 20 + 4 + 9 + 6)
    assert found["needle_path_economy_percent"] == pytest.approx(100 * 39 / 79)
    assert found["needle_path_inefficiency_percent"] == pytest.approx(100 * (78.5 / 38.5 - 1))  # from the first sample


def test_two_passes_by_hand():
    out = [np.nan] * 5
    trace = of_depths([*out, *way(0, 30, 0.5), *out, *way(0, 20)])
    found = measure(trace)
    assert found["passes"] == 2
    assert found["time_to_skin_s"] == pytest.approx(5 / 20)
    assert found["needle_path_mm"] == pytest.approx(30 + 29.5 + 20)
    assert found["insertion_time_s"] == pytest.approx((119 + 39) / 20)  # the last sample stands for no time
    assert repr(trace) == f"Trace({10 + 119 + 40} samples, 8.4 s, 2 passes)"


def test_blind_advance_by_hand():
    """Out of plane from 10 to 25 mm; pulling back blind counts nothing."""
    depths = way(0, 40, 15, 30)
    away = np.where((depths > 10) & (depths <= 25), 3.0, 0.5)
    found = measure(of_depths(depths, out_of_plane=away, half_slice=2.0))
    assert found["blind_advance_mm"] == pytest.approx(15 + 10)
    assert found["blind_advance_percent"] == pytest.approx(100 * 25 / 55)
    shown = (np.abs(away) <= 2)[:-1].mean()
    assert found["tip_in_plane_percent"] == pytest.approx(100 * shown)


@pytest.mark.parametrize("count", [90, 900])
def test_a_needle_turned_in_tissue_sweeps_a_sector(count):
    angles = np.radians(np.linspace(0, 30, count))
    tip = 40 * np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    trace = Trace.of_needle(time_s=np.arange(count) / 30, entry=(0, 0, 0), tip=tip, target=(0, 0, 50))
    found = measure(trace, Task(axis=(1, 0, 0)))
    chords = (count - 1) * 2 * np.sin((angles[1] - angles[0]) / 2)
    assert found["tissue_swept_mm2"] == pytest.approx(0.5 * 40**2 * chords, rel=1e-9)
    assert found["tissue_swept_mm2"] == pytest.approx(0.5 * 40**2 * np.radians(30), rel=1e-4)
    assert found["papillary_angle_deg"] == pytest.approx(60, abs=1e-9)


def test_a_target_that_moves_is_what_the_error_is_about():
    depths = way(0, 40)
    target = np.array([0, 0, 40.0]) + np.linspace(0, 1, 80)[:, None] * [3.0, 0, 4.0]
    found = measure(of_depths(depths, target=target))
    assert found["target_motion_mm"] == pytest.approx(5)
    assert found["final_error_along_mm"] == pytest.approx(4)
    assert found["final_error_across_mm"] == pytest.approx(3)


def test_structures_by_hand():
    depths = way(0, 40, 20, 30)
    structures = ["colon" if 10 < d <= 14 else "calyx" if 24.75 < d < 35 else "fat" for d in depths]
    found = measure(of_depths(depths, structures=structures), Task(forbidden=("col*",), target_in=("calyx",)))
    assert found["structures_hit"] == 1
    assert found["structures_hit_mm"] == pytest.approx(4)
    assert found["back_wall_perforations"] == 1  # pulled back through it, which is none, and into it again


def test_forces_by_hand():
    force = np.array([np.nan, 1.0, 3.0, -5.0, 9.0])
    trace = Trace.of_needle(
        time_s=[0, 1, 2, 4, 5], entry=(0, 0, 0), tip=np.arange(1, 6)[:, None] * Z, target=(0, 0, 9), axial_n=force
    )
    found = measure(trace)
    assert found["peak_force_n"] == 9
    assert found["mean_force_n"] == pytest.approx((1 * 1 + 3 * 2 + 5 * 1) / 4)


RATE_FREE = {
    "passes", "redirections", "needle_path_mm", "needle_path_economy_percent", "final_error_mm", "target_motion_mm",
    "time_to_skin_s", "time_s", "tissue_swept_mm2", "probe_path_mm", "probe_turning_deg",
}  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), finer=st.integers(2, 5))
def test_metrics_without_a_rate_do_not_depend_on_it(seed, finer):
    """Samples between samples, where everything moves evenly."""
    rng = np.random.default_rng(seed)
    corners = np.array([0.5, *rng.uniform(5, 60, 4)])
    at = np.linspace(0, 4, 4 * finer + 1)
    coarse, fine = (of_depths(np.interp(t, np.arange(5), corners), rate=r) for t, r in ((np.arange(5), 1), (at, finer)))
    a, b = measure(coarse), measure(fine)
    for name in RATE_FREE:
        assert a[name] == pytest.approx(b[name], rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("name", METRICS)
def test_the_page_has_every_metric_with_its_definition(name):
    metric = METRICS[name]
    page = (Path(__file__).parents[1] / "docs" / "training.md").read_text()
    assert f"| `{name}` | {metric.unit or '-'} | {metric.better} | {metric.definition} | {metric.source} |" in page
    assert metric.definition.endswith((".", ")"))
    assert metric.unit == "" or any(
        part in name for part in (metric.unit.split("/")[0].replace("^", "").lower(), "percent")
    )


def test_a_trace_is_a_value_and_its_metrics_survive_a_pickle():
    trace = of_depths(way(0, 20, 10, 30))
    copy = pickle.loads(pickle.dumps(trace))
    assert copy == trace and hash(copy) == hash(trace)
    assert measure(copy) == pytest.approx(measure(trace), nan_ok=True, abs=0, rel=0)
    assert not trace.tip.flags.writeable


def test_frames_of_a_session_become_a_trace():
    session = ss.Session("gel", model="kelvinlet")
    entry, vessel = np.array([26.0, 30.0, 0.0]), session.scene.targets["vessel"]
    frames = [session.step()]
    for share in (0.3, 0.6, 1.0):
        frames.append(session.step(needles={"needle": ss.Needle(entry, entry + share * (vessel - entry))}))
    trace = Trace.of_frames(np.arange(4) / 10, frames, session.scene)
    found = measure(trace)
    assert found["passes"] == 1
    assert found["needle_path_mm"] == pytest.approx(np.linalg.norm(vessel - entry), rel=1e-9)
    assert found["final_error_mm"] == pytest.approx(frames[-1].readouts.tip_to_target, rel=1e-9)
    assert found["target_motion_mm"] == pytest.approx(max(frame.readouts.moved for frame in frames))
    assert trace.structures[0] == "" and trace.depth_mm[-1] == pytest.approx(frames[-1].readouts.depth)


def poses_of(rng, count):
    """A hand that wanders and turns, with rests."""
    moving = np.repeat(rng.integers(0, 2, 1 + count // 12), 12)[:count, None]
    places = np.cumsum(moving * rng.normal(0, 4, (count, 3)), axis=0) + rng.normal(0, 50, 3)
    turns = Rotation.from_rotvec(np.cumsum(moving * rng.normal(0, 0.06, (count, 3)), axis=0))
    poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    poses[:, :3, :3], poses[:, :3, 3] = turns.as_matrix(), places
    return np.cumsum(rng.uniform(0.01, 0.05, count)), poses


PERK = {
    "PathInefficiency": "path_inefficiency_percent",
    "AverageVelocity": "average_velocity_mm_s",
    "MotionSmoothness": "motion_smoothness_mm_s3",
    "TranslationalActions": "translational_actions",
    "RotationalActions": "rotational_actions",
    "RotationTotal": "rotation_total_deg",
}


FOUND_BY_PERK_TUTOR = {
    "PathInefficiency": 127.13459207391229,
    "AverageVelocity": 82.94432227606866,
    "MotionSmoothness": 23942.75923588915,
    "TranslationalActions": 2,
    "RotationalActions": 2,
    "RotationTotal": 533.2499179564777,
}
"""What its scripts made of :func:`winding`."""


def winding():
    """Poses along a way that turns, sampled unevenly."""
    k = np.arange(120)
    turns = np.stack([0.9 * np.sin(0.1 * k), 0.6 * np.cos(0.13 * k), 0.01 * k], axis=1)
    poses = np.broadcast_to(np.eye(4), (120, 4, 4)).copy()
    poses[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    poses[:, :3, 3] = np.stack([40 * np.sin(0.09 * k), 25 * np.cos(0.05 * k), 2.0 * k * np.sin(0.02 * k)], axis=1)
    return 0.04 * k + 0.01 * np.sin(k), poses


@pytest.mark.parametrize("name", PERK)
def test_of_one_way_perk_tutors_scripts_found_the_same(name):
    assert getattr(ToolMotion(*winding()), PERK[name]) == pytest.approx(FOUND_BY_PERK_TUTOR[name], rel=1e-9)


@pytest.mark.parametrize("name", PERK)
def test_perk_tutors_scripts_find_the_same(name):
    """On 200 wandering hands."""
    perk_oracle.scripts()
    rng = np.random.default_rng(0)
    for _ in range(200):
        times, poses = poses_of(rng, int(rng.integers(4, 200)))
        if (poses[0] == poses[-1]).all():
            continue  # no straight line, by which theirs divides
        ours = getattr(ToolMotion(times, poses), PERK[name])
        assert ours == pytest.approx(perk_oracle.metric(name, times, poses), rel=1e-9, abs=1e-9)


def test_a_tools_motion_by_hand():
    """60 mm/s for half a second, a rest, 120 degrees a second for a quarter: one action of each kind."""
    times = np.arange(0, 2.01, 0.01)
    x = 60 * np.clip(times - 0.5, 0, 0.5)
    angle = np.radians(120 * np.clip(times - 1.5, 0, 0.25))
    poses = np.broadcast_to(np.eye(4), (len(times), 4, 4)).copy()
    poses[:, :3, :3] = Rotation.from_rotvec(angle[:, None] * Z).as_matrix()
    poses[:, 0, 3] = x
    motion = ToolMotion(times, poses)
    assert (motion.rotational_actions, motion.path_length_mm) == (1, pytest.approx(30))
    assert motion.rotation_total_deg == pytest.approx(30)
    assert motion.hand_movements == 2
    assert motion.average_velocity_mm_s == pytest.approx(15)


@pytest.mark.parametrize("measure_of", [spectral_arc_length, log_dimensionless_jerk])
def test_smoothness_does_not_depend_on_rate_length_or_duration(measure_of):
    def reach(rate, seconds, mm):
        t = np.arange(0, seconds + 1e-9, 1 / rate)
        s = t / seconds
        return t, mm * (10 * s**3 - 15 * s**4 + 6 * s**5)

    one = measure_of(*reach(200, 4, 10))
    assert measure_of(*reach(1000, 4, 10)) == pytest.approx(one, rel=0.01)
    assert measure_of(*reach(200, 4, 70)) == pytest.approx(one, rel=1e-6)
    assert measure_of(*reach(200, 8, 10)) == pytest.approx(one, rel=0.02)
    assert np.isnan(measure_of([0, 1, 2], [5, 5, 5]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"time_s": [0, 1, 1]}, r"^time_s = 1 of sample 2 is not later"),
        ({"time_s": [0, np.nan, 1]}, "^time_s contains NaN"),
        ({"time_s": [0], "entry": NAN, "tip": NAN, "structures": [""]}, "^time_s has 1 samples"),
        ({"tip": [[0, 0, 1], [0, 0, 2]]}, "shape"),
        ({"entry": [NAN, [0, 0, 0], [0, 0, 0]]}, "^entry and tip of sample 0: only one is known"),
        ({"target": [np.inf, 0, 0]}, "^target contains NaN"),
        ({"structures": ["fat"]}, "^structures has 1 names for 3 samples"),
        ({"axial_n": "a lot"}, "not numeric|dtype"),
    ],
)
def test_bad_traces_are_one_line(change, said):
    good = {"time_s": [0, 1, 2], "entry": np.zeros((3, 3)), "tip": np.arange(3)[:, None] * Z, "target": (0, 0, 9)}
    with pytest.raises(ValueError, match=said) as error:
        Trace.of_needle(**good | change)
    assert "\n" not in str(error.value)


def test_bad_motions_are_one_line():
    with pytest.raises(ValueError, match=r"^time_s does not grow"):
        ToolMotion([0, 0], np.zeros((2, 4, 4)))
    with pytest.raises(ValueError, match=r"^poses has shape"):
        ToolMotion([0, 1], np.zeros((3, 4, 4)))
    with pytest.raises(ValueError, match=r"^time_s = "):
        spectral_arc_length([1, 0], [0, 0])
