"""Matplotlib axes to draw on: the caller's, or new ones that need no display."""

from __future__ import annotations

from typing import Any

from ..io.canvas import blank


def axes_or_new(ax: Any, width: float = 5.0, height: float = 5.0) -> Any:
    """Return ``ax``, or the axes of a new figure of so many inches."""
    return blank(width, height).add_subplot() if ax is None else ax
