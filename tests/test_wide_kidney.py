"""The kidney with its neighbours: the same kidney and mechanics, and tissue to the edges of every image."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sonospline import _memory
from sonospline.geometry import facing
from sonospline.phantoms import kidney_phantom, wide_kidney_phantom
from sonospline.phantoms.generated import PHANTOMS
from sonospline.phantoms.wide_kidney import LABELS
from sonospline.ultrasound import Artefacts, Probe, Scanner

LIVER, BOWEL, GAS, LUNG, BONE, URINE = 13, 14, 15, 16, 5, 10
CORTEX, MEDULLA, SINUS = 7, 8, 9


@pytest.fixture(scope="module")
def wide():
    return wide_kidney_phantom(spacing_mm=2.0)


@pytest.fixture(scope="module")
def narrow():
    return kidney_phantom(spacing_mm=2.0)


def places(phantom, *labels):
    """World positions of the voxels of some labels."""
    lattice = phantom.labels.lattice
    return lattice.world(np.argwhere(np.isin(phantom.bytes, labels)) * np.array(lattice.spacing))


def test_the_kidney_is_the_same(wide, narrow):
    shift = np.rint((narrow.phantom.labels.origin - wide.phantom.labels.origin) / 2).astype(int)
    shape = narrow.phantom.bytes.shape
    part = wide.phantom.bytes[tuple(slice(s, s + n) for s, n in zip(shift, shape, strict=True))]
    part = part[:, :, : shape[2]][tuple(slice(0, n) for n in part.shape)]
    kidney = narrow.phantom.bytes[tuple(slice(0, n) for n in part.shape)]
    inside = np.isin(kidney, (CORTEX, MEDULLA, 9, 11, 12))
    same = part[inside] == kidney[inside]
    pyramids = (kidney == CORTEX) & (part == MEDULLA)
    assert same.mean() + pyramids[inside].mean() > 0.995  # the ureter leaves through the hilum
    for name, at in narrow.targets.items():
        assert np.array_equal(wide.targets[name], at)


def test_medulla_lies_on_both_sides_of_the_sinus(wide, narrow):
    deeper = [
        (places(phantom, MEDULLA)[:, 2] > places(phantom, SINUS)[:, 2].mean() + 5).mean()
        for phantom in (narrow.phantom, wide.phantom)
    ]
    assert deeper[0] == 0 and 0.1 < deeper[1] < 0.4


def test_it_is_wide_and_its_neighbours_are_where_an_access_meets_them(wide):
    assert wide.phantom.labels.lattice.extent[1] >= 160
    kidney = places(wide.phantom, 7)
    colon, lung, liver = (places(wide.phantom, label) for label in (BOWEL, LUNG, LIVER))
    assert colon[:, 1].min() - kidney[:, 1].max() < 25  # beside the kidney
    assert lung[:, 0].max() > 0 and lung[:, 0].max() < 27  # above the twelfth rib
    assert liver[:, 2].max() > kidney[:, 2].max() and liver[:, 0].mean() < kidney[:, 0].mean()
    apart = cKDTree(kidney).query(liver)[0].min()
    assert 2 < apart < 20
    ribs = places(wide.phantom, BONE)
    ribs = ribs[(ribs[:, 2] < 28) & (abs(ribs[:, 1] - 50) < 1)]
    assert len(set(np.round(ribs[:, 0] / 12))) >= 3


def test_the_ureter_leads_out_of_the_pelvis(wide):
    from scipy.ndimage import label

    parts, count = label(wide.phantom.bytes == URINE, structure=np.ones((3, 3, 3)))
    largest = np.bincount(parts.ravel())[1:].argmax() + 1
    system = np.argwhere(parts == largest) * 2.0 + wide.phantom.labels.origin
    assert count >= 1 and system[:, 0].max() > 180  # to the foot end
    assert np.linalg.norm(system - wide.targets["pelvis"], axis=1).min() < 3


def test_across_the_kidney_tissue_goes_to_the_edges(wide, narrow):
    pose = facing((62, 50, 8), depth=(0, 0, 1), right=(0, 1, 0))
    probe = Probe.curvilinear(lines=64)
    grey = []
    for phantom in (narrow.phantom, wide.phantom.textured()):
        image = Scanner(phantom, probe, pose, artefacts=Artefacts(haze_db=None)).render()
        outer = np.concatenate([image.beams[:3, 450:550], image.beams[-3:, 450:550]])
        grey.append(float(np.median(outer)))
    assert grey[0] < 5 and grey[1] > 30


def test_mechanics_have_the_same_box():
    wide, narrow = PHANTOMS["wide kidney"](4.0), PHANTOMS["kidney"](4.0)
    assert all(np.array_equal(a, b) for a, b in zip(wide.box, narrow.box, strict=True))
    assert set(narrow.names.items()) < set(wide.names.items()) and wide.names == LABELS


@pytest.mark.parametrize("name", PHANTOMS)
def test_no_scene_is_begun_that_memory_does_not_hold(name, monkeypatch):
    monkeypatch.setattr(_memory, "available_bytes", lambda: 2**27)
    with pytest.raises(ValueError, match=r"a phantom of .* at spacing_mm = 0.1 would take .*; use larger voxels"):
        PHANTOMS[name](0.1)


def test_one_that_memory_does_not_hold_is_refused(monkeypatch):
    monkeypatch.setattr(_memory, "available_bytes", lambda: 2**27)
    with pytest.raises(
        ValueError, match=r"phantom of 270.* x 200.* x 130.*spacing_mm = 0.25 would take .*; use larger"
    ):
        wide_kidney_phantom(spacing_mm=0.25)
    with pytest.raises(ValueError, match="spacing_mm = 5"):
        wide_kidney_phantom(spacing_mm=5)
