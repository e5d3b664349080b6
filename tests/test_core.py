"""The compiled core against its NumPy twin, function by function."""

import os
import subprocess
import sys

import numpy as np
import pytest

from builds import INSTRUCTION_SETS, needs_core
from sonospline import _core
from sonospline._core import twin

KERNELS = {"biharmonic": 0, "triharmonic": 1}


@pytest.fixture(params=KERNELS.values(), ids=KERNELS.keys())
def kernel(request):
    return request.param


def a_sum(points, centres):
    """Random points, centres, weights and affine part; sums of the order of one."""
    rng = np.random.default_rng(1000 * points + centres)
    return (
        rng.random((points, 3)),
        rng.random((centres, 3)),
        rng.standard_normal((centres, 3)) / max(1, centres),
        rng.standard_normal((4, 3)),
    )


# 64 is the tile of the core: below, at, just past and far past it, and nothing at all.
SIZES = [(1, 1), (1, 40), (63, 7), (64, 64), (65, 1), (200, 131), (130, 0), (0, 5)]


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize(("points", "centres"), SIZES)
def test_sums_at_points_agree_with_the_twin(native, isa, kernel, points, centres):
    native.use_instruction_set(isa)
    problem = a_sum(points, centres)
    expected = twin.sum_at_points_f64(kernel, *problem)
    double, single = native.sum_at_points_f64(kernel, *problem), native.sum_at_points_f32(kernel, *problem)
    assert (double.dtype, single.dtype) == (np.float64, np.float32)
    np.testing.assert_allclose(double, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(single, expected, rtol=0, atol=1e-6 * max(1, np.abs(expected).max(initial=0)))


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize("shape", [(2, 2, 2), (1, 1, 1), (3, 5, 7), (4, 4, 4), (2, 3, 70), (70, 2, 3)], ids=str)
@pytest.mark.parametrize("centres", [0, 1, 53])
def test_sums_on_a_lattice_agree_with_the_twin(native, isa, kernel, shape, centres):
    native.use_instruction_set(isa)
    lattice = (shape, tuple(1 / n for n in shape))
    problem = a_sum(0, centres)[1:]
    expected = twin.sum_on_lattice_f64(kernel, *lattice, *problem)
    double = native.sum_on_lattice_f64(kernel, *lattice, *problem)
    single = native.sum_on_lattice_f32(kernel, *lattice, *problem)
    assert double.shape == single.shape == (*shape, 3)
    np.testing.assert_allclose(double, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(single, expected, rtol=0, atol=1e-6 * max(1, np.abs(expected).max()))


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize(("points", "centres"), SIZES)
def test_gradients_agree_with_the_twin(native, isa, kernel, points, centres):
    native.use_instruction_set(isa)
    problem = a_sum(points, centres)
    np.testing.assert_allclose(
        native.gradient_at_points(kernel, *problem),
        twin.gradient_at_points(kernel, *problem),
        rtol=0,
        atol=1e-12,
    )


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
@pytest.mark.parametrize(("points", "centres"), SIZES)
def test_kernel_matrices_agree_with_the_twin(native, isa, kernel, points, centres):
    native.use_instruction_set(isa)
    at, of = a_sum(points, centres)[:2]
    matrix = native.kernel_matrix(kernel, at, of)
    assert matrix.shape == (points, centres)
    np.testing.assert_allclose(matrix, twin.kernel_matrix(kernel, at, of), rtol=0, atol=1e-12)


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_single_precision_sum_of_the_twin_agrees_too(native, isa, kernel):
    native.use_instruction_set(isa)
    problem = a_sum(150, 90)
    np.testing.assert_allclose(
        native.sum_at_points_f32(kernel, *problem), twin.sum_at_points_f32(kernel, *problem), rtol=0, atol=3e-6
    )


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_nothing_breaks_down_on_a_centre_itself(native, isa, kernel):
    """r = 0 is where 1 / r, and so a fast square root, goes wrong."""
    native.use_instruction_set(isa)
    centres = a_sum(0, 20)[1]
    weights, affine = np.ones((20, 3)), np.zeros((4, 3))
    assert (np.diag(native.kernel_matrix(kernel, centres, centres)) == 0).all()
    for name in ("sum_at_points_f64", "gradient_at_points"):
        ours, theirs = (getattr(m, name)(kernel, centres, centres, weights, affine) for m in (native, twin))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


@pytest.mark.usefixtures("backend")
def test_sum_and_gradient_by_hand():
    """One centre at distance 5: u = a0 + x A + w U(5), grad u = w U'(5) (3, 4, 0) / 5."""
    point, centre = np.array([[4.0, 5.0, 1.0]]), np.array([[1.0, 1.0, 1.0]])
    weight, affine = np.array([[1.0, 2.0, -1.0]]), np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0]])
    core = _core.active
    affine_part = np.array([1.0 + 2.0, 4.0, 5.0])  # a0 + 4 (0,1,0) + 5 (0,0,1) + 1 (2,0,0)
    for kernel, value, slope in ((0, 5.0, 1.0), (1, 125.0, 75.0)):
        u = core.sum_at_points_f64(kernel, point, centre, weight, affine)
        np.testing.assert_allclose(u, [affine_part + value * weight[0]], rtol=1e-14)
        expected = slope * np.outer(weight[0], [0.6, 0.8, 0.0]) + [[0, 0, 2], [1, 0, 0], [0, 1, 0]]
        gradient = core.gradient_at_points(kernel, point, centre, weight, affine)
        np.testing.assert_allclose(gradient, [expected], rtol=1e-14)


