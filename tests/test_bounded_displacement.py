"""No pose moves tissue further than the needle could drag it, in any model: faces, edges, corners, a hair deep."""

import warnings

import numpy as np
import pytest

import sonospline as ss
from poses import BOXES, poses
from sonospline.mechanics import Material
from sonospline.models.elastic import ElasticInsertion
from sonospline.models.kelvinlet.drag import DRAG


def box(name, face="x-", spacing=1.0):
    return ss.Tissue(ss.Grid(shape=BOXES[name], spacing=spacing), face)


def largest(values):
    return float(np.linalg.norm(values, axis=-1).max())


def kelvinlet_overshoot(rng, tissue, count, **settings):
    """Largest displacement over the drag, at random poses; a warning of an ill-conditioned system is an error."""
    insertion = ss.KelvinletInsertion(tissue, **settings)
    anywhere = tissue.grid.world(rng.random((3000, 3)) * tissue.grid.extent)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fields = [insertion.solve(needle) for needle in poses(rng, tissue, count)]
    moved = [largest(field.displacement(np.concatenate([field.centres, anywhere]))) for field in fields]
    return max(moved) / insertion.model.drag


@pytest.mark.parametrize("name", ["cube", "plate", "coarse"])
def test_a_kelvinlet_moves_nothing_further_than_the_drag(rng, name):
    assert 0.5 < kelvinlet_overshoot(rng, box(name), 10) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "face", "spacing"),
    [(name, face, (1e-3, 1.0, 40.0)[k % 3]) for name in BOXES for k, face in enumerate(ss.FACES)],
)
def test_a_kelvinlet_moves_nothing_further_than_the_drag_in_any_box(rng, name, face, spacing):
    assert 0.5 < kelvinlet_overshoot(rng, box(name, face, spacing), 25) < 1.2


@pytest.mark.parametrize("width", [0.1, 0.4, 1.0])
def test_a_wide_kernel_does_not_fight_the_anchors(rng, width):
    """Their forces grow a million times where a kernel is wider than the place where tissue may follow."""
    tissue = box("coarse")
    kernel = ss.Kelvinlet(0.45, width * tissue.grid.side)
    model = ss.DragModel(drag=0.05, spacing=0.02 * tissue.grid.side, kernel=kernel)
    assert kelvinlet_overshoot(rng, tissue, 15, model=model) < 1.5


@pytest.mark.parametrize("count", [20, pytest.param(1000, marks=pytest.mark.slow)])
def test_the_papers_spline_moves_nothing_further_than_its_landmarks(rng, count):
    tissue = box("cube")
    insertion = ss.Insertion(tissue)
    wanted = np.hypot(insertion.model.tip_displacement, insertion.model.shaft_pull)
    assert max(largest(insertion.advance(needle).on_grid()) for needle in poses(rng, tissue, count)) < 1.05 * wanted


@pytest.mark.parametrize("count", [10, pytest.param(300, marks=pytest.mark.slow)])
def test_elastic_tissue_moves_no_further_than_in_the_middle_of_its_free_face(rng, count):
    """Pinned faces take up force: near to them the same force moves tissue less."""
    tissue = box("cube")
    insertion = ElasticInsertion(tissue, Material(), nodes=9**3)
    middle, side = tissue.grid.extent / 2, tissue.grid.side
    freest = max(
        largest(insertion.solver.solve(insertion.load, ss.Needle((0, *middle[1:]), (x, *middle[1:]))).displacement.T)
        for x in np.linspace(0.02, 1, 15) * side
    )
    for needle in poses(rng, tissue, count):
        state = insertion.solver.solve(insertion.load, needle, tolerance=1e-2)
        assert largest(state.displacement.T) < 1.2 * freest


def test_a_needle_in_a_pinned_face_moves_nothing():
    insertion = ss.KelvinletInsertion(box("cube"))
    assert largest(insertion.advance(ss.Needle((0, 0, 4), (8, 0, 6))).values) == 0


def test_drag_falls_to_zero_at_a_pinned_face_without_a_jump():
    insertion = ss.KelvinletInsertion(box("cube"))
    aside = 12 * np.array([0, 1e-6, 1e-3, 0.02, 0.0999, 0.1, 0.1001, 0.2])
    drags = [largest(insertion.solve(ss.Needle((0, y, 5), (6, y, 6))).displacement([[3, y, 5.5]])) for y in aside]
    share = np.array(drags) / insertion.model.drag
    np.testing.assert_allclose(share, np.minimum(aside / 1.2, 1), atol=0.03)


def test_away_from_the_walls_the_whole_shaft_is_dragged_alike():
    insertion = ss.KelvinletInsertion(ss.Tissue(ss.Grid.unit_cube(13)))
    needle = ss.Needle((0, 0.4, 0.5), (0.85, 0.6, 0.5))
    moved = insertion.solve(needle).displacement(insertion.solve(needle).centres[len(insertion.anchors) :])
    np.testing.assert_allclose(moved, np.broadcast_to(DRAG * needle.direction, moved.shape), atol=1e-3 * DRAG)


def test_anchors_too_dense_for_a_kernel_are_refused():
    with pytest.raises(ValueError, match=r"anchors = 9 along each side are too near .* width = 20 .*; give fewer"):
        ss.KelvinletInsertion(box("cube"), ss.DragModel(drag=1, spacing=1, kernel=ss.Kelvinlet(width=20)), anchors=9)
