"""A push into every rib of a real abdomen and of the kidney scene: the needle stops, and nothing folds there."""

import numpy as np
import pytest
from msgspec.structs import replace

import sonospline as ss
from rib_pushes import LEAST_DET, MOST_MM, PUSH_MM, Site, solid_cells, strain_of
from sonospline.geometry import LabelMap
from sonospline.mechanics import Material, TissueMap
from sonospline.models.elastic.spec import BUDGET
from sonospline.simulator import Session, make_scene

RIBS = [f"rib_{side}_{number}" for side in ("left", "right") for number in range(7, 13)]
SITES = [(rib, ss.FACES[k % 6]) for k, rib in enumerate(RIBS)]
"""Each rib from one face, each face twice; from all faces they are in benchmarks/elastic_holds_on_real_anatomy.py."""


def pushed(site, pushes):
    """Every push stops at the surface of a bone, where tissue neither moves far nor folds; return all their frames."""
    frames = []
    for entry, direction in pushes:
        if site.tissues.obstacle(ss.Needle(entry, entry + direction)) is not None:
            continue  # it would start in bone, or end before its first step
        *way, last = site.push(entry, direction)
        assert last.bone, f"from {entry} along {direction}, {last.needle.depth} mm deep"
        surface = site.tissues.obstacle(ss.Needle(entry, last.needle.tip + direction))
        assert last.needle.depth == pytest.approx(surface.depth_mm, abs=2e-3)
        assert last.moved_mm <= MOST_MM and last.det > -0.05, last
        frames += [*way, last]
    return frames


@pytest.mark.slow
def test_a_push_into_a_rib():
    """A bar of bone in muscle, at a tilt."""
    voxels = np.ones((30, 30, 30), np.uint8)
    voxels[12:15, :, 10:20] = 2
    labels = LabelMap(voxels=voxels, spacing=2.0, names={1: "muscle", 2: "rib"})
    muscle, bone = Material(12.0), Material(1e4, cutting_force_n=50.0, rigid=True)
    site = Site(TissueMap(labels, {0: muscle, 1: muscle, 2: bone}), 2, "x-")
    frames = pushed(site, list(site.needles())[1:2])
    assert len(frames) > 5 and all(frame.gentle for frame in frames)


@pytest.mark.slow
@pytest.mark.parametrize(("rib", "face"), SITES)
def test_a_push_into_every_rib_of_a_real_abdomen(shared_data, rib, face):
    tissues = TissueMap.read(shared_data / "abdomen_labels.nii.gz")
    label = next(label for label, name in tissues.labels.names.items() if name == rib)
    site = Site(tissues, label, face)
    frames = pushed(site, site.needles())
    assert sum(frame.bone is not None for frame in frames) >= 2
    assert max(frame.iterations for frame in frames) <= BUDGET
    assert all(frame.gentle for frame in frames)


@pytest.mark.slow
def test_a_push_into_the_rib_of_the_kidney_scene_at_all_angles():
    """Whole frames, with their picture."""
    scene = make_scene("kidney")
    skin, tissues = scene.frame, scene.tissues
    rigid = [label for label, material in tissues.materials.items() if material.rigid]
    bone = tissues.labels.position(np.argwhere(np.isin(tissues.labels.voxels, rigid)).astype(float))
    session, pushes, solid = Session(scene), 0, solid_cells(tissues, scene.tissue.grid)
    session.step()
    for aim in bone[np.linspace(0, len(bone) - 1, 3)[:2].astype(int)]:
        for angle in (30.0, 60.0, 90.0, 120.0):
            for swing in (-40.0, 0.0, 40.0):
                command = replace(scene.start.needle, u=0.0, v=0.0, angle=angle, swing=swing, depth=1.0)
                direction = skin.direction(command)
                entry = aim - ((aim - skin.origin) @ skin.depth) / (direction @ skin.depth) * direction
                if scene.tissue.grid.contains(entry[None]).all():
                    push_session(session, entry, direction, solid)
                    pushes += 1
    assert pushes >= 12


def push_session(session, entry, direction, solid):
    session.step(needles={})
    for depth in np.arange(PUSH_MM, 150, PUSH_MM):
        frame = session.step(needles={"needle": ss.Needle(entry, entry + depth * direction)})
        if frame.events:
            moved, det = strain_of(frame.response, solid)
            assert frame.events[0].by == "bone"
            assert moved <= MOST_MM and det >= LEAST_DET, (frame.needle, moved, det)
            return
    pytest.fail(f"from {entry} along {direction} no bone stopped the needle")
