"""OpenIGTLink against the C library of protocol 3: headers, checks, and every content that it has functions for."""

import ctypes
import struct

import numpy as np
import pytest

import igtl_peers
from sonospline import igtl
from sonospline.igtl.header import SIZE


@pytest.fixture
def protocol_3():
    library = igtl_peers.library_of_protocol_3()
    if library is None:
        igtl_peers.absent("pyFAST, with libOpenIGTLink.so.3,")
    return library


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


@pytest.mark.parametrize("version", [1, 2, 3])
def test_header_and_metadata_of_protocol_3(protocol_3, version):
    """The fields that the library sees in ours, and ours again of those fields as the library writes them."""
    metadata = {"TransformStatus": "OK"} if version > 1 else {}
    message = igtl.Message(
        igtl.Transform(POSE), "NeedleTipToReference", igtl.stamp_of_ns(1_500_000_000), metadata, 77 * (version > 1)
    )
    data = igtl.encode(message, version)
    body = data[SIZE:]
    fields = struct.pack(
        "<H12s20sQQQ", version, b"TRANSFORM", b"NeedleTipToReference", 3 << 31, len(body),
        protocol_3.crc64(body, len(body), 0),
    )  # fmt: skip
    assert turned(protocol_3, "header", data[:SIZE]) == fields
    if version > 1:
        extended = struct.pack("<HHII", 12, 2 + 8, len("TransformStatus" + "OK"), 77)
        assert turned(protocol_3, "extended_header", body[:12]) == extended
        body = turned(protocol_3, "extended_header", extended) + body[12:]
    assert igtl.decode(turned(protocol_3, "header", fields) + body) == message
    assert protocol_3.igtl_nanosec_to_frac(500_000_000) & 0xFFFFFFFF == 1 << 31


TURN = (0, 0, 0.6, 0.8)
COLUMNS = POSE[:3].T.ravel()
LAYOUTS = {
    "transform": (igtl.Transform(POSE), "12f", COLUMNS),
    "position": (igtl.Position((1, 2, 3), TURN), "7f", (1, 2, 3, *TURN)),
    "qtrans": (igtl.QuaternionTransform((1, 2, 3), TURN), "7f", (1, 2, 3, *TURN)),
    "tdata": (
        igtl.TrackingData([igtl.Tool("Needle", POSE), igtl.Tool("Probe", np.eye(4), 3)]), "20sBx12f20sBx12f",
        (b"Needle", 2, *COLUMNS, b"Probe", 3, *np.eye(4)[:3].T.ravel()),
    ),
    "qtdata": (
        igtl.QuaternionTrackingData([
            igtl.QuaternionTool("Needle", (1, 2, 3), TURN), igtl.QuaternionTool("Probe", (0, 0, 0)),
        ]),
        "20sBx7f20sBx7f", (b"Needle", 2, 1, 2, 3, *TURN, b"Probe", 2, 0, 0, 0, 0, 0, 0, 1),
    ),
    "point": (
        igtl.Points([
            igtl.Point((1, 2, 3.5), "stone", "Fiducial", (1, 2, 3, 4), 2.5, "CT"), igtl.Point((4, 5, 6), "entry"),
        ]),
        "64s32s4B4f20s64s32s4B4f20s",
        (b"stone", b"Fiducial", 1, 2, 3, 4, 1, 2, 3.5, 2.5, b"CT",
         b"entry", b"Fiducial", 255, 255, 0, 255, 4, 5, 6, 0, b""),
    ),
    "imgmeta": (
        igtl.ImageList([
            igtl.ImageEntry("Image_CT", (512, 511, 90), "int16", "abdomen", "CT", "A", "7", 5 << 32),
            igtl.ImageEntry("Image_US", (820, 616, 1)),
        ]),
        "64s20s32s64s64sQ3HBx64s20s32s64s64sQ3HBx",
        (b"abdomen", b"Image_CT", b"CT", b"A", b"7", 5 << 32, 512, 511, 90, 4,
         b"", b"Image_US", b"US", b"", b"", 0, 820, 616, 1, 3),
    ),
    "lbmeta": (
        igtl.LabelList([igtl.LabelEntry("Labels", 9, "liver", (1, 2, 3, 4), (300, 200, 100), "Image_CT")]),
        "64s20sBx4B3H20s", (b"liver", b"Labels", 9, 1, 2, 3, 4, 300, 200, 100, b"Image_CT"),
    ),
    "string": (igtl.String("touched bone"), "HH", (3, 12)),
    "status": (igtl.Status(8, "late", "Overflow", -5), "Hq20s", (8, -5, b"Overflow")),
    "sensor": (igtl.Sensor((1.5, -2, 0), igtl.unit("newton")), "BBQ3d", (3, 0, igtl.unit("newton"), 1.5, -2, 0)),
    "command": (igtl.Command(7, "GetTransform", "<Command />"), "I128sHI", (7, b"GetTransform", 3, 11)),
    "stt_tdata": (igtl.Start("TDATA", 50, "Reference"), "i32s", (50, b"Reference")),
    "stt_qtdata": (igtl.Start("QTDATA", 50, "Reference"), "i32s", (50, b"Reference")),
    "rts_tdata": (igtl.Reply("TDATA", False), "b", (1,)),
    "rts_qtdata": (igtl.Reply("QTDATA"), "b", (0,)),
}  # fmt: skip
"""Contents by the names of the library's functions; the part of fixed layout, and the fields in it."""
LISTS = {"tdata": 2, "qtdata": 2, "point": 2, "imgmeta": 2, "lbmeta": 1}


