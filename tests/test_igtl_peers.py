"""OpenIGTLink against implementations that are not ours: bytes, values and checks, in both directions."""

import dataclasses
import subprocess
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import igtl_peers
from igtl_messages import CONTENTS, text
from sonospline import igtl
from sonospline.igtl.header import SIZE, parse_header

NAMES = st.text("abcdefghijklmnopqrstuvwxyzABCDEFGHIJ0123456789_", min_size=1, max_size=19)
"""The C++ library ends names with a zero in memory: one of twenty bytes fits on the wire alone."""
IN_CPP = (
    "TRANSFORM", "POSITION", "IMAGE", "STATUS", "STRING", "CAPABILITY", "SENSOR", "TDATA", "QTDATA", "POINT", "IMGMETA",
    "LBMETA", "POLYDATA", "NDARRAY", "STT_", "RTS_",
)  # fmt: skip
POSE = np.array([[0, -1, 0, 10], [1, 0, 0, -20], [0, 0, 1, 30.5], [0, 0, 0, 1]])
QUERIES_IN_CPP = (
    *map(igtl.Get, ("TRANSFORM", "IMAGE", "STATUS", "CAPABILITY", "IMGMETA", "LBMETA", "POINT", "POLYDATA")),
    *(igtl.Start(of, 50, "Reference") for of in ("TDATA", "QTDATA")), *map(igtl.Stop, ("TDATA", "QTDATA")),
    *(igtl.Reply(of, ok) for of in ("TDATA", "QTDATA") for ok in (True, False)),
)  # fmt: skip
"""All that it has."""


@pytest.fixture(scope="session")
def programs(tmp_path_factory):
    return tmp_path_factory.mktemp("igtl")


def fitting(content):
    """A content as the C++ library can hold it: shorter names, few units, whole nanoseconds; None where it cannot."""
    match content:
        case igtl.Image():
            return igtl.Image(content.voxels, np.clip(content.axes, -1, 1) + 3 * np.eye(3), content.centre)
        case igtl.Sensor():
            return igtl.Sensor(content.values, igtl.unit("newton")) if len(content.values) else None
        case igtl.Status():
            return igtl.Status(content.code % 20, content.message, content.name[:4], content.subcode)
        case igtl.Start() | igtl.Reply():
            return dataclasses.replace(content, of="TDATA")
        case igtl.TrackingData() | igtl.QuaternionTrackingData():
            tools = [dataclasses.replace(tool, kind=1 + tool.kind % 4) for tool in content.tools]
            return type(content)(tools) if tools else None
        case igtl.ImageList():
            entries = [dataclasses.replace(entry, stamp=entry.stamp >> 32 << 32) for entry in content.entries]
            return igtl.ImageList(entries) if entries else None
        case igtl.PolyData():
            return content if len(content.points) and all(one.kind != "rgba" for one in content.attributes) else None
        case igtl.String():
            return None if "\0" in content.text else content
    return content if content.packed() else None


