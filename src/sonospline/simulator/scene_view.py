"""How a scene is looked at: its probe, and how what is there is shown."""

from __future__ import annotations

from typing import NamedTuple

from ..ultrasound.artefacts import Artefacts
from ..ultrasound.display import Display
from ..ultrasound.needle_echo import LOOKS, NeedleEcho
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import PROBES, Probe
from .scene_file import ProbePart, SceneFile

_DOWNSHIFT = 0.5
"""Attenuation of the tissue before an organ, dB/cm/MHz, by which the centre frequency falls."""


class View(NamedTuple):
    """A phantom as a scene shows it."""

    phantom: Phantom
    display: Display
    echo: NeedleEcho
    artefacts: Artefacts


def view_of(scene: SceneFile, phantom: Phantom) -> View:
    """Return a phantom as a scene shows it, with the scene's textures, artefacts, needle and display."""
    shown = scene.display
    return View(
        phantom.textured() if shown.textures else phantom,
        Display(gain_db=Display().gain_db + shown.gain_db, range_db=shown.range_db, noise_db=shown.noise_db),
        LOOKS[scene.needle.look](),
        Artefacts() if shown.artefacts else Artefacts.none(),
    )


def probe_of(part: ProbePart, *, artefacts: bool) -> Probe:
    """Return the probe that a scene describes; with artefacts, its frequency falls with depth."""
    focus = {} if part.focus_mm is None else {"elevation_focus_mm": part.focus_mm}
    return PROBES[part.kind](
        frequency_mhz=part.frequency_mhz, depth_mm=part.depth_mm, lines=part.lines,
        transmit_focus_mm=part.transmit_focus_mm, downshift_db_cm_mhz=_DOWNSHIFT if artefacts else 0.0, **focus,
    )  # fmt: skip
