"""The environments by the names under which Gymnasium makes them."""

from __future__ import annotations

from .._extras import present, require

IDS = {
    "sonospline/NeedleSteering-v0": ("NeedleSteering", "state"),
    "sonospline/NeedleSteeringPixels-v0": ("NeedleSteering", "pixels"),
    "sonospline/ProbeNavigation-v0": ("ProbeNavigation", "state"),
    "sonospline/ProbeNavigationPixels-v0": ("ProbeNavigation", "pixels"),
}
"""Name -> the class and what it lets an agent observe."""


def register() -> None:
    """Make the names known to Gymnasium, where that is installed; once is enough."""
    if not present("gymnasium"):
        return
    gymnasium = require("gymnasium")
    for name, (kind, observe) in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=f"{__package__}:{kind}", kwargs={"observe": observe})
