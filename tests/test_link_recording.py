"""What a client of PLUS has recorded, and the files that PLUS opens."""

from threading import Event
from xml.etree import ElementTree

import numpy as np
import pytest

import slicer_core
import sonospline as ss
from link_client import LinkClient
from link_poses import SMALL_BLOCK, turned
from sonospline import igtl
from sonospline.io.pose_sequence import read_pose_sequence
from sonospline.io.sequence_writer import SequenceWriter
from sonospline.link import Scanner
from sonospline.simulator import SceneFile, make_scene
from sonospline.tracking import plus_device_set


def command(client, number, name, **attributes):
    """A command, and its reply."""
    said = " ".join(f'{key}="{value}"' for key, value in {"Name": name, **attributes}.items())
    client.send(igtl.String(f"<Command {said} />"), f"CMD_{number}")
    return ElementTree.fromstring(client.wait_for("STRING", f"ACK_{number}").content.text).attrib


def test_a_client_has_a_recording_made(tmp_path):
    """Its images are those that were sent, to the pixel, with the poses and stamps that were sent with them."""
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0, recordings=tmp_path) as scanner,
        LinkClient(scanner.server.port) as client,
    ):
        assert command(client, 1, "StopRecording")["Status"] == "FAIL"
        for wrong in ("../x.igs.mha", "/etc/x", "a/b", ".hidden", "x" * 200):
            assert (
                "no plain name" in command(client, f"1{len(wrong)}", "StartRecording", OutputFilename=wrong)["Message"]
            )
        assert "hand.igs.mha started" in command(client, 2, "StartRecording", OutputFilename="hand.mha")["Message"]
        assert "is being recorded" in command(client, 3, "StartRecording")["Message"]
        images = [client.wait_for("IMAGE") for _ in range(3)]
        probe = client.wait_for("TRANSFORM", "ProbeToReference")
        stopped = command(client, 4, "StopRecording")["Message"]
        assert stopped.rpartition("/")[2] == "hand.igs.mha"  # where PlusRemote finds the name
        again = command(client, 5, "StartRecording", OutputFilename="hand.igs.mha")["Message"]
        assert again.endswith("hand.igs.mha is there already; give a new name")
        assert str(tmp_path) not in again
    sequence = read_pose_sequence(tmp_path / "hand.igs.mha")
    stamps = [igtl.seconds_of(image.stamp) for image in images]
    places = [int(np.argmin(np.abs(sequence.time_s - stamp))) for stamp in stamps]
    assert np.abs(sequence.time_s[places] - stamps).max() < 1e-5
    rows, columns = images[0].content.voxels.shape[1:]
    data = (tmp_path / "hand.igs.mha").read_bytes()[-len(sequence.time_s) * rows * columns :]
    frames = np.frombuffer(data, np.uint8).reshape(-1, rows, columns)
    for place, image in zip(places, images, strict=True):
        np.testing.assert_array_equal(frames[place], image.content.voxels[0])
        np.testing.assert_allclose(sequence.poses["ImageToReference"][place], image.content.ijk_to_reference, atol=1e-3)
    np.testing.assert_allclose(sequence.poses["ProbeToReference"][0], probe.content.matrix, atol=1e-4)
    assert [file.name for file in tmp_path.iterdir()] == ["hand.igs.mha"]


def test_a_client_has_the_device_set_saved(tmp_path):
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0, recordings=tmp_path) as scanner,
        LinkClient(scanner.server.port) as client,
    ):
        assert "saved as lab.xml" in command(client, 1, "SaveConfig", Filename="lab")["Message"]
        assert "is there already" in command(client, 2, "SaveConfig", Filename="lab.xml")["Message"]
        assert "no plain name" in command(client, 3, "SaveConfig", Filename="../lab.xml")["Message"]
        root = ElementTree.parse(tmp_path / "lab.xml").getroot()
        ports = {device.attrib.get("ServerPort") for device in root.iter("Device")} - {None}
        assert ports == {str(scanner.server.port)}


def test_a_recording_is_written_while_the_link_goes_on(tmp_path, monkeypatch):
    """However long it takes, or fails: others are answered meanwhile, and its reply comes when it is there."""
    begun, may_end, close = Event(), Event(), SequenceWriter.close

    def slow(self):
        begun.set()
        assert may_end.wait(20)
        close(self)

    monkeypatch.setattr(SequenceWriter, "close", slow)
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0, recordings=tmp_path) as scanner,
        LinkClient(scanner.server.port) as client,
    ):
        command(client, 1, "StartRecording", OutputFilename="hand.igs.mha")
        for _ in range(3):  # two may have been on their way
            client.wait_for("IMAGE")
        client.send(igtl.String('<Command Name="StopRecording" />'), "CMD_2")
        assert begun.wait(20)
        again = command(client, 3, "StartRecording", OutputFilename="hand.igs.mha")
        assert "hand.igs.mha is still being written; give another name" in again["Message"]
        assert "Sonospline" in command(client, 4, "Version")["Message"]
        may_end.set()
        assert "successful" in client.wait_for("STRING", "ACK_2").content.text
        assert read_pose_sequence(tmp_path / "hand.igs.mha").time_s.size >= 1
        command(client, 5, "StartRecording", OutputFilename="cut.igs.mha")
        monkeypatch.setattr(SequenceWriter, "close", full_disk)
        failed = command(client, 6, "StopRecording")
        assert failed["Status"] == "FAIL"
        assert "cut.igs.mha could not be written: no space" in failed["Message"]


