"""Files for 3D Slicer and from it: scenes, segmentations, markups; what its own core makes of them."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import ndimage

import slicer_core
import sonospline as ss
from link_poses import SMALL_BLOCK, turned
from simulator_scenes import SMALL_PAPER
from sonospline.cli import main
from sonospline.geometry.label_map import LabelMap
from sonospline.io.labels import read_labels
from sonospline.io.markups import place_of, read_markups, write_markups
from sonospline.io.mrml import Mrml
from sonospline.io.segmentation import Segment, Segmentation, of_labels, read_segmentation, write_segmentation
from sonospline.io.volumes import read_volume, write_volume
from sonospline.link import CoordinateDefinition, ScannerNames, slicer_scene
from sonospline.link.coordinate_frames import CoordinateFrames
from sonospline.link.frame_messages import messages_of
from sonospline.link.needle_pose import waiting_pose
from sonospline.simulator import SceneFile, make_scene

SimpleITK = pytest.importorskip("SimpleITK", reason="needs the extra 'io'")

LIVER = "Segmentation category and type~SCT^123037004^Anatomical Structure~SCT^10200004^Liver~^^~Anatomic codes~^^~^^"


def layers(count=2):
    """A ball and a box, which overlap where there are two layers, on a lattice that lies aslant."""
    k = np.indices((12, 14, 16))
    ball = ((k - np.array([6, 7, 8]).reshape(3, 1, 1, 1)) ** 2).sum(axis=0) < 16
    box = (k > np.array([5, 6, 7]).reshape(3, 1, 1, 1)).all(axis=0)
    axes = turned(3)[:3, :3]
    place = {"spacing": (1.5, 1.0, 2.0), "origin": (5, -6, 7), "direction": axes}
    if count == 1:
        voxels = (np.where(ball, 3, 0) + np.where(box & ~ball, 9, 0)).astype(np.uint8)
        return (ss.Volume(voxels=voxels, **place),), (ball, box & ~ball)
    both = [ss.Volume(voxels=mask.astype(np.uint8), **place) for mask in (ball, box)]
    return tuple(both), (ball, box)


def segmentation(count=2):
    found, masks = layers(count)
    labels = (1, 1) if count == 2 else (3, 9)
    segments = (Segment("liver", labels[0], 0, (0.9, 0.3, 0.2), LIVER), Segment("tumour", labels[1], count - 1))
    return Segmentation(found, segments), masks


@pytest.mark.parametrize("count", [1, 2])
def test_a_segmentation_comes_back(tmp_path, count):
    written, masks = segmentation(count)
    write_segmentation(written, path := tmp_path / "case.seg.nrrd")
    back = read_segmentation(path)
    assert back.segments == written.segments
    assert back.segments[0].codes == ("SCT^123037004^Anatomical Structure", "SCT^10200004^Liver")
    for one, other in zip(back.layers, written.layers, strict=True):
        np.testing.assert_array_equal(one.voxels, other.voxels)
        np.testing.assert_allclose(one.lattice.origin, other.lattice.origin)
        np.testing.assert_allclose(one.lattice.direction, other.lattice.direction, atol=1e-9)
    labels = read_labels(path)
    assert set(labels.names.values()) == {"liver", "tumour"}
    by_name = {name: labels.voxels == number for number, name in labels.names.items()}
    np.testing.assert_array_equal(by_name["tumour"], masks[1])
    np.testing.assert_array_equal(by_name["liver"], masks[0] & ~masks[1])


def test_what_is_no_segmentation_is_refused(tmp_path):
    written, _ = segmentation()
    with pytest.raises(ValueError, match=r"does not end in \.seg\.nrrd"):
        write_segmentation(written, tmp_path / "case.nrrd")
    with pytest.raises(ValueError, match="layer 5"):
        write_segmentation(Segmentation(written.layers, (Segment("a", 1, 5),)), tmp_path / "a.seg.nrrd")
    plain = LabelMap(voxels=written.layers[0].voxels, spacing=(1, 1, 1), names={1: "liver"})
    write_segmentation(Segmentation((plain,), ()), bare := tmp_path / "bare.seg.nrrd")
    with pytest.raises(ValueError, match="names no segments"):
        read_segmentation(bare)
    twice = (Segment("a", 1), Segment("b", 1))
    write_segmentation(Segmentation((plain,), twice), path := tmp_path / "twice.seg.nrrd")
    with pytest.raises(ValueError, match="two segments of one label"):
        read_segmentation(path)
    assert of_labels(plain).segments[0].name == "liver"


@pytest.mark.slow
def test_slicer_and_we_read_each_others_segmentations(tmp_path):
    for count in (1, 2):
        written, masks = segmentation(count)
        write_segmentation(written, path := tmp_path / "ours.seg.nrrd")
        theirs = tmp_path / "theirs.seg.nrrd"
        found = slicer_core.read(path, save=str(theirs))
        [node] = [node for node in found["nodes"] if node["class"] == "vtkMRMLSegmentationNode"]
        assert [segment["name"] for segment in node["segments"]] == ["liver", "tumour"]
        assert [segment["voxels"] for segment in node["segments"]] == [int(mask.sum()) for mask in masks]
        assert "SCT^10200004^Liver" in node["segments"][0]["terminology"]
        assert found["saved"]
        back = read_segmentation(theirs)
        assert [segment.name for segment in back.segments] == ["liver", "tumour"]
        assert "SCT^10200004^Liver" in back.segments[0].codes
        voxels = [int((back.layers[one.layer].voxels == one.label).sum()) for one in back.segments]
        assert voxels == [int(mask.sum()) for mask in masks]


def test_markups_come_back_and_say_what_they_are(tmp_path):
    write_markups({"Entry-1": (1, 2, 3), "Target": (4, 5, 6)}, path := tmp_path / "plan.mrk.json")
    content = json.loads(path.read_text())
    assert content["markups"][0]["controlPoints"][0]["position"] == [-1, -2, 3]  # LPS, as 3D Slicer writes it
    assert place_of(path, "entry").tolist() == [1, 2, 3]
    content["markups"][0] |= {"type": "Line", "coordinateSystem": "RAS"}
    for point, label in zip(content["markups"][0]["controlPoints"], ("L-1", "L-2"), strict=True):
        point["label"] = label
    path.write_text(json.dumps(content))
    assert place_of(path, "target").tolist() == [-4, -5, 6]
    content["markups"][0]["controlPoints"].append(
        {"label": "L-3", "position": [0, 0, 0], "positionStatus": "undefined"}
    )
    path.write_text(json.dumps(content))
    assert len(read_markups(path)[0].points) == 2
    content["markups"][0]["type"] = "Curve"
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="0 points called 'entry' among 2"):
        place_of(path, "entry")
    for wrong in ("{", "[]", '{"markups": [{}]}', '{"markups": [{"controlPoints": [{"position": [1, 2]}]}]}',
                  '{"markups": [{"coordinateUnits": "m", "controlPoints": []}]}'):  # fmt: skip
        path.write_text(wrong)
        with pytest.raises(ValueError, match=r"plan\.mrk\.json.* give a markups file"):
            read_markups(path)


def test_insert_takes_its_needle_from_markups(tmp_path, capsys):
    """The same as by numbers, whatever --frame says of numbers."""
    entry, target = (50.0, 40.0, 0.0), (52.0, 44.0, 20.0)
    write_markups({"entry": entry, "target": target}, plan := tmp_path / "plan.mrk.json")
    voxels = np.random.default_rng(0).random((20, 20, 20))
    write_volume(ss.Volume(voxels=voxels, spacing=(5, 5, 5)), image := tmp_path / "image.nrrd")
    found = []
    for number, (a, b, frame) in enumerate(((str(plan), str(plan), "LPS"), ("50,40,0", "52,44,20", "RAS"))):
        options = (
            f"--frame {frame} --nodes 500 --steps 2 --model kelvinlet --json --quiet --out {tmp_path / str(number)}"
        )
        code = main(["insert", "--volume", str(image), "--entry", a, "--target", b, *options.split()])
        assert code == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["depth_mm"] == found[1]["depth_mm"]
    assert found[0]["max_displacement_mm"] == found[1]["max_displacement_mm"]
    assert (
        main(["insert", "--entry", str(tmp_path / "no.mrk.json"), "--target", "1,2,3", "--out", str(tmp_path / "x")])
        == 2
    )
    assert "no.mrk.json" in capsys.readouterr().err


@pytest.fixture(scope="module")
def session():
    return ss.Session(make_scene(SceneFile.parse(SMALL_PAPER)))


def test_every_reference_in_a_scene_leads_somewhere(session, tmp_path):
    """Every node, file and name that is referred to is there, and the names are those that a link sends."""
    scene = slicer_scene(session, drive=18946, watch="vessel")
    scene.write(tmp_path / "case.mrb")
    with zipfile.ZipFile(tmp_path / "case.mrb") as bundle:
        files = set(bundle.namelist())
        root = ElementTree.fromstring(bundle.read("case/case.mrml"))
    nodes = {node.attrib["id"]: node for node in root}
    assert len(nodes) == len(root) == scene.nodes
    for node in root:
        for reference in filter(None, node.attrib.get("references", "").split(";")):
            assert set(reference.partition(":")[2].split()) <= set(nodes), node.attrib["name"]
        if "fileName" in node.attrib:
            assert f"case/{unquote(node.attrib['fileName'])}" in files
    names = {node.attrib["name"] for node in root}
    frames = CoordinateFrames(ScannerNames())
    sent = {one.device for one in messages_of(session.step(), waiting_pose(session.scene), frames)}
    assert sent - {"TrackerDevice", "Readouts", "NeedleForce"} <= names
    assert {"vessel", "skin", "NeedleModel", "ProbeModel", "ProbeToTracker", "NeedleToTracker"} <= names
    with pytest.raises(ValueError, match="is no model of this scene; choose one of vessel, skin"):
        slicer_scene(session, watch="liver")
    long = ScannerNames(Probe="ProbeToRef", Needle="StylusGripLongToRef", NeedleTip="TipToRef", Target="TargetToRef")
    with pytest.raises(ValueError, match="no message can carry StylusGripLongToTracker"):
        slicer_scene(session, long, drive=18946)
    with pytest.raises(ValueError, match=r"does not end in \.mrb"):
        Mrml().write(tmp_path / "case.zip")


def test_modules_find_what_they_look_for(session):
    """By their sources (SlicerIGT 47c8b3a, SlicerOpenIGTLink d090ca4): tags, roles, attributes and classes of nodes.

    Volume Reslice Driver puts a slice whose mode is 6, transverse, along the image's axes, turned about x by 180
    degrees where it is flipped, with its origin in the image's middle.
    """
    root = ElementTree.fromstring(slicer_scene(session, drive=18946, watch="vessel").text())
    nodes = {node.attrib["id"]: node for node in root}

    def pairs(node, key):
        return dict(part.split(":") for part in filter(None, node.attrib[key].split(";")))

    [warning] = root.findall("BreachWarning")
    model, tool = (nodes[pairs(warning, "references")[role]] for role in ("watchedModelNode", "toolTransformNode"))
    assert (model.tag, tool.tag, tool.attrib["name"]) == ("Model", "LinearTransform", "NeedleTipToReference")

    [red] = [node for node in root.findall("Slice") if node.attrib["layoutName"] == "Red"]
    driver = pairs(red, "attributes")
    assert driver.pop("VolumeResliceDriver.Driver") == next(iter(root.findall("Volume"))).attrib["id"]
    assert driver == {"VolumeResliceDriver.Mode": "6", "VolumeResliceDriver.Flip": "1"}
    plane = session.last.image.plane
    found = np.array(red.attrib["sliceToRAS"].split(), float).reshape(4, 4)
    middle = plane.image_to_reference @ [
        *(0.5 * np.array(plane.spacing_mm) * session.last.image.pixels.shape[::-1]),
        0,
        1,
    ]
    np.testing.assert_allclose(found[:3, :3], plane.image_to_reference[:3, :3] @ np.diag([1, -1, -1]), atol=1e-6)
    np.testing.assert_allclose(found[:3, 3], middle[:3], atol=max(plane.spacing_mm))

    client, server = root.findall("IGTLConnector")
    asked = ("connectorType", "serverHostname", "serverPort", "persistent", "state", "restrictDeviceName")
    assert [client.attrib[name] for name in asked] == ["CLIENT", "localhost", "18944", "1", "2", "0"]
    assert (server.attrib["connectorType"], server.attrib["serverPort"]) == ("SERVER", "18946")
    for id_ in pairs(server, "references")["outgoing"].split():
        assert pairs(nodes[id_], "attributes") == {"OpenIGTLinkIF.pushOnConnect": "true"}
    tags = {"IMAGE": "Volume", "TRANSFORM": "LinearTransform", "POINT": "MarkupsFiducial"}
    sent = messages_of(session.last, waiting_pose(session.scene), CoordinateFrames(ScannerNames()))
    for device, tag in ((one.device, tags.get(one.content.type)) for one in sent):
        assert tag is None or any(node.attrib["name"] == device for node in root.findall(tag)), device


@pytest.mark.slow
def test_slicers_core_records_sequences_of_the_scene(session, tmp_path):
    """Image, transform, surface and fiducials, twice: what its module Sequences has a browser for."""
    slicer_scene(session).write(tmp_path / "case.mrb")
    names = ["NeedleTipToReference", "Image_Reference", "vessel", "Targets"]
    recorded = slicer_core.read(tmp_path / "case.mrb", record=names)["recorded"]
    kinds = [f"vtkMRML{kind}Node" for kind in ("LinearTransform", "ScalarVolume", "Model", "MarkupsFiducial")]
    assert [recorded[name]["classes"] for name in names] == [[kind] * 2 for kind in kinds]
    first, second = recorded["NeedleTipToReference"]["poses"]
    went = np.zeros((4, 4))
    went[0, 3] = 5
    np.testing.assert_allclose(np.array(second) - first, went, atol=1e-9)


@pytest.mark.slow
def test_slicers_core_opens_the_scene(session, tmp_path):
    """Every node is resolved, and image, models, target and needle are where they are in the simulator's world."""
    reference = turned(6)
    definition = CoordinateDefinition(From="Reference", To="Ras", Matrix=tuple(reference.ravel()))
    names = ScannerNames(CoordinateDefinitions=(definition,))
    slicer_scene(session, names, watch="vessel").write(tmp_path / "case.mrb")
    found = slicer_core.read(tmp_path / "case.mrb")
    assert found["unknown"] == ["vtkMRMLIGTLConnectorNode", "vtkMRMLBreachWarningNode"]  # which extensions bring
    nodes = {node["name"]: node for node in found["nodes"]}
    frame = session.last

    def world(name, point):
        return (np.array(nodes[name]["parent_to_world"]) @ [*point, 1])[:3]

    image = nodes["Image_Reference"]
    plane = frame.image.plane
    ijk = np.array(image["parent_to_world"]) @ np.array(image["ijk_to_ras"])
    corner = plane.image_to_reference @ [30 * plane.spacing_mm[0], 20 * plane.spacing_mm[1], 0, 1]
    np.testing.assert_allclose((ijk @ [30, 20, 0, 1]), corner, atol=1e-3)
    assert image["size"] == [*frame.image.pixels.shape[::-1], 1]
    assert image["range"][1] == frame.image.pixels.max()
    for mesh in session.scene.meshes[:2]:
        node = nodes[mesh.name]
        assert (node["points"], node["cells"]) == (len(mesh.points), len(mesh.indices))
        np.testing.assert_allclose(world(mesh.name, node["first"]), mesh.points[0], atol=1e-3)
        np.testing.assert_allclose(world(mesh.name, node["last"]), mesh.points[-1], atol=1e-3)
    [[label, place]] = nodes["Targets"]["points"]
    assert label == "vessel"
    np.testing.assert_allclose(place, frame.target_now, atol=1e-3)
    np.testing.assert_allclose(nodes["ProbeToReference"]["to_world"], frame.probe_to_reference, atol=1e-4)
    tip = waiting_pose(session.scene)
    np.testing.assert_allclose(nodes["NeedleTipToReference"]["to_world"], tip, atol=1e-4)
    length = session.scene.spec.needle.length_mm
    np.testing.assert_allclose(
        world("NeedleModel", nodes["NeedleModel"]["last"]), tip[:3, 3] - length * tip[:3, 2], atol=1e-3
    )
    red = next(node for node in found["nodes"] if node["class"] == "vtkMRMLSliceNode" and node["name"] == "Red")
    assert red["attributes"]["VolumeResliceDriver.Mode"] == "6"
    assert any(node.get("background") == "Image_Reference" for node in found["nodes"])


