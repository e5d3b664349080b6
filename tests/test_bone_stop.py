"""Bone stops needles in every model of labelled tissue: the load ends there, and the response says which bone."""

import pickle

import numpy as np
import pytest

import sonospline as ss
from sonospline import models
from sonospline.geometry import LabelMap
from sonospline.mechanics import Blocked, Material, TissueMap
from sonospline.mechanics.bone_stop import stopped
from sonospline.models import registry

SIDE = 60.0
TISSUE = ss.Tissue(ss.Grid(shape=(13, 13, 13), spacing=SIDE / 12))
THROUGH, BESIDE = ss.Needle((0, 30, 30), (50, 30, 30)), ss.Needle((0, 10, 30), (50, 10, 30))


def with_bone(rigid=True):
    """Fat with a rib across it from x = 29 to x = 35, y from 21."""
    voxels = np.ones((30, 30, 30), np.uint8)
    voxels[15:18, 11:, :] = 2
    labels = LabelMap(voxels=voxels, spacing=2.0, origin=(0, 0, 0), names={1: "fat", 2: "rib_left_8"})
    soft = Material(10)
    return TissueMap(labels, {0: soft, 1: soft, 2: Material(1e4, cutting_force_n=50, rigid=True) if rigid else soft})


@pytest.fixture(scope="module")
def model():
    return models.make("elastic", TISSUE, with_bone(), solver_nodes=13**3)


def test_a_needle_ends_at_the_bone_and_the_response_says_which(model):
    response = model.step(model.rest, {"biopsy": THROUGH})
    ((_, needle),) = response.state.needles
    assert needle.tip == pytest.approx([29, 30, 30], abs=2e-3)
    assert response.events == (Blocked("biopsy", "rib_left_8", needle.depth),)
    assert response.blocked["biopsy"].by == "rib_left_8"
    assert "biopsy" in repr(response)
    assert response.forces["biopsy"].axial_n < 3, "not the 50 N that bone would take"
    assert pickle.loads(pickle.dumps(response)).events == response.events


def test_what_lies_behind_the_surface_loads_nothing(model):
    deep = model.step(model.rest, {"needle": THROUGH})
    shallow = model.step(model.rest, {"needle": ss.Needle((0, 30, 30), (29 - 1e-3, 30, 30))})
    assert np.abs(deep.field.on_grid() - shallow.field.on_grid()).max() < 1e-6
    assert shallow.blocked["needle"].depth_mm == pytest.approx(29, abs=2e-3), "it rests on the bone"


def test_a_needle_that_rests_there_stays_as_it_is(model):
    first = model.step(model.rest, {"needle": THROUGH})
    again = model.step(first.state, first.state.needles)
    assert again.state.needles == first.state.needles
    assert again.events == first.events


def test_it_is_withdrawn_at_once(model):
    first = model.step(model.rest, {"needle": THROUGH})
    back = model.step(first.state, {"needle": ss.Needle((0, 30, 30), (28.5, 30, 30))})
    assert dict(back.state.needles)["needle"].depth == 28.5
    assert (back.events, dict(back.blocked)) == ((), {})


def test_of_several_needles_those_stop_that_meet_it(model):
    response = model.step(model.rest, {"through": THROUGH, "beside": BESIDE})
    inside = dict(response.state.needles)
    assert inside["beside"] is BESIDE
    assert inside["through"].depth == pytest.approx(29, abs=2e-3)
    assert [event.needle for event in response.events] == ["through"]


def test_a_needle_that_starts_in_bone_is_refused(model):
    with pytest.raises(ValueError, match=r"entry = \(32, 30, 30\) of needle 'b' lies in bone, rib_left_8; enter besid"):
        model.step(model.rest, {"a": BESIDE, "b": ss.Needle((32, 30, 30), (10, 30, 30))})


