"""Every face node pinned: the symmetric blocks against a dense solve, and the cache on disk."""

import numpy as np
import pytest

import sonospline as ss
from sonospline import _memory
from sonospline.models.spline import faces

TILT = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]


@pytest.fixture(autouse=True)
def a_cache_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def insert_into(tissue, **options):
    grid = tissue.grid
    entry, tip = grid.world(grid.extent * np.array([[0.1, 0.45, 0.4], [0.6, 0.55, 0.5]]))
    insertion = ss.Insertion(tissue, **options)
    return insertion, insertion.advance(ss.Needle(entry, tip))


@pytest.mark.parametrize("entry_face", ss.FACES)
@pytest.mark.parametrize("shape", [(7, 8, 9), (6, 5, 10)], ids=str)
def test_it_is_the_spline_through_every_face_node(backend, entry_face, shape):
    grid = ss.Grid(shape=shape, spacing=(1.5, 1.0, 1.2), origin=(40, -20, 7), direction=TILT)
    tissue = ss.Tissue(grid, entry_face=entry_face)
    insertion, field = insert_into(tissue, anchors="all")
    assert len(insertion.anchors) == tissue.pinned.sum()
    assert insertion.landmark_count > 5
    values = np.zeros_like(field.centres)
    values[len(insertion.anchors) :] = insertion.plan.history.at(insertion.needle.depth, insertion.landmark_count)
    dense = ss.PolyharmonicSpline.fit(field.centres, values, grid=grid)
    assert np.allclose(field.on_grid("direct"), dense.on_grid("direct"), rtol=0, atol=1e-10 * np.abs(values).max())
    assert np.allclose(field.weights, dense.weights, rtol=0, atol=1e-9 * np.abs(dense.weights).max())


@pytest.mark.parametrize("options", [{"kernel": ss.Triharmonic()}, {"smoothing": 1e-3}], ids=["r^3", "smoothing"])
def test_other_kernels_and_smoothing(options):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    insertion, field = insert_into(tissue, anchors="all", **options)
    values = np.zeros_like(field.centres)
    values[len(insertion.anchors) :] = insertion.plan.history.at(insertion.needle.depth, insertion.landmark_count)
    dense = ss.PolyharmonicSpline.fit(field.centres, values, grid=tissue.grid, **options)
    assert np.allclose(field.on_grid("direct"), dense.on_grid("direct"), rtol=0, atol=1e-8 * np.abs(values).max())


def test_the_faces_stay_where_sampled_anchors_let_them_drift():
    tissue = ss.Tissue(ss.Grid.unit_cube(17))
    _, pinned = insert_into(tissue, anchors="all")
    _, sampled = insert_into(tissue, anchors=5)
    assert tissue.boundary_drift(pinned.on_grid("direct")) < 1e-12
    assert tissue.boundary_drift(sampled.on_grid("direct")) > 1e-4


def test_pulling_back_and_another_axis(backend):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    moving = ss.Insertion(tissue, anchors="all")
    for entry, tip in [
        ((0, 0.4, 0.5), (0.7, 0.5, 0.5)),
        ((0, 0.4, 0.5), (0.35, 0.45, 0.5)),
        ((0, 0.6, 0.5), (0.5, 0.5, 0.5)),
    ]:
        needle = ss.Needle(entry, tip)
        fresh = ss.Insertion(tissue, anchors="all").advance(needle)
        assert np.allclose(moving.advance(needle).on_grid("direct"), fresh.on_grid("direct"), rtol=0, atol=1e-13)


def test_the_set_up_is_told_and_kept_on_disk(a_cache_of_its_own, monkeypatch):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    reported = []
    _, first = insert_into(tissue, anchors="all", progress=lambda done, of: reported.append((done, of)))
    assert reported == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    assert len(list(a_cache_of_its_own.glob("faces-*/block?.npy"))) == 4

    def refuse(*_):
        raise AssertionError("factored although it was on disk")

    monkeypatch.setattr(faces._Block, "factor", refuse)
    _, second = insert_into(tissue, anchors="all")
    assert np.array_equal(first.weights, second.weights)
    # the same cube in millimetres has the same factor
    insert_into(ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=12.5)), anchors="all")
    with pytest.raises(AssertionError, match="factored although"):
        insert_into(ss.Tissue(ss.Grid.unit_cube(10)), anchors="all")


@pytest.mark.parametrize("spoil", [lambda p: p.write_bytes(b""), lambda p: p.write_bytes(p.read_bytes()[:-8])])
def test_a_spoilt_cache_is_made_anew(a_cache_of_its_own, spoil):
    tissue = ss.Tissue(ss.Grid.unit_cube(9))
    _, first = insert_into(tissue, anchors="all")
    for block in a_cache_of_its_own.glob("faces-*/block*.npy"):
        spoil(block)
    _, second = insert_into(tissue, anchors="all")
    assert np.array_equal(first.weights, second.weights)


def test_a_cache_that_cannot_be_written_is_only_a_warning(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path / "file"))
    insert_into(ss.Tissue(ss.Grid.unit_cube(9)), anchors="all")
    assert "cannot keep the factored faces" in caplog.text


def test_faces_too_many_for_the_memory_are_refused_with_the_bytes(monkeypatch):
    monkeypatch.setattr(_memory, "available_bytes", lambda: 1_000_000)
    monkeypatch.setattr(_memory, "_NEVER_REFUSED", 0)
    with pytest.raises(ValueError, match=r"anchors = 'all' with 1,844 face nodes would take [\d,]+ bytes.*coarser"):
        ss.Insertion(ss.Tissue(ss.Grid.unit_cube(20)), anchors="all")


def test_the_moving_mesh_cannot_pin_every_node():
    with pytest.raises(ValueError, match=r"anchors = 'all' needs accumulation='maximum'"):
        ss.Insertion(ss.Tissue(ss.Grid.unit_cube(9)), anchors="all", accumulation="incremental")


def test_faces_whose_matrix_is_singular_to_rounding_are_refused():
    tissue = ss.Tissue(ss.Grid(shape=(9, 9, 9), spacing=(1, 1, 1e-3)))
    with pytest.raises(ValueError, match=r"anchors = 'all': .* singular to rounding; set smoothing above zero, or"):
        ss.PolyharmonicSpline.pinning_faces(tissue, kernel=ss.Triharmonic())
    ss.PolyharmonicSpline.pinning_faces(tissue)  # U = r bears it
