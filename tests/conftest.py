"""Fixtures shared by all rooms: landmarks, tissue, and the two backends of the core."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from scipy.spatial.transform import Rotation

import sonospline as ss
from builds import needs_core
from sonospline import _core

# The machines are shared, so no deadline; the same examples in every run, so no surprise in CI.
settings.register_profile("sonospline", deadline=None, max_examples=25, derandomize=True, database=None)
settings.load_profile("sonospline")


@pytest.fixture(params=["numpy", pytest.param("core", marks=needs_core)])
def backend(request, monkeypatch):
    """Run the test on the NumPy twin, then on the compiled core."""
    monkeypatch.setattr(_core, "active", _core.twin if request.param == "numpy" else _core.native)
    return request.param


@pytest.fixture
def native():
    """The compiled core, left as it was found."""
    core = _core.native
    isa, threads = core.instruction_set(), core.thread_count()
    yield core
    core.use_instruction_set(isa)
    core.set_thread_count(threads)


@pytest.fixture
def rng():
    return np.random.default_rng(20260)


@pytest.fixture
def random_landmarks(rng):
    """(60, 3) landmarks in the unit cube."""
    return rng.random((60, 3))


@pytest.fixture
def random_values(rng):
    """(60, 3) displacements of a few per cent of the cube."""
    return 0.03 * rng.standard_normal((60, 3))


@pytest.fixture
def random_places(rng):
    """(200, 3) places in and a little around the unit cube."""
    return rng.uniform(-0.2, 1.2, (200, 3))


@pytest.fixture
def a_rotation():
    """(3, 3) proper rotation about no axis in particular."""
    return Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()


@pytest.fixture
def unit_tissue():
    return ss.Tissue(ss.Grid.unit_cube(13), entry_face="x-")


@pytest.fixture
def small_tissue():
    return ss.Tissue(ss.Grid.unit_cube(9), entry_face="x-")


@pytest.fixture
def a_tilted_grid(a_rotation):
    """A rotated, anisotropic grid of odd sizes, away from the origin."""
    return ss.Grid(shape=(9, 7, 11), spacing=(1.5, 2.0, 0.9), origin=(-30, 12, 7), direction=a_rotation)


@pytest.fixture
def an_oblique_needle():
    """A needle whose coordinates tie with no node, so that rounding decides nothing."""
    return ss.Needle(entry=(0, 0.413, 0.578), tip=(0.617, 0.531, 0.469))


@pytest.fixture
def a_deformed_field(unit_tissue, an_oblique_needle):
    """The field of one insertion into the unit cube."""
    return ss.Insertion(unit_tissue).advance(an_oblique_needle)


@pytest.fixture
def an_analytic_history():
    """Stands in for the finite elements: a drag that fades from the axis, the tip and the pinned faces."""

    def history(tissue, entry, target, steps=20, **options):
        whole = ss.Needle(entry, target)
        at_depth = []
        for k in range(1, steps + 1):
            seen = whole.project(tissue.grid.points)
            depth = whole.depth * k / steps
            size = 0.03 * np.exp(-(seen.distance**2) / 0.03) / (1 + np.exp((seen.along - depth) / 0.05))
            moved = size[:, None] * whole.direction
            moved[tissue.pinned.ravel()] = 0
            at_depth.append(moved.reshape(*tissue.grid.shape, 3))
        return np.array(at_depth)

    return history


@pytest.fixture(scope="session")
def shared_data():
    """The folder of real data beside the project (or ``SONOSPLINE_SHARED_DATA``)."""
    folder = Path(os.environ.get("SONOSPLINE_SHARED_DATA") or Path(__file__).parents[2] / "shared" / "data")
    if not folder.is_dir():
        pytest.skip("the shared real data are not here")
    return folder


@pytest.fixture(scope="module")
def running():
    """A server of the simulator; skips where websockets is not installed."""
    from simulator_client import Running

    server = Running(sessions=9)
    yield server
    server.stop()


@pytest.fixture
def page(running):
    """A client of it that was told the scene."""
    from simulator_client import Client

    with Client(running) as client:
        yield client.ready()
