"""Which files a scene that comes through a page may read: those of the folder the server was started in."""

from __future__ import annotations

from pathlib import Path

from .scene_file import SceneFile

_FILES = ("file", "names", "ct", "materials")


def refuse_elsewhere(spec: SceneFile) -> None:
    """Refuse a scene that names a file outside the present folder.

    Raises
    ------
    ValueError
        Which one.
    """
    here = Path().resolve()
    for key in _FILES:
        named = getattr(spec.tissue, key)
        if named is not None and not (here / named).resolve().is_relative_to(here):
            raise ValueError(
                f"tissue.{key} = {named!r} lies outside the folder the server was started in; start it with --scene"
            )
