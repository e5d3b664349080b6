"""Where many points are accepted one is, and so are those of a whole picture."""

import numpy as np
import pytest

import sonospline as ss
from sonospline.geometry import ImagePlane, LabelMap, Volume, facing, to_image, to_reference
from sonospline.ultrasound import Probe

POINTS = np.array([[0.2, 0.4, 0.5], [0.6, 0.55, 0.45], [0.31, 0.5, 0.52]])
NEEDLE = ss.Needle((0, 0.5, 0.5), (0.55, 0.5, 0.5))
TILT = facing((0, 0, 0), depth=(0.1, 0.2, 1), right=(1, 0.1, 0))[:3, :3]


def fields():
    tissue = ss.Tissue(ss.Grid.unit_cube(13))
    spline = ss.Insertion(tissue).advance(NEEDLE)
    moving = ss.Insertion(tissue, ss.NeedleTissueModel.paper_incremental(), accumulation="incremental")
    tilted = ss.Grid(shape=(7, 7, 7), spacing=1 / 6, direction=TILT)
    values = 0.02 * np.random.default_rng(0).standard_normal((7, 7, 7, 3))
    return {
        "kernel": spline,
        "composed": moving.advance(NEEDLE),
        "grid": ss.GridField.of(spline),
        "cubic": ss.GridField(tilted, values, order=3),
        "kelvinlet": ss.KelvinletInsertion(tissue).advance(NEEDLE),
    }


def maps():
    lattice = ss.Grid(shape=(5, 6, 7), spacing=0.25, origin=(-0.2, 0, 0.1), direction=TILT)
    volume = Volume(
        voxels=np.random.default_rng(0).random(lattice.shape),
        spacing=lattice.spacing, origin=lattice.origin, direction=lattice.direction,
    )  # fmt: skip
    labels = LabelMap(voxels=(9 * volume.voxels).astype(np.uint8), spacing=(0.25,) * 3)
    plane = ImagePlane(
        image_to_reference=facing((0, 0, 0), depth=(0, 1, 1), right=(1, 0, 0)), shape=(4, 5), spacing_mm=1
    )
    pose = plane.image_to_reference
    tissue = ss.Tissue(lattice)
    found = {
        "Grid.local": lattice.local, "Grid.world": lattice.world, "Grid.node": lattice.node,
        "Grid.contains": lattice.contains, "Tissue.distance_to_pinned": tissue.distance_to_pinned,
        "Volume.index": volume.index, "Volume.position": volume.position, "Volume.sample": volume.sample,
        "LabelMap.sample": labels.sample, "ImagePlane.project": plane.project, "ImagePlane.pixels": plane.pixels,
        "to_image": lambda p: to_image(pose, p), "to_reference": lambda p: to_reference(pose, p),
        "Needle.project": lambda p: NEEDLE.project(p).foot, "Needle.along": lambda p: NEEDLE.project(p).along,
    }  # fmt: skip
    for probe in (Probe.linear(), Probe.curvilinear()):
        found |= {
            f"{probe.kind} {name}": getattr(probe, name)
            for name in ("beam_coordinates", "image_points", "beam_directions")
        }
    for name, field in fields().items():
        found |= {f"{name} {verb}": getattr(field, verb) for verb in ("displacement", "jacobian", "forward", "inverse")}
    return found


MAPS = maps()


@pytest.mark.parametrize("name", MAPS)
def test_one_point_has_the_answer_it_has_among_many(name):
    ask = MAPS[name]
    many = np.asarray(ask(POINTS))
    assert len(many) == len(POINTS)
    for k, point in enumerate(POINTS):
        for given in (point, tuple(point.tolist())):
            one = np.asarray(ask(given))
            assert one.shape == many.shape[1:]
            assert np.allclose(one, many[k], rtol=1e-6, atol=1e-7, equal_nan=True)
    assert np.asarray(ask(np.empty((0, 3)))).shape == (0, *many.shape[1:])


@pytest.mark.parametrize("name", [name for name in MAPS if name.startswith(("kernel", "grid", "Volume", "LabelMap"))])
def test_a_picture_of_points_has_a_picture_of_answers(name):
    ask, picture = MAPS[name], np.stack([POINTS, POINTS[::-1]])
    assert np.allclose(np.asarray(ask(picture)), np.stack([ask(POINTS), ask(POINTS[::-1])]), equal_nan=True)


@pytest.mark.parametrize("wrong", [(1, 2), 5.0, np.zeros((3, 2)), "nowhere", (1, 2, np.nan)])
def test_what_is_no_point_is_refused_in_one_line(wrong):
    for ask in (MAPS["kernel displacement"], MAPS["Volume.sample"], MAPS["grid inverse"]):
        with pytest.raises(ValueError, match="points") as error:
            ask(wrong)
        assert len(str(error.value).splitlines()) == 1


def test_the_report_of_one_inverse_is_of_one_point():
    x, report = fields()["grid"].inverse((0.4, 0.5, 0.5), return_report=True)
    assert x.shape == (3,)
    assert report.converged.shape == ()
    assert report.converged