@pytest.mark.parametrize("name", LAYOUTS)
def test_contents_of_fixed_layout_of_protocol_3(protocol_3, name):
    """The fields that the library sees in ours, and ours again of those fields as the library writes them."""
    content, layout, fields = LAYOUTS[name]
    fields, packed = struct.pack(f"<{layout}", *fields), content.packed()

    def convert(data):
        if name != "sensor":
            return turned(protocol_3, name, data, *([LISTS[name]] if name in LISTS else []))
        buffer = ctypes.create_string_buffer(data, len(data))
        protocol_3.igtl_sensor_convert_byte_order(buffer, ctypes.byref(buffer, 10))
        return buffer.raw

    assert convert(packed[: len(fields)]) == fields
    body = convert(fields) + packed[len(fields) :]
    header = struct.pack(
        "<H12s20sQQQ", 1, content.type.encode(), b"x", 0, len(body), protocol_3.crc64(body, len(body), 0)
    )
    assert igtl.decode(turned(protocol_3, "header", header) + body).content == content


class UnitInfo(ctypes.Structure):
    _fields_ = (("prefix", ctypes.c_uint8), ("units", ctypes.c_uint8 * 6), ("powers", ctypes.c_int8 * 6))


def test_units_of_protocol_3(protocol_3):
    info, unit = UnitInfo(), igtl.unit("meter", ("second", -2))
    protocol_3.igtl_unit_pack.restype = ctypes.c_uint64
    assert protocol_3.igtl_unit_unpack(ctypes.c_uint64(unit), ctypes.byref(info))
    assert (list(info.units), list(info.powers)) == ([1, 3, 0, 0, 0, 0], [1, -2, 0, 0, 0, 0])
    assert protocol_3.igtl_unit_pack(ctypes.byref(info)) == unit


class CapabilityInfo(ctypes.Structure):
    _fields_ = (("count", ctypes.c_uint32), ("types", ctypes.POINTER(ctypes.c_void_p)))


def test_capabilities_of_protocol_3(protocol_3):
    """A type of all its twelve bytes has no zero after it on the wire."""
    names = ("IMAGE", "TRANSFORM", "RTS_TWELVE_B")
    packed, info = igtl.Capability(names).packed(), CapabilityInfo()
    protocol_3.igtl_capability_init_info(ctypes.byref(info))
    assert protocol_3.igtl_capability_unpack(packed, ctypes.byref(info), ctypes.c_uint64(len(packed)))
    found = [ctypes.string_at(info.types[number]).decode() for number in range(info.count)]
    assert found == list(names)
    assert protocol_3.igtl_capability_get_length(ctypes.byref(info)) == len(packed)
    again = ctypes.create_string_buffer(len(packed))
    assert protocol_3.igtl_capability_pack(ctypes.byref(info), again)
    assert again.raw == packed
    protocol_3.igtl_capability_free_info(ctypes.byref(info))


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