def drawn(kind, count):
    """Messages of a type, as many as that, that the C++ library can hold."""
    found = []

    @settings(max_examples=5 * count, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(CONTENTS[kind], NAMES, st.integers(0, (1 << 62)))
    def draw(content, name, stamp):
        fit = fitting(content) if len(found) < count else None
        if fit is not None:
            found.append(igtl.Message(fit, name, stamp))

    draw()
    return found


def check_echo(sent, program):
    """Of what we send, the library makes the same again, and the same bytes but where it computes."""
    assert sent
    answer = subprocess.run(
        [program], input=b"".join(map(igtl.encode, sent)), stdout=subprocess.PIPE, check=True, timeout=60
    ).stdout
    for message in sent:
        size = SIZE + parse_header(answer).body_size
        back, answer = igtl.decode(answer[:size]), answer[size:]
        assert back.device == message.device
        assert abs(back.stamp - message.stamp) <= 8  # it counts whole nanoseconds
        if isinstance(message.content, igtl.Image):  # it parts the axes into lengths and directions
            np.testing.assert_allclose(back.content.axes, message.content.axes, rtol=1e-5, atol=1e-3)
            np.testing.assert_array_equal(back.content.centre, message.content.centre)
            np.testing.assert_array_equal(back.content.voxels, message.content.voxels)
        else:
            assert back.content == message.content
    assert not answer


@pytest.mark.parametrize("kind", IN_CPP)
def test_the_cpp_library_understands_and_repeats(kind, programs):
    check_echo(drawn(kind, 3), igtl_peers.built(igtl_peers.ECHO, programs))


@pytest.mark.slow
@pytest.mark.parametrize("kind", IN_CPP)
def test_the_cpp_library_understands_and_repeats_many(kind, programs):
    check_echo(drawn(kind, 15), igtl_peers.built(igtl_peers.ECHO, programs))


def test_the_cpp_library_understands_and_repeats_queries(programs):
    sent = [igtl.Message(query, "Probe", 5 << 32) for query in QUERIES_IN_CPP]
    check_echo(sent, igtl_peers.built(igtl_peers.ECHO, programs))


@pytest.fixture
def pyigtl():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import pyigtl
        except ImportError:
            igtl_peers.absent("pyigtl")
    return pyigtl


def theirs(pyigtl, data):
    """A message as pyigtl reads it."""
    fields = pyigtl.messages.MessageBase.parse_header(data[:SIZE])
    message = pyigtl.messages.MessageBase.create_message(fields["message_type"])
    message.unpack(fields, data[SIZE:])
    return message


@pytest.mark.parametrize("version", [1, 2])
def test_pyigtl_reads_and_writes_the_same(pyigtl, version):
    """All it has, but POSITION, which it writes in the layout of POINT, and POLYDATA read: its reader fails."""
    voxels = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    image = igtl.Image.of(voxels, POSE @ np.diag([0.5, 0.25, 2, 1]))
    metadata = {"Status": "OK"} if version == 2 else {}
    point = igtl.Points(
        [igtl.Point((1, 2, 3), "target"), igtl.Point((4, 5, 6), "entry", "Plan", (1, 2, 3, 4), 2, "CT")]
    )
    colours = igtl.Image.of(np.arange(24, dtype=np.uint8).reshape(1, 2, 4, 3), POSE)
    for content in (image, colours, igtl.Transform(POSE), igtl.String("touched bone"), point):
        data = igtl.encode(igtl.Message(content, "device", 5 << 32, metadata), version)
        message = theirs(pyigtl, data)
        assert (message.device_name, message.timestamp, message.metadata) == ("device", 5, metadata)
        message.header_version = version
        assert igtl.decode(message.pack()) == igtl.decode(data)
    message = theirs(pyigtl, igtl.encode(igtl.Message(image, "device"), version))
    np.testing.assert_array_equal(message.image, voxels)
    np.testing.assert_allclose(message.ijk_to_world_matrix, image.ijk_to_reference, atol=1e-5)
    parts = {"lines": [2, 0, 1], "polygons": [3, 0, 1, 2], "triangle_strips": [4, 0, 1, 2, 3]}
    mesh = pyigtl.PolyDataMessage(points=np.eye(4, 3), device_name="mesh", **parts)
    wanted = igtl.PolyData(np.eye(4, 3), lines=[(0, 1)], polygons=[(0, 1, 2)], strips=[(0, 1, 2, 3)])
    assert igtl.decode(mesh.pack()).content == wanted


def test_names_of_any_letters(pyigtl):
    """UTF-8 in names and texts is the same to pyigtl."""

    @settings(max_examples=20, deadline=None)
    @given(text(20))
    def check(name):
        message = theirs(pyigtl, igtl.encode(igtl.Message(igtl.Transform(POSE), name)))
        assert message.device_name == name.rstrip(" \t\r\n\0")

    check()
