"""What goes out of a frame is where the tissue is: on the wire, in every coordinate system, beside a page."""

import contextlib
import dataclasses
import json
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

import simulator_client
import sonospline as ss
from link_client import LinkClient, eventually
from link_poses import turned
from simulator_scenes import SMALL_PAPER
from sonospline import igtl
from sonospline.geometry import facing
from sonospline.geometry.pose import pose_along
from sonospline.io.volumes import write_volume
from sonospline.link import CoordinateDefinition, PageLink, ScannerNames
from sonospline.link.coordinate_frames import CoordinateFrames
from sonospline.link.frame_messages import messages_of
from sonospline.link.mesh_messages import MeshMessages
from sonospline.link.needle_pose import needle_at
from sonospline.server import wire
from sonospline.simulator import Console, Runner, SceneFile, make_scene
from sonospline.simulator.surfaces import Mesh
from sonospline.tracking import TransformRepository

SPOT = np.array([31.3, 28.7, 24.9])
AXES = {
    "axial": np.eye(3),
    "oblique": Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix(),
    "left-handed": np.diag([1.0, 1, -1]),
}
POSES = {"axial": (0.0, 0.0, "MF"), "oblique": (0.2, 0.4, "UN"), "left-handed": (-0.1, 0.3, "UF")}
"""Of images: how far they tilt and turn, and the orientation they are sent in; one flip of rows or columns mirrors."""
TETRAHEDRON = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
VOLUME = """name = "Spot"
tissue = {{source = "volume", file = "spot.nrrd", entry_face = "z{side}", nodes = 4000}}
probe = {{kind = "linear", depth_mm = 40, lines = 64}}
[[targets]]
name = "spot"
at = [{0}, {1}, {2}]
"""


def sent(frame, tip, names=None, **options):
    """The messages of a frame as a client has them."""
    messages = messages_of(frame, tip, CoordinateFrames(names or ScannerNames()), **options)
    return {message.device: igtl.decode(igtl.encode(message, 2)) for message in messages}


@pytest.fixture(params=AXES)
def spot(request, tmp_path):
    """A session in an image with one bright spot, on a lattice that lies axially, aslant, or is left-handed."""
    axes = AXES[request.param]
    corner = SPOT - axes @ np.array([30, 30, 30])
    ijk = np.stack(np.meshgrid(*[np.arange(61.0)] * 3, indexing="ij"), axis=-1)
    away = (ijk @ axes.T + corner - SPOT) / (1.2, 2.0, 1.6)
    voxels = (250 * np.exp(-0.5 * (away**2).sum(axis=-1))).astype(np.float32)
    write_volume(ss.Volume(voxels=voxels, spacing=(1, 1, 1), origin=corner, direction=axes), tmp_path / "spot.nrrd")
    text = VOLUME.format(*SPOT, side="-")
    scene = make_scene(SceneFile.parse(text), folder=tmp_path)
    look = {"colour": "#ff0000", "opacity": 1.0}
    corners = SPOT + np.vstack([np.zeros(3), 5 * np.eye(3)])
    marker = Mesh(name="marker", kind="surface", points=corners, indices=TETRAHEDRON, **look)
    lines = Mesh(name="grid", kind="lines", points=corners, indices=np.array([(0, 1)]), **look)
    return ss.Session(dataclasses.replace(scene, draw=lambda: (marker, lines)), model="kelvinlet")


