"""OpenIGTLink against implementations that are not ours: bytes, values and checks, in both directions."""

import ctypes
import dataclasses
import struct
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
def protocol_3():
    library = igtl_peers.library_of_protocol_3()
    if library is None:
        igtl_peers.absent("pyFAST, with libOpenIGTLink.so.3,")
    return library


BLOCK = igtl.Message(igtl.String("a" * 37), "x")
POSE = np.array([[0, -1, 0, 10], [1, 0, 0, -20], [0, 0, 1, 30.5], [0, 0, 0, 1]])


def turned(library, name, data, *more):
    """Bytes in network order as the library's own function makes them those of the machine."""
    buffer = ctypes.create_string_buffer(bytes(data), len(data))
    getattr(library, f"igtl_{name}_convert_byte_order")(buffer, *more)
    return buffer.raw


def test_checks_of_protocol_3(protocol_3):
    for length in (0, 1, 7, 63, 64, 65, 1000, 820 * 616):
        data = np.random.default_rng(length).bytes(length)
        assert igtl.crc64(data) == protocol_3.crc64(data, length, 0)


def test_header_and_metadata_of_protocol_3(protocol_3):
    message = igtl.Message(
        igtl.Transform(POSE), "NeedleTipToReference", igtl.stamp_of_ns(1_500_000_000), {"TransformStatus": "OK"}, 77
    )
    data = igtl.encode(message, 2)
    version, type_, device, stamp, size, crc = struct.unpack("<H12s20sQQQ", turned(protocol_3, "header", data[:SIZE]))
    assert (version, type_.rstrip(b"\0"), device) == (2, b"TRANSFORM", b"NeedleTipToReference")
    assert (stamp, size) == (3 << 31, len(data) - SIZE)
    assert crc == protocol_3.crc64(data[SIZE:], size, 0)
    extended = struct.unpack("<HHII", turned(protocol_3, "extended_header", data[SIZE : SIZE + 12]))
    assert extended == (12, 2 + 8, len("TransformStatus" + "OK"), 77)
    assert protocol_3.igtl_nanosec_to_frac(500_000_000) & 0xFFFFFFFF == 1 << 31


def test_contents_of_fixed_layout_of_protocol_3(protocol_3):
    values = struct.unpack("<12f", turned(protocol_3, "transform", igtl.Transform(POSE).packed()))
    np.testing.assert_array_equal(np.reshape(values, (4, 3)).T, POSE[:3])
    position = igtl.Position((1, 2, 3), (0, 0, 0.6, 0.8))
    for name, content in (("position", position), ("qtrans", igtl.QuaternionTransform(position.position))):
        assert struct.unpack("<3f", turned(protocol_3, name, content.packed())[:12]) == (1, 2, 3)
    tools = igtl.TrackingData([igtl.Tool("Needle", POSE), igtl.Tool("Probe", np.eye(4), 3)]).packed()
    second = struct.unpack("<20sBx12f", turned(protocol_3, "tdata", tools, 2)[70:])
    assert (second[0].rstrip(b"\0"), second[1], second[2:5]) == (b"Probe", 3, (1, 0, 0))
    tools = igtl.QuaternionTrackingData([igtl.QuaternionTool("Needle", (1, 2, 3), (0, 0, 0.6, 0.8))]).packed()
    assert struct.unpack("<20sBx7f", turned(protocol_3, "qtdata", tools, 1))[2:5] == (1, 2, 3)
    status = igtl.Status(8, "late", "Overflow", -5).packed()
    assert struct.unpack("<Hq20s", turned(protocol_3, "status", status[:30]))[:2] == (8, -5)
    force = igtl.Sensor((1.5, -2, 0), igtl.unit("newton")).packed()
    data = ctypes.create_string_buffer(force, len(force))
    protocol_3.igtl_sensor_convert_byte_order(data, ctypes.byref(data, 10))
    assert struct.unpack("<BBQ3d", data.raw) == (3, 0, igtl.unit("newton"), 1.5, -2, 0)
    command = igtl.Command(7, "GetTransform", "<Command />").packed()
    assert struct.unpack("<I128sHI", turned(protocol_3, "command", command[:138]))[::3] == (7, 11)
    start = igtl.Start("TDATA", 50, "Reference").packed()
    assert struct.unpack("<i32s", turned(protocol_3, "stt_tdata", start))[0] == 50


def test_images_of_protocol_3(protocol_3):
    """Its own function gives matrix, spacing and middle."""
    place = POSE.copy()
    place[:3, :3] *= [0.5, 0.25, 2]
    image = igtl.Image.of(np.zeros((1, 3, 5), np.uint8), place)
    header = ctypes.create_string_buffer(turned(protocol_3, "image", image.packed()[:72]), 72)
    protocol_3.igtl_image_get_data_size.restype = ctypes.c_uint64
    assert protocol_3.igtl_image_get_data_size(header) == 15
    spacing, middle, *axes = ((ctypes.c_float * 3)() for _ in range(5))
    protocol_3.igtl_image_get_matrix(spacing, middle, *axes, header)
    np.testing.assert_allclose(spacing, (0.5, 0.25, 2), rtol=1e-6)
    np.testing.assert_allclose(middle, (place @ (2, 1, 0, 1))[:3], rtol=1e-6)
    np.testing.assert_allclose(np.transpose([list(axis) for axis in axes]), POSE[:3, :3], atol=1e-6)