@pytest.mark.usefixtures("backend")
def test_lattice_runs_z_fastest_and_starts_at_zero():
    no_centres, no_weights = np.empty((0, 3)), np.empty((0, 3))
    identity = np.vstack([np.zeros(3), np.eye(3)])
    u = _core.active.sum_on_lattice_f64(0, (2, 3, 4), (1.0, 10.0, 100.0), no_centres, no_weights, identity)
    assert u[0, 0, 0].tolist() == [0, 0, 0]
    assert u[1, 2, 3].tolist() == [1, 20, 300]
    assert u.reshape(-1, 3)[1].tolist() == [0, 0, 100]


@needs_core
@pytest.mark.parametrize("function", ["sum_at_points_f32", "sum_at_points_f64", "gradient_at_points"])
def test_threads_do_not_change_a_bit(native, kernel, function):
    # 4,001 x 131 pairs: enough for the core to split the work, and no multiple of a tile.
    problem = a_sum(4001, 131)
    results = []
    for threads in (1, 2, 3):
        native.set_thread_count(threads)
        assert native.thread_count() == threads
        results.append(getattr(native, function)(kernel, *problem))
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


@needs_core
def test_threads_do_not_change_a_bit_of_a_lattice_or_a_matrix(native, kernel):
    points, centres, weights, affine = a_sum(1201, 401)
    results = []
    for threads in (1, 2):
        native.set_thread_count(threads)
        lattice = native.sum_on_lattice_f64(kernel, (11, 13, 17), (0.1, 0.1, 0.1), centres, weights, affine)
        results.append((lattice, native.kernel_matrix(kernel, points, centres)))
    assert np.array_equal(results[0][0], results[1][0])
    assert np.array_equal(results[0][1], results[1][1])


@needs_core
def test_unknown_instruction_set_is_refused_by_name(native):
    with pytest.raises(ValueError, match="'sse9'"):
        native.use_instruction_set("sse9")
    assert native.instruction_set() in native.instruction_sets()


@needs_core
def test_weights_that_do_not_match_the_centres_are_refused(native):
    points, centres, weights, affine = a_sum(5, 4)
    with pytest.raises(ValueError, match="differ in length"):
        native.sum_at_points_f64(0, points, centres, weights[:3], affine)


def run_python(code, **environment):
    clean = {name: value for name, value in os.environ.items() if not name.startswith("SONOSPLINE_")}
    return subprocess.run(
        [sys.executable, "-c", code], env=clean | environment, capture_output=True, text=True, check=False
    )


SHOW = "from sonospline import _core; print(_core.backend(), _core.instruction_set())"


def test_environment_can_demand_the_twin():
    assert run_python(SHOW, SONOSPLINE_BACKEND="numpy").stdout.split() == ["numpy", "numpy"]


@needs_core
def test_core_is_the_default_with_its_best_instruction_set():
    assert run_python(SHOW).stdout.split() == ["core", INSTRUCTION_SETS[0]]


@needs_core
def test_environment_chooses_instruction_set_and_threads():
    code = f"{SHOW}; print(_core.native.thread_count())"
    seen = run_python(code, SONOSPLINE_BACKEND="core", SONOSPLINE_ISA="baseline", SONOSPLINE_THREADS="3")
    assert seen.stdout.split() == ["core", "baseline", "3"]


def test_unknown_backend_is_refused_by_name_with_the_choices():
    refusal = "SONOSPLINE_BACKEND='gpu' is not known; use 'core' or 'numpy'"
    failed = run_python("from sonospline import Insertion", SONOSPLINE_BACKEND="gpu")
    assert failed.returncode != 0
    assert refusal in failed.stderr
    failed = run_python(
        "import sys; from sonospline.cli import main; sys.exit(main(['doctor']))", SONOSPLINE_BACKEND="gpu"
    )
    assert (failed.returncode, failed.stderr) == (1, f"sonospline: {refusal}\n")


def test_demanding_a_core_that_is_not_built_is_refused(monkeypatch):
    monkeypatch.setattr(_core, "native", None)
    with pytest.raises(ImportError, match=r"SONOSPLINE_BACKEND='core'.*not installed.*'numpy'"):
        _core._choose("core")
    assert _core._choose("") is twin


@needs_core
@pytest.mark.parametrize("threads", ["0", "-1", "two", "1025", "9" * 5000])
def test_a_number_of_threads_that_is_none_is_refused(threads):
    seen = run_python(SHOW, SONOSPLINE_THREADS=threads)
    assert seen.returncode != 0
    assert "use 1 to 1024" in seen.stderr


@needs_core
def test_unknown_instruction_set_in_the_environment_is_refused():
    seen = run_python(SHOW, SONOSPLINE_ISA="sse9")
    assert seen.returncode != 0
    assert "sse9" in seen.stderr


@needs_core
@pytest.mark.parametrize("isa", INSTRUCTION_SETS)
def test_a_sum_of_kelvinlets_agrees_with_the_twin(native, rng, isa):
    native.use_instruction_set(isa)
    centres, forces = rng.random((70, 3)), rng.standard_normal((70, 3))
    points = np.concatenate([rng.random((333, 3)), centres[:5]])
    ours, theirs = (core.kelvinlet_sum(points, centres, forces, 0.07, 0.41) for core in (native, twin))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())
