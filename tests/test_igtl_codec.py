"""The codec of OpenIGTLink: every type there and back, the bytes of others, and what is no message."""

import random
import re
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from igtl_messages import CONTENTS, messages
from sonospline import _core, igtl
from sonospline._core import twin
from sonospline.igtl.header import SIZE, parse_header

LINES = (Path(__file__).parent / "igtl_vectors.txt").read_text().splitlines()[1:]
VECTORS = {name: bytes.fromhex(data) for name, data in (line.split(": ") for line in LINES)}
"""What the C++ library packs, published with its tests."""
AGE = {"First patient age": "22", "Second patient age": "25"}


def check_there_and_back(kind, examples):
    @settings(max_examples=examples, deadline=None)
    @given(messages(CONTENTS[kind]))
    def check(message):
        for version in (1, 2, 3):
            data = igtl.encode(message, version)
            back = igtl.decode(data)
            assert back.content == message.content
            assert hash(back.content) == hash(message.content)
            assert (back.device, back.stamp) == (message.device, message.stamp)
            assert igtl.encode(back, version) == data
            assert parse_header(data).type.startswith(kind)
        assert back == message

    check()


@pytest.mark.parametrize("kind", CONTENTS)
def test_every_message_comes_back(kind):
    check_there_and_back(kind, 6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONTENTS)
def test_very_many_messages_come_back(kind):
    check_there_and_back(kind, 60)


@pytest.mark.parametrize("name", VECTORS)
def test_bytes_of_the_cpp_library(name):
    message = igtl.decode(VECTORS[name])
    assert message.content.type == name.split(",")[0]
    assert igtl.encode(message, VECTORS[name][1]) == VECTORS[name]
    assert message.metadata == (AGE if "metadata" in name else {})


def test_what_the_cpp_library_says_is_understood():
    """Numbers as the sources of its tests set them."""
    found = {name: igtl.decode(data) for name, data in VECTORS.items()}
    pose = found["TRANSFORM"].content.matrix
    np.testing.assert_allclose(pose[:3, 3], (46.0531, 19.4709, 46.0531), rtol=1e-6)
    np.testing.assert_allclose(pose[:3, 0], (-0.954892, 0.196632, -0.222525), rtol=1e-6)
    assert found["STATUS"].content == igtl.Status(15, "Actuator A is disabled.", "ACTUATOR_DISABLED", 10)
    assert found["STRING"].content.text == "Welcome to OpenIGTLink"
    assert [point.name for point in found["POINT"].content.entries] == [f"POINT_DESCRIPTION_{i}" for i in range(3)]
    assert found["POINT"].content.entries[0].position.tolist() == [10, 15, 20]
    assert (found["NDARRAY"].content.array == np.arange(60.0).reshape(5, 4, 3)).all()
    assert found["SENSOR"].content.unit == igtl.unit("meter", ("second", -2))
    assert found["TRANSFORM"].stamp == 1234567892
    assert [tool.name for tool in found["TDATA"].content.tools] == ["Tracker0", "Tracker1", "Tracker2"]
    assert found["POLYDATA"].content.points.shape == (8, 3)
    assert found["COMMAND"].content == igtl.Command(5, "This is a test command", "Start the tracking machine")


@pytest.mark.parametrize("core", [twin, *([_core.native] if _core.native else [])], ids=lambda core: core.__name__)
def test_check_of_the_standard(core):
    """CRC-64/ECMA-182 of "123456789", as catalogues of checks have it."""
    assert core.crc64(np.frombuffer(b"123456789", np.uint8), 0) == 0x6C40DF5F0B497347


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 9000), st.integers(0, (1 << 64) - 1), st.integers(0, 9000))
def test_checks_go_on_and_are_the_same_whoever_computes_them(length, start, cut):
    data = np.random.default_rng(length).integers(0, 256, length).astype(np.uint8)
    whole = twin.crc64(data, start)
    assert twin.crc64(data[cut:], twin.crc64(data[:cut], start)) == whole
    if _core.native:
        for name in _core.native.instruction_sets():
            _core.native.use_instruction_set(name)
            assert _core.native.crc64(data, start) == whole
        _core.native.use_instruction_set(_core.native.instruction_sets()[0])