@pytest.mark.slow
@pytest.mark.parametrize("pose", POSES)
def test_a_spot_is_at_its_pixel_at_its_fiducial_and_in_its_surface(spot, pose):
    """The middle of the bright pixels, by the place that the wire gives them, is where point, pose and vertex are."""
    skin, (tilt, twist, orientation) = spot.scene.frame, POSES[pose]
    beside = skin.origin + 8 * (skin.right - skin.out)  # in no image: it is bright itself
    needle = ss.Needle(beside, beside + 33 * skin.depth)
    moved = spot.settle(needles={"needle": needle}).target_now
    assert np.linalg.norm(moved - SPOT) > 0.2
    place = facing(
        moved - 22 * skin.depth - 3 * skin.right, depth=skin.depth + tilt * skin.right,
        right=skin.right + twist * skin.out,
    )  # fmt: skip
    place = np.array(place)
    place[:3, 3] += ((moved - place[:3, 3]) @ place[:3, 2]) * place[:3, 2]
    frame = spot.settle(probe_to_reference=place)
    tip = pose_along(needle.tip, needle.direction)
    reference = turned(3)
    definition = CoordinateDefinition(From="Reference", To="Ras", Matrix=tuple(reference.ravel()))
    names = ScannerNames(ImageOrientation=orientation, CoordinateDefinitions=(definition,))
    messages = sent(frame, tip, names)
    image = messages["Image_Reference"].content
    weights = image.voxels[0].astype(float)
    weights[weights < 60] = 0
    j, i = np.indices(weights.shape)
    pixel = [(weights * i).sum() / weights.sum(), (weights * j).sum() / weights.sum(), 0, 1]
    [fiducial] = messages["Targets"].content.entries
    [surface] = MeshMessages(spot.scene, CoordinateFrames(names)).made(frame.field, igtl.now())
    vertex = igtl.decode(igtl.encode(surface)).content.points[0]
    target = messages["TargetToReference"].content.matrix[:3, 3]
    bright = (image.ijk_to_reference @ pixel)[:3]
    for found in (bright, fiducial.position, vertex, target):
        assert np.linalg.norm((reference @ [*found, 1])[:3] - moved) < 0.05
    assert np.linalg.det(image.axes) > 0
    back = reference @ messages["NeedleTipToReference"].content.matrix
    np.testing.assert_allclose(back[:3, 3], needle.tip, atol=1e-4)
    assert len({message.stamp for message in messages.values()}) == 1


@pytest.mark.parametrize("orientation", ["MF", "UF", "MN", "UN"])
def test_orientations_show_the_same_pixels_at_the_same_places(orientation):
    frame = small().step()
    images = [
        sent(frame, np.eye(4), ScannerNames(ImageOrientation=each))["Image_Reference"].content
        for each in ("MF", orientation)
    ]
    for i, j in ((0, 0), (5, 17), (40, 2)):
        place = images[0].ijk_to_reference @ (i, j, 0, 1)
        other = np.rint(np.linalg.inv(images[1].ijk_to_reference) @ place).astype(int)
        assert images[1].voxels[0, other[1], other[0]] == images[0].voxels[0, j, i]
    side, way = images[1].axes.T[:2] @ images[0].axes.T[:2].T
    assert (side[0] < 0, way[1] < 0) == (orientation[0] == "U", orientation[1] == "N")


def small(model="paper"):
    return ss.Session(make_scene(SceneFile.parse(SMALL_PAPER)), model=model)


@pytest.mark.slow
def test_meshes_go_where_the_tissue_goes():
    pytest.importorskip("vtkmodules")
    session = small("kelvinlet")
    frame = session.settle(needles={"needle": ss.Needle((40, 30, 0), (62, 30, 26))})
    reference = turned(5)
    definition = CoordinateDefinition(From="Reference", To="Ras", Matrix=tuple(reference.ravel()))
    frames = CoordinateFrames(ScannerNames(CoordinateDefinitions=(definition,)))
    messages = MeshMessages(session.scene, frames).made(frame.field, igtl.now())
    assert [message.device for message in messages] == ["vessel", "skin"]
    content = igtl.decode(igtl.encode(messages[0])).content
    rest = session.scene.meshes[0].points
    went = content.points @ reference[:3, :3].T + reference[:3, 3]
    np.testing.assert_allclose(went, frame.field.forward(rest), atol=0.01)
    [moved] = content.attributes
    assert moved.name == "moved_mm"
    assert moved.values.max() > 0.3
    np.testing.assert_allclose(moved.values[:, 0], np.linalg.norm(went - rest, axis=1), atol=0.01)


def test_meshes_come_no_more_often_than_asked_for():
    session = small()
    field = session.step().field
    meshes = MeshMessages(session.scene, CoordinateFrames(ScannerNames(MeshRate=1.0)))
    assert eventually(lambda: meshes.of(field, 0))
    assert not meshes.of(field, 0)
    assert not MeshMessages(session.scene, CoordinateFrames(ScannerNames(MeshRate=0.0))).of(field, 0)


