"""Binary messages to the page, frames and geometry: a header in JSON and a payload; see docs/simulator.md."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from ..simulator.command import Command
from ..simulator.logged_event import LoggedEvent
from ..simulator.readouts import Blocked, Readouts
from .server_messages import Vector

if TYPE_CHECKING:
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene
    from ..simulator.surfaces import Mesh
    from ..training.guide import Guide
    from ..ultrasound.colour_flow import ColourFlow

FRAME, GEOMETRY = 1, 2
KNOW_THE_NEEDLE: frozenset[Guide] = frozenset({"path", "tip", "3-D view"})
KNOW_THE_TARGET: frozenset[Guide] = frozenset({"path", "target", "3-D view"})

Matrix = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float, float, float, float
]
"""4 x 4, row by row."""


class NeedlePlace(Struct, frozen=True, kw_only=True):
    """Where the needle is, RAS mm."""

    entry: Vector
    tip: Vector
    direction: Vector


class TargetPlace(Struct, frozen=True, kw_only=True):
    """Where the target is, and where it was before the tissue moved, RAS mm."""

    id: str
    now: Vector
    rest: Vector


class PassSummary(Struct, frozen=True, kw_only=True):
    """The present pass, or the last one; in an attempt all of it."""

    time_s: float
    passes: int
    path_mm: float | None
    """Length of the way of the tip; None before it is measured, or where it may not be shown."""
    blind_mm: float | None
    """By how much the needle was advanced with its tip out of plane."""


class ReplayedStep(Struct, frozen=True, kw_only=True):
    """Which step of a recording a frame shows."""

    step: int
    time_s: float
    same: bool
    """Whether every pixel is the recorded one."""


class ColourPlace(Struct, frozen=True, kw_only=True):
    """Colour Doppler over a window of the picture: a byte for each of its pixels follows everything else."""

    row: int
    column: int
    rows: int
    columns: int
    nyquist_cm_s: float
    """Velocity towards the probe of level 127; -128 stands for none."""
    outline: tuple[tuple[float, float], ...]
    """The box's edge in the image, mm from the middle of the probe's face."""


class FrameHeader(Struct, frozen=True, kw_only=True):
    """A picture and everything that belongs to it; its payload is grey levels, positions of meshes, colours."""

    frame: int
    seq: int
    """Of the newest command it answers."""
    rows: int
    columns: int
    pixel: tuple[float, float]
    """Width and height, mm."""
    image_to_reference: Matrix
    """Of pixel (0, 0)."""
    probe_to_reference: Matrix
    """Of the middle of the probe's face."""
    state: Command
    """What is in force."""
    blocked: Blocked | None
    bone: str | None
    """The bone that blocks the needle, as the label map calls it."""
    held_by: str | None
    """The tissue that holds the needle, which turns no further."""
    needle: NeedlePlace | None
    """This, the target and the read-outs are none where an exercise does not show them."""
    target: TargetPlace | None
    readouts: Readouts | None
    passed: PassSummary = field(name="pass")
    log: tuple[LoggedEvent, ...]
    """The last events, those of frames that were not sent, too."""
    replay: ReplayedStep | None
    """None of a live frame."""
    model: str
    noise: int
    """The number of the frame that the library's renderer takes."""
    server_ms: float
    step_ms: float
    render_ms: float
    mesh: int
    """Vertices whose positions follow; 0 where nothing moved."""
    grid: bool
    """Whether those of the grid lines are among them."""
    colour: ColourPlace | None


class MeshHeader(Struct, frozen=True, kw_only=True):
    """How a mesh looks, and how many float32 positions and uint32 indices of it follow."""

    name: str
    kind: Literal["surface", "lines"]
    colour: str
    opacity: float
    vertices: int
    indices: int


class GeometryHeader(Struct, frozen=True, kw_only=True):
    """Every mesh of a scene."""

    meshes: tuple[MeshHeader, ...]


def geometry(scene: Scene) -> bytes:
    """Return message kind 2: how every mesh looks, its rest positions and connectivity."""
    parts: list[NDArray[Any]] = []
    for mesh in scene.meshes:
        parts += [mesh.points.astype("<f4"), mesh.indices.astype("<u4")]
    header = GeometryHeader(meshes=tuple(map(_mesh, scene.meshes)))
    return binary(GEOMETRY, header, b"".join(part.tobytes() for part in parts))