def test_places_of_images():
    """Of an asymmetric image, oblique and left-handed: the wire has the middle, in RAS."""
    voxels = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    for flip in (1, -1):
        steps = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0] * [0.5, 0.7, 2 * flip]
        place = np.eye(4)
        place[:3] = np.column_stack([steps, (10, -20, 30)])
        message = igtl.decode(igtl.encode(igtl.Message(igtl.Image.of(voxels, place), "Image_Reference")))
        np.testing.assert_allclose(message.content.ijk_to_reference, place, atol=1e-5)
        first, last = place @ (0, 0, 0, 1), place @ (3, 2, 1, 1)
        np.testing.assert_allclose(message.content.centre, (first + last)[:3] / 2, atol=1e-5)
        assert (message.content.voxels == voxels).all()


def test_image_that_comes_in_lps_and_big_endian():
    image = igtl.Image.of(np.arange(6, dtype=np.int16).reshape(1, 2, 3), np.diag([2.0, 3, 1, 1]))
    data = bytearray(image.packed())
    assert data[5] == 1  # what we send is RAS
    data[4], data[5] = 1, 2
    data[72:] = image.voxels.astype(">i2").tobytes()
    back = igtl.Image.unpacked(_reader(bytes(data)))
    assert (back.voxels == image.voxels).all()
    np.testing.assert_array_equal(back.axes, image.axes * np.array([[-1], [-1], [1]]))
    np.testing.assert_array_equal(back.centre, image.centre * [-1, -1, 1])


def _reader(data):
    from sonospline.igtl.wire import Reader

    return Reader(data, "IMAGE 'x'")


def framed(type_, body, device=b"x", version=1, crc=None):
    """A message of any bytes, its check right unless another is given."""
    crc = igtl.crc64(body) if crc is None else crc
    return struct.pack(">H12s20sQQQ", version, type_, device, 0, len(body), crc) + body


SOUND = igtl.encode(igtl.Message(igtl.Transform(np.eye(4)), "NeedleToReference"))
NAN = struct.pack(">12f", *[np.nan] * 12)
IMAGE = igtl.Image.of(np.zeros((1, 2, 2), np.uint8), np.eye(4)).packed()
HUGE = b"\xff" * 6
MESH = igtl.PolyData([(0, 0, 0)] * 3, polygons=[(0, 1, 2)]).packed()


def changed(data, at, *values):
    return data[:at] + bytes(values) + data[at + len(values) :]