@given(st.integers(0, 2**32 - 1), st.lists(st.sampled_from("ABCDEF"), min_size=2, max_size=6, unique=True))
@settings(max_examples=12, deadline=None)
def test_transforms_are_composed_whichever_way_they_were_given(seed, frames):
    draw = np.random.default_rng(seed)
    world = {frame: turned(seed + k) for k, frame in enumerate(frames)}
    known = TransformRepository()
    for a, b in pairwise(frames):
        source, target = (a, b) if draw.random() < 0.5 else (b, a)
        known.set(f"{source}To{target}", np.linalg.inv(world[target]) @ world[source])
    a, b = frames[0], frames[-1]
    np.testing.assert_allclose(known.get(f"{a}To{b}"), np.linalg.inv(world[b]) @ world[a], atol=1e-9)
    if len(frames) > 2:
        with pytest.raises(ValueError, match="known already"):
            known.set(f"{a}To{b}", np.eye(4))
    with pytest.raises(ValueError, match="is not known"):
        known.get(f"{a}ToNowhere")


def test_a_calibration_of_plus_says_where_the_face_is():
    """Its image's pixels of 0.1 mm: the middle of the face is 40 pixels to the right, 5 above the first row."""
    probe = turned(7)
    to_probe = probe @ np.diag([0.1, 0.1, 0.1, 1])
    to_pixel = np.eye(4)
    to_pixel[:2, 3] = -40, 5
    definitions = [("Image", "Probe", to_probe), ("Image", "TransducerOriginPixel", to_pixel)]
    names = ScannerNames(
        CoordinateDefinitions=tuple(
            CoordinateDefinition(From=a, To=b, Matrix=tuple(m.ravel())) for a, b, m in definitions
        )
    )
    shift = np.eye(4)
    shift[:2, 3] = 4.0, -0.5
    np.testing.assert_allclose(CoordinateFrames(names).face_to_probe, probe @ shift, atol=1e-9)


def test_the_scene_of_plus_finds_its_names():
    """What PLUS's simulated ultrasound for 3D Slicer asks for and sends, and its calibration, by its device set.

    PlusLibData 51dcbb7, ConfigFiles/PlusDeviceSet_Server_SimulatedUltrasound_3DSlicer.xml.
    """
    names = ScannerNames().with_tracker("localhost:18946")
    assert names.Devices[0].transforms == ("ProbeToTracker", "NeedleToTracker", "ReferenceToTracker")
    assert (names.Image, names.Probe, names.NeedleTip) == (
        "Image_Reference",
        "ProbeToReference",
        "NeedleTipToReference",
    )
    to_probe = [-0.00228039, 0.0860508, -0.00121134, 52.5973, -0.0860501, -0.00229763, -0.00122624, 35.9178,
                -0.00125802, 0.0011783, 0.0860722, 16.3705, 0, 0, 0, 1]  # fmt: skip
    to_pixel = [1.0, 0, 0, -410, 0, 1, 0, 5, 0, 0, 1, 0, 0, 0, 0, 1]
    definitions = (
        CoordinateDefinition(From="Image", To="Probe", Matrix=tuple(to_probe)),
        CoordinateDefinition(From="Image", To="TransducerOriginPixel", Matrix=tuple(to_pixel)),
    )
    face = CoordinateFrames(replace(names, CoordinateDefinitions=definitions)).face_to_probe
    np.testing.assert_allclose(face[:3, 3], (np.reshape(to_probe, (4, 4)) @ (410, -5, 0, 1))[:3], atol=1e-9)
    assert face[:3, 0] @ (0, -1, 0) > 0.99


@pytest.mark.slow
def test_force_goes_out_as_asked_for():
    session = ss.Session(make_scene(SceneFile.parse(SMALL_PAPER)), model="elastic")
    frame = session.settle(needles={"needle": ss.Needle((40, 30, 0), (60, 30, 24))})
    names = ScannerNames(ForceTypes=("SENSOR", "STRING", "NDARRAY"), TransformNames=("ImageToProbe",))
    messages = messages_of(frame, np.eye(4), CoordinateFrames(names))
    sensor, text, array = (one.content for one in messages if one.device == "NeedleForce")
    force = frame.forces["needle"]
    assert np.linalg.norm(force.force_n) > 0.01
    np.testing.assert_allclose(sensor.values, force.force_n)
    np.testing.assert_allclose(array.array, force.force_n)
    assert json.loads(text.text) == {
        "force_n": pytest.approx(list(force.force_n)),
        "axial_n": pytest.approx(force.axial_n),
    }
    [composed] = [one.content.matrix for one in messages if one.device == "ImageToProbe"]
    image = next(one.content for one in messages if one.device == "Image_Reference")
    np.testing.assert_allclose(frame.probe_to_reference @ composed, image.ijk_to_reference, atol=1e-4)