def frame(shown: ConsoleFrame, *, number: int, seq: int, guides: frozenset[Guide], summary: PassSummary,
          positions: NDArray[np.float32] | None = None, grid: bool = False, server_ms: float = 0.0,
          replay: ReplayedStep | None = None) -> bytes:  # fmt: skip
    """Return message kind 1: the picture, the state it shows, what guides may know, and positions of the meshes."""
    pixels = np.ascontiguousarray(shown.image.pixels, np.uint8)
    rows, columns = pixels.shape
    numbers = "numbers" in guides
    header = FrameHeader(
        frame=number, seq=seq, rows=rows, columns=columns, pixel=shown.image.plane.spacing_mm,
        image_to_reference=_numbers(shown.image_to_reference),
        probe_to_reference=_numbers(shown.probe_to_reference),
        state=shown.command, blocked=shown.blocked, bone=shown.bone,
        held_by=shown.held_by if numbers else None,
        needle=NeedlePlace(
            entry=_numbers(shown.entry), tip=_numbers(shown.tip), direction=_numbers(shown.direction)
        ) if guides & KNOW_THE_NEEDLE else None,
        target=TargetPlace(
            id=shown.target, now=_numbers(shown.target_now), rest=_numbers(shown.target_rest)
        ) if guides & KNOW_THE_TARGET else None,
        readouts=shown.readouts if numbers else None,
        passed=summary, log=shown.log if numbers else (), replay=replay, model=shown.model, noise=shown.number,
        server_ms=round(server_ms, 3), step_ms=round(shown.step_ms, 3), render_ms=round(shown.render_ms, 3),
        mesh=0 if positions is None else len(positions), grid=grid, colour=_colour(shown.image.colour),
    )  # fmt: skip
    padding = b"\0" * (-pixels.size % 4)
    tail = b"" if positions is None else positions.astype("<f4", copy=False).tobytes()
    if shown.image.colour is not None:
        tail += shown.image.colour.levels.tobytes()
    return binary(FRAME, header, pixels.tobytes() + padding + tail)


def read(message: bytes) -> tuple[int, dict[str, Any], memoryview]:
    """Return kind, header and payload of a message; for clients written in Python."""
    kind, size = struct.unpack_from("<II", message)
    return kind, json.loads(message[8 : 8 + size]), memoryview(message)[8 + size :]


def read_pixels(header: dict[str, Any], payload: memoryview) -> NDArray[np.uint8]:
    """Return the picture (rows, columns) of a frame."""
    size = header["rows"] * header["columns"]
    return np.frombuffer(payload[:size], np.uint8).reshape(header["rows"], header["columns"])


def text(message: Struct) -> str:
    """Return a message as JSON; a number that is not finite is none."""
    return msgspec.json.encode(message).decode()


def binary(kind: int, header: Struct, payload: bytes) -> bytes:
    """Return a binary message: kind, length of the header, the header as JSON, the payload."""
    head = msgspec.json.encode(header)
    head += b" " * (-(8 + len(head)) % 8)
    return struct.pack("<II", kind, len(head)) + head + payload


def _numbers(array: Any) -> Any:
    return tuple(np.asarray(array).ravel().tolist())


def _colour(colour: ColourFlow | None) -> ColourPlace | None:
    if colour is None:
        return None
    (row, column), (rows, columns) = colour.corner, colour.levels.shape
    outline = tuple((x, y) for x, y in colour.outline_mm.tolist())
    return ColourPlace(
        row=row, column=column, rows=rows, columns=columns, nyquist_cm_s=colour.nyquist_cm_s, outline=outline
    )  # fmt: skip


def _mesh(mesh: Mesh) -> MeshHeader:
    return MeshHeader(
        name=mesh.name, kind=mesh.kind, colour=mesh.colour, opacity=mesh.opacity, vertices=len(mesh.points),
        indices=int(mesh.indices.size),
    )  # fmt: skip
