"""The live simulator: a needle and a probe in tissue that answers, for Python and for a browser."""

from .runner import Runner
from .scene_file import SceneError, SceneFile, scene_schema
from .session import Session
from .shot import Readouts, Shot
from .wish import ImageWish, Limits, NeedleWish, ProbeWish, Wish
from .world import World

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
