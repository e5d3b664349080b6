"""Where a scene of somebody's own data starts: on the skin, over an organ, by a face that leads to it."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.io.tables import read_names
from sonospline.server.own_scene import _seen, _way, own_scene
from sonospline.simulator import Session, make_scene

NAMES = {1: "kidney_left", 2: "rib_left_11", 3: "liver", 4: "autochthon_left"}


def torso(folder, *, rib_in_front=False):
    """An oval body cut at z, 3 mm voxels, air around it: a kidney 40 mm under the skin of y-, a liver in the middle."""
    x, y, z = np.ogrid[:70, :60, :30]
    labels = np.zeros((70, 60, 30), np.uint8)
    body = ((x - 35) / 30) ** 2 + ((y - 30) / 22) ** 2 < 1
    labels[np.broadcast_to(body, labels.shape)] = 4
    labels[((x - 35) / 12) ** 2 + ((y - 36) / 6) ** 2 + ((z - 15) / 10) ** 2 < 1] = 3
    labels[((x - 35) / 6) ** 2 + ((y - 22) / 5) ** 2 + ((z - 15) / 8) ** 2 < 1] = 1
    if rib_in_front:
        labels[25:45, 11:13, 5:25] = 2
    ct = np.where(body, 40, -1000).astype(np.int16) + np.zeros(labels.shape, np.int16)
    for name, voxels in (("labels", labels), ("ct", ct)):
        ss.write_volume(ss.Volume(voxels=voxels, spacing=(3, 3, 3)), folder / f"{name}.nrrd")
    rows = "".join(f"{number},{name}\n" for number, name in NAMES.items())
    (folder / "labels.csv").write_text("label,name\n" + rows)
    return folder / "labels.nrrd"


@pytest.mark.parametrize("with_ct", [True, False])
def test_the_probe_lies_on_the_skin_over_the_kidney(tmp_path, with_ct):
    path = torso(tmp_path)
    scene = own_scene(path, labelled=True, ct=tmp_path / "ct.nrrd" if with_ct else None)
    assert scene.tissue.entry_face == "y-"
    assert [target.name for target in scene.targets] == ["kidney_left"]
    (target,), at = scene.targets, np.array(scene.probe.at)
    assert target.at == pytest.approx((105, 66, 45), abs=4)
    assert at == pytest.approx((target.at[0], 3 * 8, target.at[2]), abs=6)  # the body begins at y = 8
    assert target.at[1] - at[1] < scene.probe.depth_mm < 120
    assert "kidney_left lies" in scene.description
    assert "skin of face y-" in scene.description


def test_a_rib_before_it_makes_another_way_better_or_says_so(tmp_path):
    free, hidden = (
        own_scene(torso(tmp_path, rib_in_front=rib), labelled=True, ct=tmp_path / "ct.nrrd") for rib in (False, True)
    )
    assert "nothing before it" in free.description
    assert hidden.tissue.entry_face != "y-" or hidden.targets[0].name != "kidney_left"


def test_the_face_that_was_asked_for_is_taken(tmp_path):
    scene = own_scene(torso(tmp_path), labelled=True, face="x-", ct=tmp_path / "ct.nrrd")
    assert scene.tissue.entry_face == "x-"


@pytest.mark.slow
def test_it_is_a_scene_that_runs_and_shows_the_organ(tmp_path):
    scene = make_scene(own_scene(torso(tmp_path), labelled=True, ct=tmp_path / "ct.nrrd"), folder=tmp_path)
    session = Session(scene)
    frame = session.step()
    beside = frame.image.plane.project(scene.targets["kidney_left"][None])[0]
    left, right, bottom, top = frame.image.plane.extent
    assert left < beside[0] < right
    assert top < beside[1] < bottom
    assert abs(beside[2]) < 1
    assert frame.image.pixels[200:300].mean() > 20


@pytest.mark.slow
def test_in_a_real_abdomen_a_kidney_is_reached_from_behind(shared_data):
    path = shared_data / "abdomen_labels.nii.gz"
    assert 2 in read_names(shared_data / "abdomen_labels.csv")
    scene = own_scene(path, labelled=True, ct=shared_data / "abdomen_ct.nii.gz")
    assert scene.tissue.entry_face == "y-"  # dorsal
    assert scene.targets[0].name.startswith("kidney")
    assert 30 < scene.targets[0].at[1] - scene.probe.at[1] < 110


def test_an_image_without_skin_says_so(tmp_path, caplog):
    full = ss.Volume(voxels=np.full((20, 20, 20), 90, np.uint8), spacing=(2, 2, 2))
    ss.write_volume(full, tmp_path / "full.nrrd")
    scene = own_scene(tmp_path / "full.nrrd", labelled=False)
    assert scene.tissue.entry_face == "y+"
    assert "no skin was found" in caplog.text


def test_a_ct_alone_has_its_skin_outside_its_lungs_and_off_its_table():
    x, y = np.ogrid[:40, :40, :1][:2]
    hu = np.full((40, 40, 12), -1000, np.int16)
    hu[np.broadcast_to((x - 20) ** 2 + (y - 18) ** 2 < 14**2, hu.shape)] = 40
    hu[np.broadcast_to((x - 20) ** 2 + (y - 12) ** 2 < 4**2, hu.shape)] = -800  # a lung
    hu[:, 36:38] = 100  # the table
    ct = ss.Volume(voxels=hu, spacing=(3, 3, 3))
    body = _seen(ct)
    assert body[20, 12, 6] and not body[20, 37, 6]
    ways = {face: _way(ct, body, np.zeros_like(body), np.array((20, 18, 6)), face) for face in ss.FACES}
    assert [ways[face].skin[1] for face in ("y-", "y+")] == [5, 31]
    assert ways["z-"] is None and ways["z+"] is None, "the patient is cut there"
