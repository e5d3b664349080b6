"""Tables from outside: what is refused says the way to it, the value and what would be right."""

import subprocess
import sys
from typing import Annotated, Literal

import pytest

from sonospline.io.records import FieldError, Record, Text, about, dotted, read, schema


class Part(Record, frozen=True, kw_only=True):
    name: Text
    size: Annotated[float, about("how large", 0.5, 4)] = 1.0

    def __post_init__(self):
        if self.name == "none":
            raise FieldError(("name",), "= 'none' is taken; give another")


class Whole(Record, frozen=True, kw_only=True):
    kind: Literal["a", "b"]
    parts: Annotated[tuple[Part, ...], about("parts", longest=2)] = ()
    at: tuple[float, float, float] | None = None
    count: Annotated[int, about("how many", 0)] = 0
    on: bool = False


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({}, "kind is missing; give one of a, b"),
        (3, "= 3 is not a table; give kind, parts, at, count, on"),
        ({"kind": "c"}, "kind = 'c' is not known; choose one of a, b"),
        ({"kind": "a", "sort": 1}, "sort is not known; use kind, parts, at, count, on"),
        ({"kind": "a", "parts": [{"name": "x", "size": 9}]}, "parts[0].size = 9 is out of range; give a number from"),
        ({"kind": "a", "parts": [{"name": "x"}, {}]}, "parts[1].name is missing; give a text"),
        ({"kind": "a", "parts": [{"name": "none"}]}, "parts[0].name = 'none' is taken; give another"),
        ({"kind": "a", "parts": [{"name": "x"}] * 3}, "parts has 3 entries; give at most 2"),
        ({"kind": "a", "parts": [{"name": "x" * 1001}]}, "parts[0].name has 1001 characters; give at most 1000"),
        ({"kind": "a", "parts": [{"name": 5}]}, "parts[0].name = 5 is of the wrong kind; give a text"),
        ({"kind": "a", "parts": "x"}, "parts = 'x' is of the wrong kind; give a list"),
        ({"kind": "a", "parts": [7]}, "parts[0] = 7 is not a table; give name, size"),
        ({"kind": "a", "at": [1, 2]}, "at = [1, 2] is of the wrong kind; give 3 values in a list"),
        ({"kind": "a", "at": [1, 2, None]}, "at[2] = None is not a number; give a number"),
        ({"kind": "a", "at": [1, 2, float("inf")]}, "at[2] = inf is not finite; give a number"),
        ({"kind": "a", "at": [1, 2, 10**400]}, "at[2] = (a whole number of 401 digits) is out of range; give a number"),
        ({"kind": "a", "count": -1}, "count = -1 is out of range; give a whole number of at least 0"),
        ({"kind": "a", "count": 1.5}, "count = 1.5 is of the wrong kind; give a whole number of at least 0"),
        ({"kind": "a", "count": True}, "count = True is of the wrong kind"),
        ({"kind": "a", "on": 1}, "on = 1 is of the wrong kind; give true or false"),
        ({"kind": "a", "parts": [{"name": "\udcff"}]}, "parts[0].name holds half a character"),
        ({"kind": "a", "x` - at `$.parts": 1}, "is not known; use kind"),
        ({"kind": "a", "x` - at `$.kind": 1}, "kind"),
    ],
)
def test_what_is_wrong_is_said(values, says):
    with pytest.raises(FieldError) as refused:
        read(Whole, values)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_is_right_is_read_and_described():
    whole = read(Whole, {"kind": "b", "parts": [{"name": "x", "size": 2}], "at": [1, 2, 3]})
    assert whole == Whole(kind="b", parts=(Part(name="x", size=2.0),), at=(1.0, 2.0, 3.0))
    about_size = schema(Whole)["$defs"]["Part"]["properties"]["size"]
    assert about_size == {
        "type": "number", "description": "how large", "minimum": 0.5, "maximum": 4, "default": 1.0
    }  # fmt: skip
    assert dotted(("a", 3, "b c")) == "a[3].'b c'"


ONE_MORE = """
from sonospline.ultrasound import NeedleEcho, Probe
from sonospline.ultrasound.probe import PROBES
from sonospline.ultrasound.needle_echo import LOOKS
PROBES["endocavity"] = lambda frequency_mhz=6.5, depth_mm=60.0, **settings: Probe.curvilinear(
    frequency_mhz=frequency_mhz, depth_mm=depth_mm, **{"radius_mm": 11.0, "aperture_mm": 25.0, **settings})
LOOKS["blunt"] = NeedleEcho.steel_1mm
"""


def run(code):
    return subprocess.run([sys.executable, "-c", ONE_MORE + code], capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
def test_a_probe_or_look_more_is_one_line_of_its_table():
    """In a process of its own, since choices are fixed once they are asked for: file, schema, picture, page, verb."""
    said = run(
        """
from sonospline.server.server_messages import SceneMessage
from sonospline.simulator import Console, SceneFile, Session, scene_schema
console = Console(Session(SceneFile.parse('''name = "x"
[tissue]
source = "gel block"
voxel_mm = 1.0
nodes = 5000
[needle]
look = "blunt"
[probe]
kind = "endocavity"
frequency_mhz = 3.0
depth_mm = 40.0
lines = 64
'''), model="paper"))
beams = SceneMessage.of("x", console, console.command, console.scene.start, frozenset()).probe.beams
print(console.step().image.pixels.std() > 5, round(beams[-1][0], 2), round(beams[-1][3], 3))
parts = scene_schema()["$defs"]
print("endocavity" in parts["ProbePart"]["properties"]["kind"]["enum"])
print("blunt" in parts["NeedlePart"]["properties"]["look"]["enum"])
from sonospline import cli
try: cli.main(["image", "--help"])
except SystemExit: pass
"""
    )
    assert said.startswith("True 9.98 0.421\nTrue\nTrue\n")
    assert "endocavity" in said
    assert "blunt" in said