def test_a_page_and_the_link_show_the_same_frames():
    console, of_page = Console(small()), {}
    with PageLink(port=0) as link, Runner(console) as runner, LinkClient(link.server.port) as client:
        runner.subscribe(lambda frame, stamp: of_page.update({frame.number: frame}), capacity=64, when_full="refuse")
        link.watch(runner)
        command = console.scene.start.with_needle(depth=12)
        runner.submit(command, 1)
        shown, depths = [], set()
        while len(shown) < 4 or 12 not in depths:
            pixels = client.wait_for("IMAGE").content.voxels[0]
            said = json.loads(client.wait_for("STRING", "Readouts").content.text)
            shown.append((said["frame"], pixels))
            depths.add(round(said["depth_mm"], 6))
        pose = pose_along(*_needle_of(console, 17.0))
        client.send(igtl.Transform(pose), "NeedleToReference")
        while json.loads(client.wait_for("STRING", "Readouts").content.text)["depth_mm"] != pytest.approx(17, abs=1e-3):
            pass
        assert eventually(lambda: all(number in of_page for number, _ in shown))
        runner.do(lambda console: time.sleep(0))
    for number, pixels in shown:
        np.testing.assert_array_equal(pixels, of_page[number].image.pixels)
    assert needle_at(pose, console.scene.frame).depth == pytest.approx(17)


def _needle_of(console, depth):
    skin, needle = console.scene.frame, console.scene.start.needle
    direction = skin.direction(needle)
    return skin.entry(needle) + depth * direction, direction


def test_a_tracker_takes_nothing_away_from_the_page():
    """Settings that a page asks for at the same moment as poses come in are kept, and so is the number it waits for."""
    console = Console(small())
    with PageLink(port=0) as link, Runner(console) as runner, LinkClient(link.server.port) as client:
        numbers = []
        runner.subscribe(lambda frame, stamp: numbers.append(stamp.seq))
        link.watch(runner)
        client.wait_for("IMAGE")
        tip, direction = _needle_of(console, 9.0)
        for number in range(1, 40):
            image = replace(console.scene.start.image, gain=float(number % 7))
            client.send(igtl.Transform(pose_along(tip, direction)), "NeedleToReference")
            runner.submit(replace(console.command, image=image), number)
        assert eventually(lambda: 39 in numbers)
        assert eventually(lambda: console.last.settings.gain == 39 % 7)
        client.send(igtl.Transform(pose_along(tip, direction)), "NeedleToReference")
        assert eventually(lambda: console.last.command.needle.depth == pytest.approx(9))
        assert console.last.settings.gain == 39 % 7
        assert numbers == sorted(numbers)


@pytest.mark.slow
def test_a_server_shows_its_page_on_a_link():
    with PageLink(port=0) as link, contextlib.ExitStack() as stack:
        running = simulator_client.Running(watch=link.watch)
        stack.callback(running.stop)
        page = stack.enter_context(simulator_client.Client(running)).ready()
        client = stack.enter_context(LinkClient(link.server.port))
        seq, of_page = page.ask(depth=11.0), []
        sent, deepest = [], 0.0
        while deepest < 11 or len(sent) < 3:
            header, payload = page.frame(seq)
            of_page.append(wire.read_pixels(header, payload).tobytes())
            message = client.wait_for("IMAGE")
            sent.append(message.content.voxels[0].tobytes())
            deepest = json.loads(client.wait_for("STRING", "Readouts").content.text)["depth_mm"]
        for _ in range(20):  # what was sent last is drawn by then
            header, payload = page.frame()
            of_page.append(wire.read_pixels(header, payload).tobytes())
        assert set(sent) & set(of_page)