WRONG = {
    "check": (framed(b"TRANSFORM", NAN, crc=1), igtl.ChecksumError, "TRANSFORM 'x'.*check"),
    "body size": (SOUND[:42] + b"\xff" * 8 + SOUND[50:], igtl.TooLargeError, "18446744073709551615 bytes; at most"),
    "type": (framed(b"NOVELTY", b""), igtl.UnknownTypeError, "NOVELTY 'x'"),
    "query of an unknown type": (framed(b"GET_COLORT", b""), igtl.UnknownTypeError, "GET_COLORT"),
    "type of two lines": (framed(b"A\nB", b""), igtl.UnknownTypeError, r"'A\\nB'"),
    "version": (framed(b"TRANSFORM", bytes(48), version=4), igtl.UnknownVersionError, "version 4; known are 1, 2, 3"),
    "version 0": (framed(b"TRANSFORM", bytes(48), version=0), igtl.UnknownVersionError, "version 0"),
    "cut header": (SOUND[:57], igtl.SizeError, "58 bytes; 57"),
    "cut body": (SOUND[:-1], igtl.SizeError, "106 bytes; 105"),
    "short body": (framed(b"TRANSFORM", bytes(47)), igtl.SizeError, "ends 1 too early"),
    "long body": (framed(b"TRANSFORM", bytes(49)), igtl.SizeError, "1 more"),
    "query with a body": (framed(b"GET_IMAGE", b"1"), igtl.SizeError, "1 more"),
    "NaN": (framed(b"TRANSFORM", NAN), igtl.ContentError, "TRANSFORM 'x' holds NaN or infinity"),
    "NaN in a mesh": (framed(b"POLYDATA", changed(MESH, 40, 0x7F, 0xC0)), igtl.ContentError, "NaN"),
    "extended header": (framed(b"STATUS", bytes(40), version=2), igtl.SizeError, "extended header says 0"),
    "metadata": (framed(b"STATUS", struct.pack(">HHII", 12, 9, 2**32 - 1, 0), version=2), igtl.SizeError, "metadata"),
    "part of an image": (framed(b"IMAGE", changed(IMAGE, 67, 1)), igtl.ContentError, "part of an image"),
    "image without voxels": (framed(b"IMAGE", changed(IMAGE, 6, 0, 0)), igtl.ContentError, "no voxels"),
    "type of voxels": (framed(b"IMAGE", changed(IMAGE, 3, 9)), igtl.ContentError, "type 9"),
    "huge image": (
        framed(b"IMAGE", changed(IMAGE, 6, *b"\xff" * 6)[:66] + b"\xff" * 6 + bytes(4)),
        igtl.SizeError,
        "IMAGE",
    ),
    "huge array": (framed(b"NDARRAY", b"\x0b\x20" + b"\xff" * 64), igtl.SizeError, "NDARRAY"),
    "axes of an array": (framed(b"NDARRAY", b"\x0b\xff" + b"\xff" * 510), igtl.ContentError, "255 axes"),
    "huge mesh": (framed(b"POLYDATA", b"\xff" * 40), igtl.SizeError, "POLYDATA"),
    "index beyond the points": (framed(b"POLYDATA", changed(MESH, 80, 0, 0, 0, 9)), igtl.ContentError, "name point 9"),
    "cell beyond its end": (framed(b"POLYDATA", changed(MESH, 76, 0, 0, 0, 9)), igtl.SizeError, "within a cell"),
    "number of cells": (framed(b"POLYDATA", changed(MESH, 23, 2)), igtl.SizeError, "another number"),
    "attributes": (framed(b"POLYDATA", changed(MESH, 36, *b"\xff" * 4)), igtl.ContentError, "attributes"),
    "encoding": (framed(b"STRING", struct.pack(">HH", 17, 0)), igtl.ContentError, "encoding 17"),
    "text": (framed(b"STRING", struct.pack(">HH", 3, 1) + b"\xff"), igtl.ContentError, "no utf-8"),
    "length of a text": (framed(b"STRING", struct.pack(">HH", 3, 9) + b"short"), igtl.SizeError, "ends 4 too early"),
    "command": (framed(b"COMMAND", bytes(134) + b"\xff" * 4), igtl.SizeError, "COMMAND"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_message_is_refused_in_one_line(name):
    data, kind, line = WRONG[name]
    with pytest.raises(kind, match=line) as refused:
        igtl.decode(data)
    assert isinstance(refused.value, ValueError)
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 200


def test_pose_that_is_no_rotation():
    scaled = igtl.Transform(np.diag([2.0, 1, 1, 1]))
    with pytest.raises(igtl.ContentError, match="not rigid"):
        scaled.rigid  # noqa: B018
    with pytest.raises(igtl.ContentError, match="no rotation"):
        igtl.Position((0, 0, 0), (1, 1, 0, 0)).matrix  # noqa: B018
    turned = np.eye(4)
    turned[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(igtl.Position.of(turned).matrix, turned, atol=1e-6)
    np.testing.assert_allclose(igtl.QuaternionTool.of("x", turned).matrix, turned, atol=1e-6)
    np.testing.assert_allclose(igtl.Tool("x", turned).rigid, turned, atol=1e-6)


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: igtl.Message(igtl.Status(), "x" * 21), "device = .* has 21 bytes; give at most 20"),
        (lambda: igtl.Message(igtl.Status(), "a\0b"), "device = .* holds a zero"),
        (lambda: igtl.Message(np.eye(4)), "content = .* is no content"),
        (lambda: igtl.Message(igtl.Status(), stamp=-1), "stamp = -1"),
        (lambda: igtl.Message(igtl.Status(), metadata={"a": 1}), "metadata"),
        (lambda: igtl.encode(igtl.Message(igtl.Status()), 4), "version = 4"),
        (lambda: igtl.Transform(np.full((4, 4), np.nan)), "NaN"),
        (lambda: igtl.Transform(np.eye(3)), "shape"),
        (lambda: igtl.Transform(np.ones((4, 4))), "last row"),
        (lambda: igtl.Transform("x"), "not numeric"),
        (lambda: igtl.Image.of(np.zeros((2, 2)), np.eye(4)), "shape"),
        (lambda: igtl.Image.of(np.zeros((1, 2, 2), complex), np.eye(4)), "complex128"),
        (lambda: igtl.String("x" * 70_000), "longer than 65535"),
        (lambda: igtl.Start("IMAGE", 5), "no interval"),
        (lambda: igtl.Get("VIDEO"), "of = 'VIDEO'"),
        (lambda: igtl.PolyData([(0, 0, 0)], polygons=[(0, 1)]), "name point 1"),
        (lambda: igtl.PolyData([(0, 0, 0)], polygons=[(0.5,)]), "whole numbers"),
        (lambda: igtl.unit("furlong"), "furlong"),
        (lambda: igtl.Sensor([np.inf]), "infinity"),
        (lambda: igtl.TrackingData([np.eye(4)]), "Tool"),
    ],
)
def test_what_cannot_be_sent(make, line):
    with pytest.raises(ValueError, match=line) as refused:
        make()
    assert len(str(refused.value).splitlines()) == 1


