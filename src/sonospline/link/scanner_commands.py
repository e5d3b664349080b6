"""What a scanner does for clients of PLUS: its ids, transforms and the settings of its image."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from importlib.metadata import version
from typing import Any

import numpy as np
from msgspec.structs import replace

from .._shown import shown
from ..io.writing import write_text
from .device_set import FILE, device_set_of
from .plus_commands import Action, Outcome, PlusCommand, parameters_xml

_CAPTURE = "CaptureDevice"
_SETTINGS = {"DepthMm": "depth", "FrequencyMhz": "frequency", "GainPercent": "gain"}
_GAIN_DB = (-30.0, 30.0)
"""What 0 and 100 per cent are: the ends of the gain's knob."""


def scanner_actions(station: Any) -> Mapping[str, Action]:
    """Return what a scanner can be asked to do, by the names of PLUS's commands."""
    names = station.names

    def ids(*found: str) -> Action:
        return lambda command: _named(found)

    def device_ids(command: PlusCommand) -> Outcome:
        kind = command.attributes.get("DeviceType", "")
        devices = {names.UsDevice: "UsSimulator", names.Tracker: "OpenIGTLinkTracker", _CAPTURE: "VirtualCapture"}
        return _named([name for name, its in devices.items() if kind in ("", its)])

    def get_transform(command: PlusCommand) -> Outcome:
        name = command.attribute("TransformName")
        matrix = _transform(station, name)
        if matrix is None:
            raise ValueError(f"GetTransform ({name}) Failed. Transform not found.")
        value = " ".join(f"{number:.9g}" for number in matrix.ravel())
        text = f'GetTransform ({name})<name="{name}" value="{value}" persistent="false" date="" error="0"/>'
        return Outcome(text, {name: value, "persistent": "false", "date": "", "error": "0"})

    def update_transform(command: PlusCommand) -> Outcome:
        name = command.attribute("TransformName")
        try:
            matrix = np.array(command.attribute("TransformValue").split(), float).reshape(4, 4)
        except ValueError:
            raise ValueError("TransformValue is not sixteen numbers; give the rows of a matrix") from None
        station.move(name, matrix)
        return Outcome(f"UpdateTransform ({name}) completed successfully")

    def clutch(command: PlusCommand) -> Outcome:
        tool, wanted = command.attribute("Tool").lower(), command.attribute("Open").upper()
        if wanted not in ("TRUE", "FALSE"):
            raise ValueError(f"Open = {shown(wanted)} is neither TRUE nor FALSE; give one of them")
        station.tracking.clutch(tool, wanted == "TRUE")
        return Outcome(f"Clutch ({tool}) completed successfully")

    def start_recording(command: PlusCommand) -> Outcome:
        name = station.recording.start(command.attributes.get("OutputFilename", ""))
        return Outcome(f"Recording {name} started", {"OutputFilename": name})

    def stop_recording(command: PlusCommand) -> Future[Outcome]:
        return station.recording.stop(recorded)

    def recorded(name: str, frames: int) -> Outcome:
        # 3D Slicer's PlusRemote takes what follows the last / for the file's name.
        said = f"VirtualCapture ({_CAPTURE}) StopRecording Recording {frames} frames successful to file ./{name}"
        return Outcome(said, {"OutputFilename": name, "frames": str(frames)})

    def save_config(command: PlusCommand) -> Outcome:
        name = command.attributes.get("Filename", FILE)
        path = station.recording.place(name if name.endswith(".xml") else f"{name}.xml")
        write_text(path, device_set_of(names, station.server.host, station.server.port))
        return Outcome(f"Configuration saved as {path.name}", {"Filename": path.name})

    def get_parameters(command: PlusCommand) -> Outcome:
        values = {name: _shown(station, name) for name in command.parameters}
        return _about(values, {name: value for name, value in values.items() if value is not None}, shows=True)

    def set_parameters(command: PlusCommand) -> Outcome:
        done: dict[str, str | None] = {}
        for name, value in command.parameters.items():
            done[name] = value if _set(station, name, value) else None
        return _about(done, {name: "FAIL" if value is None else "SUCCESS" for name, value in done.items()}, shows=False)

    said = Outcome(
        f"Sonospline {version('sonospline')}",
        {"SonosplineVersion": version("sonospline"), "IGTLProtocolVersion": "3", "IGTLHeaderVersion": "2"},
    )
    return {
        "RequestChannelIds": ids(names.OutputChannel), "RequestDeviceIds": device_ids,
        "RequestDeviceChannelIds": ids(names.OutputChannel), "GetTransform": get_transform,
        "UpdateTransform": update_transform, "GetUsParameter": get_parameters, "SetUsParameter": set_parameters,
        "Version": lambda command: said, "Clutch": clutch,
        "StartRecording": start_recording, "StopRecording": stop_recording, "SaveConfig": save_config,
    }  # fmt: skip


def _named(ids: Iterable[str]) -> Outcome:
    found = {name: name for name in ids}
    return Outcome(",".join(found), found)


def _transform(station: Any, name: str) -> Any:
    """A transform that was sent, or that is composed of those known; None where there is none."""
    if name in station.transforms:
        return station.transforms[name]
    try:
        return station.tracking.moving.get(name)
    except ValueError:
        return None


def _about(values: Mapping[str, str | None], metadata: Mapping[str, str], *, shows: bool) -> Outcome:
    failed = [name for name, value in values.items() if value is None]
    error = "" if not failed else f"{', '.join(failed)}: not known here, or out of range"
    return Outcome("", metadata, not failed, error, parameters_xml(values, shows=shows))


def _shown(station: Any, name: str) -> str | None:
    if name not in _SETTINGS:
        return None
    value = getattr(station.driven.settings, _SETTINGS[name])
    low, high = _GAIN_DB
    return f"{100 * (value - low) / (high - low) if name == 'GainPercent' else value:.6g}"


def _set(station: Any, name: str, text: str) -> bool:
    """Whether a setting was changed; it is not where the scene has no such setting or number."""
    try:
        number = float(text)
        low, high = _GAIN_DB
        value = low + (high - low) * number / 100 if name == "GainPercent" else number
        settings = replace(station.driven.settings, **{_SETTINGS[name]: value})
        station.driven.change(settings)
    except (KeyError, ValueError):
        return False
    return True
