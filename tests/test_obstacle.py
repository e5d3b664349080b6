"""Where a needle's line meets bone, exactly."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry import LabelMap
from sonospline.mechanics import Material, TissueMap
from sonospline.mechanics.material_table import MaterialTable

SOFT, BONE = Material(10), Material(1e4, rigid=True)
MATERIALS = {0: SOFT, 1: SOFT, 7: BONE}


def block(bone, *, materials=MATERIALS, **lattice):
    """Soft tissue with bone at some voxels of 10 x 10 x 10."""
    voxels = np.ones((10, 10, 10), np.uint8)
    voxels[bone] = 7
    return TissueMap(LabelMap(voxels=voxels, spacing=lattice.pop("spacing", 2.0), **lattice), materials)


def sampled(tissues, needle, step=1e-3):
    """The first bone by fine sampling; None where there is none."""
    depths = np.arange(step / 2, needle.depth, step)
    rigid = [label for label, material in tissues.materials.items() if material.rigid]
    met = np.flatnonzero(np.isin(tissues.labels_at(needle.entry + depths[:, None] * needle.direction), rigid))
    return depths[met[0]] if len(met) else None


def test_a_needle_meets_the_face_of_a_voxel():
    met = block(np.s_[5, 4:6, 4:6]).obstacle(ss.Needle((0, 9, 9), (18, 9, 9)))
    assert (met.label, met.name, met.depth_mm) == (7, "label 7", pytest.approx(9))
    assert met.point == pytest.approx([9, 9, 9])
    assert block(np.s_[5, 4:6, 4:6]).obstacle(ss.Needle((0, 9, 9), (8.99, 9, 9))) is None, "it ends before"
    assert block(np.s_[5, 4:6, 4:6]).obstacle(ss.Needle((18, 9, 9), (0, 9, 9))).depth_mm == pytest.approx(7)


def test_bone_is_called_by_its_name():
    labels = LabelMap(voxels=block(np.s_[5]).labels.voxels, spacing=2, names={1: "fat", 7: "rib_left_8"})
    table = MaterialTable.assumed()
    for tissues in (TissueMap.of(labels), TissueMap.named(labels, {1: "fat", 7: "rib_left_8"}, table)):
        assert tissues.obstacle(ss.Needle((0, 9, 9), (18, 9, 9))).name == "rib_left_8"


def test_it_is_what_fine_sampling_finds():
    """Lines at all angles through a tilted image with uneven voxels, many of them beyond it."""
    random = np.random.default_rng(3)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    voxels = np.where(random.random((12, 10, 8)) < 0.03, 7, 1).astype(np.uint8)
    tissues = TissueMap(
        LabelMap(voxels=voxels, spacing=(1.0, 1.5, 2.2), origin=(5, -3, 8), direction=turn), MATERIALS
    )  # fmt: skip
    met = 0
    for entry, tip in tissues.labels.lattice.world(random.uniform(-8, 22, (120, 2, 3))):
        needle = ss.Needle(entry, tip)
        found, expected = tissues.obstacle(needle), sampled(tissues, needle)
        if expected is None:  # sampling may miss a corner that is thinner than its step
            assert found is None or sampled(tissues, needle, 1e-5) == pytest.approx(found.depth_mm, abs=1e-4)
        else:
            met += 1
            assert found.depth_mm == pytest.approx(expected, abs=2e-3)
    assert met > 10


@pytest.mark.parametrize("shift", [-1e-13, 0.0, 1e-13])
@pytest.mark.parametrize("first", [4, 5])
def test_a_needle_that_grazes_bone_passes_by(shift, first):
    """Along the face of a bone, whichever side of it rounding puts the line on."""
    grazing = ss.Needle((0, 2 * first - 1 + shift, 8), (18, 2 * first - 1 + shift, 8))
    assert block(np.s_[3:8, first, :]).obstacle(grazing) is None
    assert block(np.s_[3:8, first - 1, :]).obstacle(grazing) is None
    between = block(np.s_[3:8, first - 1 : first + 1, :]).obstacle(grazing)
    assert between.depth_mm == pytest.approx(5), "in the face between two voxels of one bone it is inside"


def test_edges_and_corners():
    entering = ss.Needle((0, 2, 8), (18, 20, 8))
    assert block(np.s_[5, 6, :]).obstacle(entering).depth_mm == pytest.approx(9 * np.sqrt(2)), "at the edge itself"
    assert block(np.s_[5, 5, :]).obstacle(entering) is None, "one edge of it touched"
    corner = ss.Needle((0, 0, 0), (18, 18, 18))
    assert block(np.s_[4, 4, 4]).obstacle(corner).depth_mm == pytest.approx(7 * np.sqrt(3))
    assert block(np.s_[4, 5, 4]).obstacle(corner) is None


def test_a_needle_that_starts_in_bone_meets_it_at_once():
    assert block(np.s_[:, :, :]).obstacle(ss.Needle((3, 3, 3), (9, 9, 9))).depth_mm == 0
    assert block(np.s_[1, 1, 1]).obstacle(ss.Needle((2, 2, 2), (9, 9, 9))).depth_mm == 0


def test_beyond_the_image_is_background():
    tissues = block(np.s_[0, :, :])
    assert tissues.obstacle(ss.Needle((-20, 9, 9), (18, 9, 9))).depth_mm == pytest.approx(19)
    assert tissues.obstacle(ss.Needle((-20, 9, 9), (-2, 9, 9))) is None
    assert tissues.obstacle(ss.Needle((-20, 30, 9), (18, 30, 9))) is None
    hard = block(np.s_[0:0], materials={**MATERIALS, 0: BONE})
    assert hard.obstacle(ss.Needle((9, 9, 9), (40, 9, 9))).depth_mm == pytest.approx(10), "a rigid background"


def test_without_rigid_tissue_nothing_is_looked_at(monkeypatch):
    monkeypatch.setattr("sonospline.mechanics.tissue_map.voxels_along", None)
    tissues = block(np.s_[5], materials={**MATERIALS, 7: SOFT})
    assert not tissues.has_bone
    assert tissues.obstacle(ss.Needle((0, 9, 9), (18, 9, 9))) is None
