"""Messages of OpenIGTLink of every type, drawn by hypothesis."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sonospline import igtl
from sonospline.igtl.queries import KINDS

singles = st.floats(-1e6, 1e6, width=32)
bytes_ = st.integers(0, 255)


def text(most):
    """A text of at most so many bytes, without a zero."""
    return st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=most // 4)


def many(count, values=singles):
    return st.tuples(*[values] * count)


def matrices():
    return many(12).map(lambda drawn: np.vstack([np.reshape(drawn, (3, 4)), [0, 0, 0, 1]]))


def quaternions():
    return many(4)


def numbers(kinds, shapes):
    kind = st.sampled_from(kinds)
    return st.tuples(kind, shapes).flatmap(lambda drawn: arrays.arrays(*drawn, elements={"allow_nan": False}))


KINDS_OF_VOXELS = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
SHORT = st.integers(1, 5)


@st.composite
def images(draw):
    shape = draw(st.one_of(many(3, SHORT), st.tuples(SHORT, SHORT, SHORT, st.integers(2, 4))))
    voxels = draw(numbers(KINDS_OF_VOXELS, st.just(shape)))
    return igtl.Image(voxels, np.reshape(draw(many(9)), (3, 3)), draw(many(3)))


@st.composite
def polydata(draw):
    count = draw(st.integers(0, 6))
    cells = st.lists(st.lists(st.integers(0, max(count - 1, 0)), min_size=1, max_size=5), max_size=4 if count else 0)
    kinds = {"scalars": draw(st.integers(1, 12)), "vectors": 3, "normals": 3, "tensors": 9, "rgba": 4}
    attributes = [
        igtl.Attribute(draw(text(20)), draw(arrays.arrays(np.float32, (count, kinds[kind]), elements=singles)), kind)
        for kind in draw(st.lists(st.sampled_from(sorted(kinds)), max_size=3))
    ]
    points = [draw(many(3)) for _ in range(count)]
    return igtl.PolyData(points, draw(cells), draw(cells), draw(cells), draw(cells), attributes)


colours, sizes, stamps = many(4, bytes_), many(3, st.integers(0, 0xFFFF)), st.integers(0, (1 << 64) - 1)
points = st.builds(igtl.Point, many(3), text(64), text(32), colours, st.floats(0, 100, width=32), text(20))
image_entries = st.builds(
    igtl.ImageEntry, text(20), sizes, st.sampled_from(KINDS_OF_VOXELS), text(64), text(32), text(64), text(64), stamps
)
label_entries = st.builds(igtl.LabelEntry, text(20), bytes_, text(64), colours, sizes, text(20))
commands = (st.integers(0, (1 << 32) - 1), text(128), st.text(max_size=80).filter(str.isprintable))
starts = st.one_of(
    st.builds(igtl.Start, st.sampled_from(("TDATA", "QTDATA")), st.integers(0, (1 << 31) - 1), text(32)),
    st.builds(igtl.Start, st.just("POLYDATA"), st.integers(0, 10**6)),
    st.builds(igtl.Start, st.sampled_from(KINDS)),
)
CONTENTS = {
    "TRANSFORM": st.builds(igtl.Transform, matrices()),
    "POSITION": st.builds(igtl.Position, many(3), quaternions()),
    "QTRANS": st.builds(igtl.QuaternionTransform, many(3), quaternions()),
    "TDATA": st.builds(igtl.TrackingData, st.lists(st.builds(igtl.Tool, text(20), matrices(), bytes_), max_size=4)),
    "QTDATA": st.builds(
        igtl.QuaternionTrackingData,
        st.lists(st.builds(igtl.QuaternionTool, text(20), many(3), quaternions(), bytes_), max_size=4),
    ),
    "IMAGE": images(),
    "POLYDATA": polydata(),
    "POINT": st.builds(igtl.Points, st.lists(points, max_size=3)),
    "IMGMETA": st.builds(igtl.ImageList, st.lists(image_entries, max_size=3)),
    "LBMETA": st.builds(igtl.LabelList, st.lists(label_entries, max_size=3)),
    "STRING": st.builds(igtl.String, st.text(max_size=80)),
    "STATUS": st.builds(
        igtl.Status, st.integers(0, 0xFFFF), text(80), text(20), st.integers(-(1 << 63), (1 << 63) - 1)
    ),
    "SENSOR": st.builds(igtl.Sensor, arrays.arrays(float, st.integers(0, 255), elements=singles), stamps, bytes_),
    "NDARRAY": st.builds(igtl.NumberArray, numbers((*KINDS_OF_VOXELS, "complex128"), arrays.array_shapes(max_side=4))),
    "CAPABILITY": st.builds(igtl.Capability, st.lists(text(12), max_size=5)),
    "COMMAND": st.builds(igtl.Command, *commands),
    "RTS_COMMAND": st.builds(igtl.CommandReply, *commands),
    "S": st.builds(igtl.Nothing, st.sampled_from(("STRING", "STATUS", "SENSOR"))),
    "GET_": st.builds(igtl.Get, st.sampled_from(KINDS)),
    "STT_": starts,
    "STP_": st.builds(igtl.Stop, st.sampled_from(KINDS)),
    "RTS_": st.builds(igtl.Reply, st.sampled_from([kind for kind in KINDS if kind != "COMMAND"]), st.booleans()),
}  # fmt: skip
"""Of each type; queries by their prefixes."""


def messages(content):
    metadata = st.dictionaries(text(20), st.text(max_size=20), max_size=3)
    return st.builds(igtl.Message, content, text(20), stamps, metadata, st.integers(0, (1 << 32) - 1))
