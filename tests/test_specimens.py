"""What the models are compared in: blocks of labelled anatomy, and the plane of them that is drawn."""

import numpy as np
import pytest

import sonospline as ss
from labelled_tissue import torso
from sonospline.study import specimens
from sonospline.study.drawn_plane import DrawnPlane


@pytest.mark.parametrize("made", [specimens.kidney, lambda nodes: specimens.patient("torso", torso(), nodes)])
def test_needles_go_deep_and_meet_no_bone(made):
    specimen = made(2000)
    assert specimen.tissues.has_bone
    assert 1 <= len(specimen.insertions) <= 8
    rigid = [label for label, material in specimen.tissues.materials.items() if material.rigid]
    for plan in specimen.insertions:
        needle = plan.on(specimen.tissue)
        assert needle.depth > 0.3 * specimen.tissue.grid.side
        assert not np.isin(specimen.tissues.labels_at(needle.at(np.linspace(0, 1, 500))), rigid).any()


def test_a_patients_block_is_the_cube_in_which_most_tissues_meet():
    specimen = specimens.patient("torso", torso(), 1000)
    grid = specimen.tissue.grid
    assert grid.extent == pytest.approx([60, 60, 60])
    assert len(np.unique(specimen.tissues.labels_at(grid.points))) == 5
    assert specimen.tissue.entry_face == "y+"


def test_the_face_to_the_front_is_free_whichever_way_the_voxels_run():
    turned = torso(direction=np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]))
    tissue = specimens.patient("torso", turned, 1000).tissue
    assert tissue.entry_face == "x-"
    front = tissue.grid.points[tissue.grid.on_faces(["x-"]).ravel()]
    assert front[:, 1] == pytest.approx(tissue.grid.points[:, 1].max())


def test_labels_that_cannot_serve_are_refused_in_one_line():
    bony = torso()
    bony.voxels[:] = 1
    with pytest.raises(ValueError, match="torso: every insertion of the study meets bone"):
        specimens.patient("torso", bony, 1000)
    with pytest.raises(ValueError, match="has no names"):
        specimens.patient("torso", ss.LabelMap(voxels=bony.voxels, spacing=bony.spacing), 1000)


@pytest.mark.parametrize("face", ["x-", "x+", "y-", "y+", "z-", "z+"])
def test_the_drawn_plane_holds_the_needle_and_begins_at_the_entry(face):
    tissue = ss.Tissue(ss.Grid(shape=(5, 6, 7), spacing=10.0), entry_face=face)
    axis, last = "xyz".index(face[0]), face[1] == "+"
    middle = tissue.grid.extent / 2
    entry = middle.copy()
    entry[axis] = last * tissue.grid.extent[axis]
    needle = ss.Needle(entry, middle)
    plane = DrawnPlane.of(tissue, needle)
    (first, across), (end, same) = plane.ends(needle)
    assert (first, end) == pytest.approx((0, (tissue.grid.shape[axis] - 1) / 2))
    assert across == pytest.approx(same)
    distance = np.linalg.norm(tissue.grid.points - entry, axis=1).reshape(tissue.grid.shape)
    cut = plane.cut(distance)
    assert cut.shape[0] == tissue.grid.shape[axis]
    assert (np.diff(cut[:, round(across)]) > 0).all()
