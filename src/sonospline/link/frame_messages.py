"""What is sent of a frame: image, poses, targets, force, events and read-outs, all with one stamp."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .. import igtl
from ..models.contract import NeedleForce
from ..simulator.simulated_frame import SimulatedFrame
from ..tracking.transform_repository import TransformRepository
from .coordinate_frames import IMAGE, CoordinateFrames

Array = NDArray[np.float64]

SLICE_MM = 1.0
"""Size of a voxel across the image (assumed): a picture has none."""
OK, MISSING = "OK", "MISSING"
"""What PLUS calls a tool that is seen, and one that is not."""


def messages_of(
    frame: SimulatedFrame,
    tip_to_world: Array,
    frames: CoordinateFrames,
    *,
    moving: TransformRepository | None = None,
    missing: frozenset[str] = frozenset(),
    stamp: int | None = None,
) -> list[igtl.Message]:
    """Return what is sent of a frame.

    Parameters
    ----------
    frame : SimulatedFrame
    tip_to_world : (4, 4) ndarray
        The needle's tip as the hand holds it: z along it.
    frames : CoordinateFrames
    moving : TransformRepository, optional
        What trackers say besides, for the transforms that a file asks for.
    missing : frozenset of str
        Devices whose tool is out of view: their poses go out as they were last, with that status.
    stamp : int, optional
        As :func:`sonospline.igtl.now` gives it; now by default.
    """
    stamp, names = igtl.now() if stamp is None else stamp, frames.names
    pixels, image_to_reference = _oriented(frame, frames)
    poses = poses_of(frame, tip_to_world, frames, moving, image_to_reference)
    fine = {"Status": OK}
    messages = [igtl.Message(igtl.Image.of(pixels[None], image_to_reference), names.Image, stamp, fine)]
    for name, pose in poses.items():
        status = {"Status": MISSING if name in missing else OK}
        messages.append(igtl.Message(igtl.Transform(pose.astype(np.float32)), name, stamp, status))
    tools = tuple(igtl.Tool(name, pose.astype(np.float32)) for name, pose in poses.items())
    messages.append(igtl.Message(igtl.TrackingData(tools), names.Tracker, stamp))
    rigid = dict.fromkeys((names.Probe, names.Needle, names.NeedleTip, names.Target))
    turns = tuple(igtl.QuaternionTool.of(name, poses[name]) for name in rigid)
    messages.append(igtl.Message(igtl.QuaternionTrackingData(turns), names.Tracker, stamp))
    [target] = frames.points(frame.target_now[None])
    messages.append(
        igtl.Message(
            igtl.Points((igtl.Point(target.astype(np.float32), frame.target.encode()[:64].decode(errors="ignore")),)),
            names.Targets,
            stamp,
        )
    )
    for force in list(frame.forces.values())[:1]:
        messages += [igtl.Message(content, names.Force, stamp) for content in _force(force, frames)]
    messages += [igtl.Message(igtl.String(str(event)), names.Events, stamp) for event in frame.events]
    return [*messages, igtl.Message(igtl.String(_readouts(frame)), names.Readouts, stamp)]


def poses_of(
    frame: SimulatedFrame,
    tip_to_world: Array,
    frames: CoordinateFrames,
    moving: TransformRepository | None,
    image_to_reference: Array,
) -> dict[str, Array]:
    """Return the poses that are sent, by the names of their devices."""
    names, reference = frames.names, frames.world_to_reference
    tip, target = tip_to_world.copy(), np.eye(4)
    if frame.needle is not None:
        tip[:3, 3] = frame.needle.tip
    target[:3, 3] = frame.target_now
    found = {
        names.Probe: reference @ frame.probe_to_reference @ np.linalg.inv(frames.face_to_probe),
        names.Needle: reference @ tip_to_world @ np.linalg.inv(frames.tip_to_needle),
        names.NeedleTip: reference @ tip,
        names.Target: reference @ target,
    }
    if names.TransformNames:
        found |= _composed(found, frames, moving, image_to_reference)
    return found


def _composed(
    found: dict[str, Array], frames: CoordinateFrames, moving: TransformRepository | None, image_to_reference: Array
) -> dict[str, Array]:
    """What else is asked for, as far as it is known."""
    known = (frames.known if moving is None else moving).copy()
    for name in (frames.names.Probe, frames.names.Needle, frames.names.Target):
        if name not in known:
            known.set(name, found[name])
    known.set(f"{IMAGE}To{frames.reference}", image_to_reference)
    return {name: known.get(name) for name in frames.names.TransformNames if name not in found and name in known}


def _oriented(frame: SimulatedFrame, frames: CoordinateFrames) -> tuple[NDArray[np.uint8], Array]:
    """The pixels with x and y as they are to run, and where they are: the axes stay right-handed."""
    plane, (side, way) = frame.image.plane, frames.names.ImageOrientation
    ijk = frames.world_to_reference @ plane.image_to_reference @ np.diag([*plane.spacing_mm, SLICE_MM, 1.0])
    pixels: NDArray[np.uint8] = frame.image.pixels
    for axis, turned in ((0, side == "U"), (1, way == "N")):
        if turned:
            last = pixels.shape[1 - axis] - 1
            pixels = np.flip(pixels, 1 - axis)
            ijk[:3, 3] += last * ijk[:3, axis]
            ijk[:3, [axis, 2]] *= -1
    return np.ascontiguousarray(pixels), ijk


def _force(force: NeedleForce, frames: CoordinateFrames) -> Iterator[igtl.Sensor | igtl.String | igtl.NumberArray]:
    vector = frames.world_to_reference[:3, :3] @ np.asarray(force.force_n, float)
    for kind in frames.names.ForceTypes:
        if kind == "SENSOR":
            yield igtl.Sensor(vector, igtl.unit("newton"))
        elif kind == "NDARRAY":
            yield igtl.NumberArray(vector)
        else:
            yield igtl.String(json.dumps({"force_n": vector.tolist(), "axial_n": float(force.axial_n)}))


def _readouts(frame: SimulatedFrame) -> str:
    values = {
        "frame": frame.number, "model": frame.model, "depth_mm": frame.readouts.depth,
        "tip_to_target_mm": frame.readouts.tip_to_target, "target_moved_mm": frame.readouts.moved,
        "axial_force_n": next((force.axial_n for force in frame.forces.values()), None),
    }  # fmt: skip
    return json.dumps({name: None if value != value else value for name, value in values.items()})