@pytest.mark.slow
def test_slicers_core_hardens_an_insertion_to_our_images(tmp_path, capsys):
    """The scene of ``insert``: its deformation is SimpleITK's, and makes of image and labels what we have made of them.

    At the deformation's nodes it is the same; between them too, once 3D Slicer interpolates as ITK does. It sets every
    grid that it reads to cubic interpolation, and no file or node of a scene can say otherwise.
    """
    place = {"spacing": (3.0, 3.5, 4.0), "origin": (-20, 30, 10), "direction": turned(8)[:3, :3]}
    draw = np.random.default_rng(3)
    smooth = ndimage.gaussian_filter(draw.random((30, 28, 24)), 2)
    image = ss.Volume(voxels=(1e5 * (smooth - smooth.min())).astype(np.int16), **place)
    write_volume(image, tmp_path / "ct.nrrd")
    corners = image.lattice.world(np.indices((2, 2, 2)).reshape(3, -1).T * image.lattice.extent)
    shape = np.ceil(np.ptp(corners, axis=0) / 4).astype(int) + 1  # upright: else 3D Slicer crops what it hardens
    organs = np.full(shape, 2, np.uint8)
    organs[tuple(slice(n // 3, 2 * n // 3) for n in shape)] = 5
    labels = LabelMap(voxels=organs, names={2: "muscle", 5: "liver"}, spacing=(4, 4, 4), origin=corners.min(axis=0))
    write_segmentation(of_labels(labels), tmp_path / "organs.seg.nrrd")
    entry, target = image.lattice.world(np.array([[0, 50, 40], [60, 52, 50.0]]))
    write_markups({"entry": entry, "target": target}, plan := tmp_path / "plan.mrk.json")
    options = f"--model elastic --nodes 60000 --steps 3 --slicer --quiet --json --out {tmp_path / 'out'}"
    where = ["--volume", str(tmp_path / "ct.nrrd"), "--labels", str(tmp_path / "organs.seg.nrrd")]
    assert main(["insert", *where, "--entry", str(plan), "--target", str(plan), *options.split()]) == 0
    assert "scene.mrb" in json.loads(capsys.readouterr().out)["files"]

    transform = SimpleITK.DisplacementFieldTransform(SimpleITK.ReadTransform(str(tmp_path / "out" / "displacement.h5")))
    grid, lps = transform.GetDisplacementField(), np.array([-1, -1, 1.0])
    indices = draw.integers(2, np.array(grid.GetSize()) - 2, (200, 3)) + draw.uniform(-0.5, 0.5, (200, 3))
    indices[:100] = np.rint(indices[:100])
    points = np.array([grid.TransformContinuousIndexToPhysicalPoint(index) for index in indices.tolist()])
    ours = lps * [transform.TransformPoint(point) for point in points.tolist()]
    files = {"image": str(tmp_path / "image.nrrd"), "labels": str(tmp_path / "labels.seg.nrrd")}
    found = slicer_core.read(tmp_path / "out" / "scene.mrb", from_parent=(lps * points).tolist(), harden=files)
    assert found["unknown"] == []
    assert found["hardened"] == [True, True]
    assert found["interpolation"] == "Cubic"
    assert np.linalg.norm(found["from_parent_linearly"] - ours, axis=1).max() < 1e-4
    off = np.linalg.norm(found["from_parent"] - ours, axis=1)
    assert off[:100].max() < 1e-6
    assert np.quantile(off[100:], 0.9) < 0.008
    assert off.max() < 0.5  # where it is steepest, along the needle
    assert np.linalg.norm(ours - lps * points, axis=1).max() > 0.5

    nodes = {node["name"]: node for node in found["nodes"]}
    needle = np.array(nodes["needle"]["parent_to_world"]) @ [*nodes["needle"]["last"], 1]
    np.testing.assert_allclose(needle[:3], entry, atol=1e-3)
    np.testing.assert_allclose([point for _, point in nodes["path"]["points"]], [entry, target], atol=1e-3)
    assert {segment["name"] for segment in nodes["warped labels"]["segments"]} == {"muscle", "liver"}
    inner = image.lattice.world(
        np.indices((26, 24, 20)).reshape(3, -1).T * place["spacing"] + 2 * np.array(place["spacing"])
    )
    wanted, theirs = read_volume(tmp_path / "out" / "warped.nrrd"), read_volume(tmp_path / "image.nrrd")
    off = np.abs(theirs.sample(inner) - wanted.sample(inner).astype(float))
    assert off.max() < 0.02 * np.ptp(image.voxels)
    assert np.abs(image.sample(inner) - wanted.sample(inner).astype(float)).max() > 0.1 * np.ptp(image.voxels)
    hardened, warped = read_labels(tmp_path / "labels.seg.nrrd"), read_labels(tmp_path / "out" / "warped_labels.nrrd")
    for number, name in ((2, "muscle"), (5, "liver")):
        theirs = np.isin(hardened.sample(inner), [label for label, known in hardened.names.items() if known == name])
        mine = warped.sample(inner) == number
        assert 2 * (theirs & mine).sum() / (theirs.sum() + mine.sum()) > 0.97, name


@pytest.mark.slow
def test_the_verb_writes_a_scene(tmp_path):
    scene = tmp_path / "small.toml"
    scene.write_text(SMALL_BLOCK)
    command = [
        sys.executable,
        "-m",
        "sonospline",
        "slicer-scene",
        "--scene",
        str(scene),
        "--json",
        "--out",
        str(tmp_path / "out"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["files"] == ["sonospline.mrb", "PlusDeviceSet_Sonospline.xml"]
    assert Path(tmp_path, "out", "sonospline.mrb").stat().st_size > 10_000
    wrong = subprocess.run(
        [*command[:-1], str(tmp_path / "no"), "--watch", "liver"], capture_output=True, text=True, check=False
    )
    assert wrong.returncode == 2
    assert "is no model of this scene" in wrong.stderr
    assert not (tmp_path / "no").exists()