def full_disk(self):
    with self._pixels:
        raise OSError("no space")


def test_no_reply_names_a_folder_of_this_machine(tmp_path):
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    away = tmp_path / "away"
    with (
        Scanner(ss.Session(scene, model="kelvinlet"), port=0, recordings=away) as scanner,
        LinkClient(scanner.server.port) as client,
    ):
        for number, name in enumerate(("StartRecording", "SaveConfig")):
            said = command(client, number, name)
            assert (said["Status"], "No such file" in said["Message"]) == ("FAIL", True)
            assert str(tmp_path) not in said["Message"]


def test_nothing_is_recorded_without_a_folder():
    scene = make_scene(SceneFile.parse(SMALL_BLOCK))
    with Scanner(ss.Session(scene, model="kelvinlet"), port=0) as scanner, LinkClient(scanner.server.port) as client:
        assert "--recordings" in command(client, 1, "StartRecording")["Message"]


def test_a_sequence_has_one_shape_and_leaves_nothing_behind(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    writer = SequenceWriter(tmp_path / "one.igs.mha", orientation="UF")
    pose = turned(1)
    for number in range(3):
        writer.add(np.full((3, 4), 10 * number, np.uint8), number / 30, {"ProbeToTracker": (pose, number != 1)})
    with pytest.raises(ValueError, match="has one shape"):
        writer.add(np.zeros((4, 3), np.uint8), 1.0, {})
    writer.close()
    image = sitk.ReadImage(str(tmp_path / "one.igs.mha"))
    assert (sitk.GetArrayFromImage(image)[:, 0, 0] == (0, 10, 20)).all()
    assert image.GetMetaData("UltrasoundImageOrientation") == "UF"
    assert image.GetMetaData("Seq_Frame0001_ProbeToTrackerTransformStatus") == "INVALID"
    with pytest.raises(ValueError, match="is there already"):
        SequenceWriter(tmp_path / "one.igs.mha")
    with pytest.raises(ValueError, match="has no frames"):
        SequenceWriter(tmp_path / "two.igs.mha").close()
    assert [file.name for file in tmp_path.iterdir()] == ["one.igs.mha"]


def test_every_channel_of_a_device_set_of_plus_leads_somewhere():
    root = ElementTree.fromstring(plus_device_set(port=18950, host="lab", tools=("Probe", "Stylus"), orientation="UF"))
    devices = {device.attrib["Id"]: device.attrib for device in root.iter("Device")}
    channels = {channel.attrib["Id"] for channel in root.iter("OutputChannel")}
    assert {channel.attrib["Id"] for channel in root.iter("InputChannel")} <= channels
    assert root.find("PlusOpenIGTLinkServer").attrib["OutputChannelId"] in channels
    for name in ("TrackerDevice", "VideoDevice"):
        assert (devices[name]["ServerAddress"], devices[name]["ServerPort"]) == ("lab", "18950")
    names = {f"{source.attrib['Id']}To{devices['TrackerDevice']['ToolReferenceFrame']}"
             for source in root.iter("DataSource") if source.attrib.get("Type") == "Tool"}  # fmt: skip
    assert names == {"ProbeToReference", "StylusToReference"}


def test_a_frame_that_was_cut_off_shifts_none_after_it(tmp_path):
    """A disk that was full for a moment: what of a frame was written is written over."""
    sitk = pytest.importorskip("SimpleITK")
    writer = SequenceWriter(tmp_path / "one.igs.mha")
    pose = {"ProbeToTracker": (turned(1), True)}
    writer.add(np.full((3, 4), 10, np.uint8), 0.0, pose)
    writer._pixels.write(b"half")
    writer.add(np.full((3, 4), 20, np.uint8), 0.1, pose)
    writer.close()
    assert (sitk.GetArrayFromImage(sitk.ReadImage(str(writer.path)))[:, 0, 0] == (10, 20)).all()


@pytest.mark.slow
def test_slicers_core_reads_a_recording(tmp_path):
    """The places of the images as a sequence, step by step; its pixels as a volume."""
    draw = np.random.default_rng(5)
    pixels = draw.integers(0, 255, (6, 9, 12), np.uint8)
    places = [turned(number) for number in range(6)]
    writer = SequenceWriter(tmp_path / "hand.igs.mha")
    for number, (image, place) in enumerate(zip(pixels, places, strict=True)):
        writer.add(image, 10 + number / 8, {"ImageToReference": (place, True), "ProbeToReference": (place, False)})
    writer.close()
    (tmp_path / "pixels.mha").symlink_to(tmp_path / "hand.igs.mha")
    found = slicer_core.read(tmp_path / "hand.igs.mha", tmp_path / "pixels.mha")
    [sequence] = [node for node in found["nodes"] if node["class"] == "vtkMRMLSequenceNode"]
    np.testing.assert_allclose([float(time) for time, _ in sequence["steps"]], 10 + np.arange(6) / 8)
    np.testing.assert_allclose([pose for _, pose in sequence["steps"]], places, atol=1e-4)
    [volume] = [node for node in found["nodes"] if node["class"] == "vtkMRMLScalarVolumeNode"]
    assert volume["size"] == [12, 9, 6]
    assert volume["range"] == [pixels.min(), pixels.max()]
