"""Scene files: the shipped ones, the user's own data, and what is wrong with bad ones."""

import json
import re

import numpy as np
import pytest

from simulator_scenes import SMALL
from sonospline.simulator import Console, SceneError, SceneFile, Session, make_scene, organs, scene_schema
from sonospline.simulator.scene_file import line_of
from sonospline.simulator.shipped import SHIPPED
from sonospline.simulator.surfaces import MOST_VERTICES


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_are_well_formed(name):
    spec = SceneFile.shipped(name)
    assert spec.name
    assert spec.description


@pytest.fixture(scope="module")
def scene():
    return make_scene(SceneFile.parse(SMALL))


def test_meshes_are_closed_numbered_and_few(scene):
    assert [(mesh.name, mesh.kind) for mesh in scene.meshes] == [
        ("vessel", "surface"), ("skin", "surface"), ("grid", "lines"),
    ]  # fmt: skip
    assert sum(len(mesh.points) for mesh in scene.meshes) <= MOST_VERTICES
    for mesh in scene.meshes:
        assert set(mesh.indices.ravel()) == set(range(len(mesh.points)))
    vessel = scene.meshes[0]
    assert np.ptp(vessel.points[:, 1]) == pytest.approx(2 * (3.5 + 0.7), abs=1.5)
    edges = np.sort(vessel.indices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()  # a closed surface
    a, b, c = (vessel.points[vessel.indices[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    assert volume == pytest.approx(np.pi * 4.2**2 * 120, rel=0.25)  # of 2 mm voxels; triangles face out


def test_the_skin_faces_out_of_the_tissue(scene):
    skin = scene.meshes[1]
    a, b, c = (skin.points[skin.indices[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a) @ scene.frame.depth < 0).all()
    assert (skin.points[:, 2] == 0).all()


def test_meshes_move_with_the_tissue(scene):
    console = Console(Session(scene, model="paper"))
    field = console.step(scene.start.with_needle(depth=35.0)).field
    moved = scene.deformed(field, grid=True)
    rest = np.concatenate([mesh.points for mesh in scene.meshes])
    assert moved == pytest.approx(field.forward(rest), abs=1e-4)
    assert np.abs(moved - rest).max() > 0.3
    assert len(scene.deformed(field, grid=False)) == len(rest) - len(scene.meshes[-1].points)


@pytest.mark.parametrize(
    ("change", "line", "says"),
    [
        (("nodes = 6000", "nodes = 'many'"), 7, "tissue.nodes = 'many' is of the wrong kind; give a whole number"),
        (("nodes = 6000", "nodes = 5"), 7, "tissue.nodes = 5 is out of range; give a whole number from 1000 to 500000"),
        (("voxel_mm = 1.0", "voxel_mm = nan"), 6, "tissue.voxel_mm = nan is not finite"),
        (("voxel_mm = 1.0", "voxels = 1.0"), 6, "tissue.voxels is not known; use source, file"),
        (("[needle]", "[needles]"), 12, "needles is not known; use name, description, tissue"),
        (
            ('source = "gel block"', 'source = "jelly"'),
            5,
            "tissue.source = 'jelly' is not known; choose one of cube, gel block, kidney",
        ),
        (('source = "gel block"\n', ""), 4, "tissue.source is missing; give one of cube, gel block, kidney"),
        (('source = "gel block"', 'source = "labels"'), 4, "tissue.file is missing; give the file of source"),
        (("at = [70.0, 34.0, 20.0]", "at = [70.0, 34.0]"), 32, "targets[1].at = [70.0, 34.0] is of the wrong kind"),
        (('colour = "#b5483f"', 'colour = "red"'), 37, "surfaces[0].colour = 'red' is no colour; give #rrggbb"),
        (("lines = 64", "lines = 64.5"), 23, "probe.lines = 64.5 is of the wrong kind; give a whole number"),
        (("lines = 64", "lines = "), 23, "is not TOML: Invalid value"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(change, line, says):
    text = SMALL.replace(*change)
    assert text != SMALL
    with pytest.raises(SceneError, match=re.escape(says)) as caught:
        SceneFile.parse(text, file="mine.toml")
    assert (caught.value.file, caught.value.line) == ("mine.toml", line)
    assert str(caught.value).startswith(f"mine.toml, line {line}: ")


def test_the_line_of_what_is_nowhere_is_unknown():
    assert line_of('name = "x"', ("tissue", "source")) is None


def test_the_schema_knows_every_key():
    schema = scene_schema()
    json.dumps(schema)
    assert schema["required"] == ["name", "tissue"]
    assert set(schema["properties"]) == {
        "name", "description", "tissue", "model", "needle", "probe", "targets", "display", "surfaces", "membranes",
        "breathing",
    }  # fmt: skip
    tissue = schema["$defs"]["TissuePart"]
    assert tissue["properties"]["entry_face"] == {
        "enum": ["x+", "x-", "y+", "y-", "z+", "z-"], "default": "z-",
        "description": "the free face, lattice axis and side; the other five are pinned",
    }  # fmt: skip
    assert tissue["properties"]["nodes"]["minimum"] == 1000
    assert schema["$defs"]["TargetPart"]["required"] == ["name", "at"]
    assert not schema["additionalProperties"]


def test_the_documentation_names_every_key():
    from pathlib import Path

    text = (Path(__file__).parents[1] / "docs" / "simulator.md").read_text()

    schema = scene_schema()
    keys = {key for part in (schema, *schema["$defs"].values()) for key in part["properties"]}
    assert len(keys) > 30
    assert [key for key in sorted(keys) if f"`{key}`" not in text and f"[{key}]" not in text] == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("at = [70.0, 34.0, 20.0]", "at = [70.0, 34.0, 200.0]"), "target 'beside' .* lies outside the tissue"),
        (("u = -34.0", "u = -64.0"), r"needle.u = -64 is out of range; give -60 to 60 in this scene"),
        (("right = [1.0, 0.0, 0.0]", "right = [0.0, 0.0, 1.0]"), "square to the entry face z-"),
    ],
)
def test_what_does_not_fit_together_is_refused(change, says):
    with pytest.raises(ValueError, match=says):
        make_scene(SceneFile.parse(SMALL.replace(*change)))


def test_missing_files_and_unknown_names_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"scene = .*none.toml' does not exist"):
        Session(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="scene = 'castle' is not known; choose one of kidney, kidney-wide, gel, cube"):
        Session("castle")
    scene = tmp_path / "mine.toml"
    scene.write_text('name = "mine"\n[tissue]\nsource = "volume"\nfile = "none.mha"\n')
    with pytest.raises(ValueError, match=r"none\.mha"):
        Session(scene)


LABELS = """name = "Abdomen"
[tissue]
source = "labels"
file = "{folder}/abdomen_labels.nii.gz"
entry_face = "{face}"
nodes = 8000
{box}
[model]
solver_nodes = 3000
[probe]
frequency_mhz = 2.0
lines = 64
depth_mm = 100.0
"""


@pytest.mark.slow
def test_a_real_label_map_becomes_a_scene(shared_data):
    """Whole, and a piece of 90 mm of it."""
    scene = _made(LABELS.format(folder=shared_data, face="y+", box=""))
    assert len(scene.meshes) == 8 + 2  # its largest organs, the skin, the grid
    assert scene.spec.model.use == "elastic"
    low, high = scene.box
    middle = (low + high) / 2
    assert scene.targets["middle"] == pytest.approx(middle, abs=3)
    box = f"low = {(middle - 40).tolist()}\nhigh = {(middle + 40).tolist()}"
    scene = _made(LABELS.format(folder=shared_data, face="y+", box=box))
    console = Console(Session(scene))
    frame = console.settle(console.command.with_needle(depth=60.0))
    assert frame.image.pixels.std() > 10
    assert 0.01 < frame.readouts.moved < 20


@pytest.mark.slow
def test_a_real_sweep_becomes_a_scene(shared_data):
    text = f"""name = "Spine phantom"
[tissue]
source = "volume"
file = "{shared_data}/spine_phantom_us.mha"
entry_face = "y-"
nodes = 8000
[model]
solver_nodes = 3000
[probe]
kind = "linear"
depth_mm = 50.0
[needle]
u = 20.0
length_mm = 60.0
"""
    scene = _made(text)
    console = Console(Session(scene))
    before = console.step()
    after = console.settle(console.command.with_needle(depth=30.0))
    assert before.image.mask.mean() > 0.2
    assert (before.image.pixels[~before.image.mask] == 0).all()
    assert (before.image.pixels != after.image.pixels).mean() > 0.1
    shaft = after.image.plane.project(after.needle.at(np.linspace(0.1, 0.9, 20)))
    column, row = np.rint((shaft[:, :2] - after.image.plane.corner_mm) / after.image.plane.spacing_mm).astype(int).T
    inside = (row >= 0) & (row < after.image.pixels.shape[0]) & (column >= 0) & (column < after.image.pixels.shape[1])
    seen = after.image.mask[row[inside], column[inside]]
    assert (after.image.pixels[row[inside], column[inside]][seen] > 200).all()  # the needle is painted
    assert console.step(console.command.with_image(gain=-20.0)).image.pixels.mean() < after.image.pixels.mean()
    with pytest.raises(ValueError, match=r"image.frequency = .* out of range"):
        console.step(console.command.with_image(frequency=9.0))


def _made(text):
    return make_scene(SceneFile.parse(text))


def test_surfaces_are_kept_between_runs(scene, monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    made = scene.draw()
    (kept,) = tmp_path.glob("surfaces-*.npz")
    monkeypatch.setattr(organs, "_contour", None)  # whoever makes surfaces now fails
    for mesh, again in zip(made, scene.draw(), strict=True):
        assert (mesh.name, mesh.colour) == (again.name, again.colour)
        np.testing.assert_array_equal(mesh.points, again.points)
        np.testing.assert_array_equal(mesh.indices, again.indices)
    monkeypatch.undo()
    monkeypatch.setenv("SONOSPLINE_CACHE", str(tmp_path))
    kept.write_bytes(kept.read_bytes()[:100])
    assert len(scene.draw()) == len(made)
    assert "surfaces of organs" in caplog.text
    assert kept.stat().st_size > 100