def test_a_model_of_another_package_is_never_asked_beyond_bone(monkeypatch):
    """It is given the labels, and what it answers to ends at their bones."""

    class Heard(models.TissueModel):
        name = "heard"
        capabilities = frozenset({"labels"})

        def _answer(self, state, needles, dt):
            heard.extend(needle.depth for needle in needles.values())
            values = np.zeros((*self.tissue.grid.shape, 3), np.float32)
            inside = models.State(self.identity, tuple(needles.items()))
            return models.Response(
                state=inside, field=ss.GridField(self.tissue.grid, values), forces={}, events=("ok",)
            )

    heard = []
    monkeypatch.setattr(registry, "_table", dict(registry._discover()))
    registry.register(
        models.ModelSpec(
            name="heard", title="", summary="", maker=lambda tissue, materials: Heard(tissue),
            capabilities=Heard.capabilities,
        )
    )  # fmt: skip
    made = models.make("heard", TISSUE, with_bone())
    response = made.step(made.rest, {"needle": THROUGH})
    assert heard == [pytest.approx(29, abs=2e-3)]
    assert response.events == (response.blocked["needle"], "ok")


def test_a_simulation_and_an_insertion_end_there():
    sim = ss.Simulation(with_bone(), nodes=2000, solver_nodes=13**3)
    seen = []
    response = sim.insert((0, 30, 30), (50, 30, 30), steps=10, progress=lambda made, of: seen.append((made, of)))
    assert seen == [(k, 10) for k in range(1, 7)], "the sixth step of 5 mm meets it"
    assert response.settled and response.blocked["needle"].depth_mm == pytest.approx(29, abs=2e-3)
    insertion = models.NeedleInsertion(sim.model)
    assert len(list(insertion.run((0, 30, 30), (50, 30, 30), steps=10))) == 6
    assert insertion.needle.depth == pytest.approx(29, abs=2e-3)
    assert len(list(insertion.run((0, 10, 30), (50, 10, 30), steps=10))) == 10
    assert not insertion.response.blocked


def test_without_bone_nothing_is_asked_of_the_labels(monkeypatch):
    monkeypatch.setattr(TissueMap, "obstacle", None)
    assert stopped({"needle": THROUGH}, with_bone(rigid=False)) == ((("needle", THROUGH),), ())
    assert stopped({"needle": THROUGH}, None).needles[0][1] is THROUGH


def test_a_loose_fragment_stops_the_needle_where_it_has_moved_to():
    """The needle pushes it ahead, and meets it a little deeper than where it was."""
    voxels = np.ones((30, 30, 30), np.uint8)
    voxels[14:18, 11:20, 11:20] = 2
    fat, loose = Material(3), Material(1e4, rigid=True, floating=True)
    tissues = TissueMap(LabelMap(voxels=voxels, spacing=2.0, names={1: "fat", 2: "chip"}), {0: fat, 1: fat, 2: loose})
    model = models.make("elastic", TISSUE, tissues, solver_nodes=13**3)
    response = model.step(model.rest)
    for depth in np.linspace(5, 50, 10):
        response = model.step(response.state, {"needle": ss.Needle((0, 30, 30), (depth, 30, 30))})
    tip = dict(response.state.needles)["needle"].tip
    moved = response.field.displacement(np.array([[27.0, 30.0, 30.0]]))[0, 0]
    assert response.blocked["needle"].by == "chip"
    assert 0.1 < moved < 5
    assert tip[0] == pytest.approx(27 + moved, abs=0.1)
    assert tissues.obstacle(THROUGH).depth_mm == pytest.approx(27), "where it was"
    assert tissues.obstacle(THROUGH, response.field).depth_mm == pytest.approx(27 + moved, abs=0.02)
    back = model.step(response.state, {"needle": ss.Needle((0, 30, 30), (tip[0] - 0.5, 30, 30))})
    assert dict(back.state.needles)["needle"].depth == pytest.approx(tip[0] - 0.5)


def test_tissue_that_folds_on_the_way_hides_no_loose_fragment():
    """Places that no inverse map is known for have no label; a step ended with an error about NaN."""

    class Folded:
        def inverse(self, points):
            return np.where((points[:, :1] > 8) & (points[:, :1] < 12), np.nan, points)

    voxels = np.ones((30, 30, 30), np.uint8)
    voxels[14:18, 11:20, 11:20] = 2
    fat, loose = Material(3), Material(rigid=True, floating=True)
    tissues = TissueMap(LabelMap(voxels=voxels, spacing=2.0), {0: fat, 1: fat, 2: loose})
    assert tissues.obstacle(THROUGH, Folded()).depth_mm == pytest.approx(27, abs=0.02)
