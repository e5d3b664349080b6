"""The bytes and texts that go to the page: frames, geometry, scene. Version 1; see docs/simulator.md."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import to_builtins
from numpy.typing import NDArray

from ..simulator.command import Command
from ..simulator.scene_file import MODELS
from .session_pool import KEPT_S

if TYPE_CHECKING:
    from ..simulator.knobs import Knobs
    from ..simulator.scene import Scene
    from ..simulator.session import Session
    from ..simulator.shot import Shot
    from ..simulator.surfaces import Mesh

PROTOCOL = 1
FRAME, GEOMETRY = 1, 2
NOTICE = "Simulated image. Not a medical device."


def hello(version: str, scenes: list[dict[str, str]], scene: str, key: str, *, resumed: bool) -> dict[str, Any]:
    """Return the first message."""
    return {
        "type": "hello", "version": version, "protocol": PROTOCOL, "scenes": scenes, "scene": scene, "notice": NOTICE,
        "session": key, "resumed": resumed, "kept_s": KEPT_S,
    }  # fmt: skip


def scene(name: str, session: Session) -> dict[str, Any]:
    """Return what a page has to know of a scene before its first frame."""
    scene = session.scene
    probe, spec = scene.probe, scene.spec
    low, high = scene.box
    shown = {
        "name": spec.probe.name, "kind": probe.kind, "radius_mm": probe.radius_mm, "aperture_mm": probe.aperture_mm,
        "field_of_view_deg": float(np.degrees(2 * probe.half_angle)),
    }  # fmt: skip
    return {
        "type": "scene", "id": name, "name": spec.name, "description": spec.description,
        "frame": {
            "right": scene.frame.right.tolist(), "depth": scene.frame.depth.tolist(), "out": scene.frame.out.tolist(),
            "skin_origin": scene.frame.origin.tolist(),
        },
        "box": {"low": low.tolist(), "high": high.tolist()},
        "models": [{"id": key, "name": text, "available": True, "reason": None} for key, text in MODELS.items()],
        "model": session.model,
        "probe": shown,
        "needle": {"length_mm": spec.needle.length_mm, "diameter_mm": scene.needle_diameter_mm},
        "targets": [{"id": key, "name": key.capitalize(), "rest": at.tolist()} for key, at in scene.targets.items()],
        "target": session.target,
        "tolerance_mm": spec.display.tolerance_mm,
        "half_slice_mm": float(probe.elevation_sigma(probe.elevation_focus_mm) * np.sqrt(2 * np.log(2))),
        "limits": _limits(scene.knobs),
        "knobs": to_builtins(scene.knobs.all),
        "state": to_builtins(session.command),
        "start": to_builtins(scene.start),
    }  # fmt: skip


def geometry(scene: Scene) -> bytes:
    """Return message kind 2: how every mesh looks, its rest positions and connectivity."""
    header = {"meshes": [_about(mesh) for mesh in scene.meshes]}
    parts: list[NDArray[Any]] = []
    for mesh in scene.meshes:
        parts += [mesh.points.astype("<f4"), mesh.indices.astype("<u4")]
    return _message(GEOMETRY, header, b"".join(part.tobytes() for part in parts))


def frame(shot: Shot, *, number: int, seq: int, positions: NDArray[np.float32] | None, grid: bool,
          server_ms: float) -> bytes:  # fmt: skip
    """Return message kind 1: the picture, the state it shows, and positions of the meshes where they changed."""
    pixels = np.ascontiguousarray(shot.image.pixels, np.uint8)
    rows, columns = pixels.shape
    metrics = shot.metrics
    header = {
        "frame": number, "seq": seq, "rows": rows, "columns": columns, "pixel": list(shot.image.plane.spacing_mm),
        "image_to_reference": shot.image_to_reference.ravel().tolist(),
        "probe_to_reference": np.asarray(shot.probe_to_reference).ravel().tolist(),
        "state": to_builtins(shot.command),
        "blocked": shot.blocked,
        "needle": {"entry": shot.entry.tolist(), "tip": shot.tip.tolist(), "direction": shot.direction.tolist()},
        "target": {"id": shot.target, "now": shot.target_now.tolist(), "rest": shot.target_rest.tolist()},
        "readouts": vars(shot.readouts),
        "pass": {
            "time_s": metrics.time_s, "passes": metrics.passes, "tip_path_mm": metrics.tip_path_mm,
            "max_off_plane_mm": metrics.max_off_plane_mm,
        },
        "model": shot.model, "noise": shot.number,
        "server_ms": round(server_ms, 3), "step_ms": round(shot.step_ms, 3), "render_ms": round(shot.render_ms, 3),
        "frozen": shot.command.frozen, "mesh": 0 if positions is None else len(positions), "grid": grid,
    }  # fmt: skip
    padding = b"\0" * (-pixels.size % 4)
    tail = b"" if positions is None else positions.astype("<f4", copy=False).tobytes()
    return _message(FRAME, header, pixels.tobytes() + padding + tail)


def read(message: bytes) -> tuple[int, dict[str, Any], memoryview]:
    """Return kind, header and payload of a message; for clients written in Python."""
    kind, size = struct.unpack_from("<II", message)
    return kind, json.loads(message[8 : 8 + size]), memoryview(message)[8 + size :]


def read_pixels(header: dict[str, Any], payload: memoryview) -> NDArray[np.uint8]:
    """Return the picture (rows, columns) of a frame."""
    size = header["rows"] * header["columns"]
    return np.frombuffer(payload[:size], np.uint8).reshape(header["rows"], header["columns"])


def _message(kind: int, header: dict[str, Any], payload: bytes) -> bytes:
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(8 + len(text)) % 8)
    return struct.pack("<II", kind, len(text)) + text + payload


def _about(mesh: Mesh) -> dict[str, Any]:
    return {
        "name": mesh.name, "kind": mesh.kind, "colour": mesh.colour, "opacity": mesh.opacity,
        "vertices": len(mesh.points), "indices": int(mesh.indices.size),
    }  # fmt: skip


def _limits(knobs: Knobs) -> dict[str, Any]:
    limits: dict[str, Any] = {}
    for knob in knobs:
        limits.setdefault(knob.group, {})[knob.field] = [knob.low, knob.high]
    return limits


def state_text(command: Command, seq: int) -> str:
    """Return a client's state message; for clients written in Python."""
    return json.dumps({"type": "state", "seq": seq, **to_builtins(command)})