def test_fuzzed_messages():
    """Sound messages with bytes changed, checks made right again: each is read, or refused with a clear line."""
    rng = random.Random(7)
    sound = [data for name, data in VECTORS.items() if "COMMAND" not in name] + [framed(b"IMAGE", IMAGE)]
    for _ in range(2000):
        data = bytearray(rng.choice(sound))
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
        body = bytes(data[SIZE:])
        data[42:58] = struct.pack(">QQ", len(body), igtl.crc64(body))
        _read_or_refused(bytes(data))


@pytest.mark.slow
def test_fuzzed_headers():
    """2 * 10^5 headers of random bytes, and of sound ones with few changed."""
    rng = random.Random(11)
    for turn in range(200_000):
        if turn % 2:
            data = rng.randbytes(rng.choice((SIZE, SIZE, SIZE + 48, rng.randrange(200))))
        else:
            data = bytearray(SOUND)
            data[rng.randrange(SIZE)] = rng.randrange(256)
        _read_or_refused(bytes(data))


def _read_or_refused(data):
    try:
        assert isinstance(igtl.decode(data), igtl.Message)
    except igtl.WireError as refused:
        assert re.fullmatch(r".{1,300}", str(refused))


def test_stamps():
    assert igtl.stamp_of_ns(1) == 4
    assert igtl.seconds_of(igtl.stamp_of_ns(1_234_567_892_500_000_000)) == 1234567892.5
    assert abs(igtl.seconds_of(igtl.now()) - time.time()) < 60


def test_a_name_of_twenty_bytes_needs_no_zero():
    message = igtl.Message(igtl.Status(), "NeedleTipToReference")
    assert igtl.decode(igtl.encode(message)).device == "NeedleTipToReference"
