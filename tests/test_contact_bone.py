"""A needle that leaves a track, pushed to a bone and on: the bone stops it, and tissue beside it keeps still."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry import LabelMap
from sonospline.mechanics import Material, TissueMap
from sonospline.models.elastic import ElasticModel


def block():
    """Muscle around a bar of bone, in cells of 7 mm: as coarse as those of a whole abdomen."""
    voxels = np.ones((30, 30, 30), np.uint8)
    voxels[12:16, :, 8:20] = 2
    labels = LabelMap(voxels=voxels, spacing=2.0, names={1: "muscle", 2: "rib"})
    muscle, rib = Material(12.0), Material(1e4, cutting_force_n=50.0, rigid=True)
    tissues = TissueMap(labels, {0: muscle, 1: muscle, 2: rib})
    return ElasticModel(ss.Tissue(labels.grid(1000), "x-"), tissues, nodes=9**3, contact="track")


@pytest.mark.parametrize(("dt", "towards"), [(0.0, (1.0, 0.0, 0.0)), (0.05, (0.9, 0.3, 0.2))])
def test_a_push_to_a_bone_and_on_moves_tissue_by_no_more_than_muscle_takes(dt, towards):
    model, entry, moved = block(), np.array([0.0, 20.0, 22.0]), []
    axis, response = np.array(towards) / np.linalg.norm(towards), model.step(model.rest)
    for depth in np.arange(1.0, 45.0, 2.0):
        response = model.step(response.state, {"needle": ss.Needle(entry, entry + depth * axis)}, dt)
        moved.append(np.linalg.norm(response.state.solution.displacement, axis=0).max())
    assert response.blocked and max(moved) < 2
    assert response.forces["needle"].lateral_n < 0.5 and 0 < response.forces["needle"].axial_n < 2
