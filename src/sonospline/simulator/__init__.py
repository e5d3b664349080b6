"""The live simulator: a needle and a probe in tissue that answers, for Python and for a browser."""

from typing import TYPE_CHECKING

from .._later import later
from .runner import Runner
from .scene_file import SceneError, SceneFile, scene_schema
from .wish import ImageWish, Limits, NeedleWish, ProbeWish, Wish

if TYPE_CHECKING:
    from .session import Session
    from .shot import Readouts, Shot
    from .world import World

# Imported when asked for: the server opens the page before what computes has been loaded.
__getattr__, __dir__ = later(__name__, {"Session": "session", "Shot": "shot", "Readouts": "shot", "World": "world"})

__all__ = [
    "ImageWish",
    "Limits",
    "NeedleWish",
    "ProbeWish",
    "Readouts",
    "Runner",
    "SceneError",
    "SceneFile",
    "Session",
    "Shot",
    "Wish",
    "World",
    "scene_schema",
]