class NdarrayInfo(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_uint8), ("dim", ctypes.c_uint8), ("size", ctypes.POINTER(ctypes.c_uint16)),
        ("array", ctypes.c_void_p),
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["uint8", "int16", "float32", "float64"])
def test_arrays_of_protocol_3(protocol_3, kind):
    array = (10 * np.random.default_rng(2).random((2, 3, 4))).astype(kind)
    packed, info = igtl.NumberArray(array).packed(), NdarrayInfo()
    protocol_3.igtl_ndarray_init_info(ctypes.byref(info))
    assert protocol_3.igtl_ndarray_unpack(0, packed, ctypes.byref(info), ctypes.c_uint64(len(packed)))
    assert info.size[: info.dim] == [2, 3, 4]
    assert ctypes.string_at(info.array, array.nbytes) == array.tobytes()
    again = ctypes.create_string_buffer(len(packed))
    assert protocol_3.igtl_ndarray_pack(ctypes.byref(info), again, 0)
    assert again.raw == packed
    protocol_3.igtl_ndarray_free_info(ctypes.byref(info))


class PolydataInfo(ctypes.Structure):
    _fields_ = (
        ("header", ctypes.c_uint32 * 10), ("points", ctypes.POINTER(ctypes.c_float)),
        *((name, ctypes.POINTER(ctypes.c_uint32)) for name in ("vertices", "lines", "polygons", "strips")),
        ("attributes", ctypes.c_void_p),
    )  # fmt: skip


def test_meshes_of_protocol_3(protocol_3):
    points = np.random.default_rng(4).random((5, 3))
    mesh = igtl.PolyData(
        points, lines=[(0, 1)], polygons=[(0, 1, 2), (1, 2, 3, 4)],
        attributes=[igtl.Attribute("displacement", points, "vectors"), igtl.Attribute("organ", np.arange(5))],
    )  # fmt: skip
    packed, info = mesh.packed(), PolydataInfo()
    protocol_3.igtl_polydata_init_info(ctypes.byref(info))
    assert protocol_3.igtl_polydata_unpack(0, packed, ctypes.byref(info), ctypes.c_uint64(len(packed)))
    assert list(info.header) == [5, 0, 0, 1, 12, 2, 36, 0, 0, 2]
    np.testing.assert_array_equal(np.ctypeslib.as_array(info.points, (5, 3)), points.astype(np.float32))
    assert info.polygons[:9] == [3, 0, 1, 2, 4, 1, 2, 3, 4]
    again = ctypes.create_string_buffer(len(packed))
    assert protocol_3.igtl_polydata_pack(ctypes.byref(info), again, 0)
    assert again.raw == packed
    protocol_3.igtl_polydata_free_info(ctypes.byref(info))


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


@pytest.mark.parametrize("version", [1, 2])  # POSITION is left out: it writes those in the layout of POINT
def test_pyigtl_reads_and_writes_the_same(pyigtl, version):
    voxels = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    image = igtl.Image.of(voxels, POSE @ np.diag([0.5, 0.25, 2, 1]))
    metadata = {"Status": "OK"} if version == 2 else {}
    point = igtl.Points([igtl.Point((1, 2, 3), "target")])
    for content in (image, igtl.Transform(POSE), igtl.String("touched bone"), point):
        data = igtl.encode(igtl.Message(content, "device", 5 << 32, metadata), version)
        message = theirs(pyigtl, data)
        assert (message.device_name, message.timestamp, message.metadata) == ("device", 5, metadata)
        message.header_version = version
        assert igtl.decode(message.pack()) == igtl.decode(data)
    message = theirs(pyigtl, igtl.encode(igtl.Message(image, "device"), version))
    np.testing.assert_array_equal(message.image, voxels)
    np.testing.assert_allclose(message.ijk_to_world_matrix, image.ijk_to_reference, atol=1e-5)
    mesh = pyigtl.PolyDataMessage(points=np.eye(3), polygons=[3, 0, 1, 2], device_name="mesh")
    assert igtl.decode(mesh.pack()).content == igtl.PolyData(np.eye(3), polygons=[(0, 1, 2)])


def test_names_of_any_letters(pyigtl):
    """UTF-8 in names and texts is the same to pyigtl."""

    @settings(max_examples=20, deadline=None)
    @given(text(20))
    def check(name):
        message = theirs(pyigtl, igtl.encode(igtl.Message(igtl.Transform(POSE), name)))
        assert message.device_name == name.rstrip(" \t\r\n\0")

    check()
