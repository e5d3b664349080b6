"""A blank matplotlib figure that needs no display."""

from __future__ import annotations

from typing import Any

from ._extras import require


def blank(width: float, height: float) -> Any:
    """Return a white ``matplotlib.figure.Figure`` of so many inches; MissingExtraError without matplotlib."""
    require("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure
