"""Matplotlib figures that need no display, and pictures that do not depend on anybody's settings."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

from .._extras import MissingExtraError, require
from .writing import write_bytes

logger = logging.getLogger(__name__)

_BACKEND = ("backend", "backend_fallback")
"""Settings that choose a window system: left to the user, since these figures open none."""


class NoPictureError(RuntimeError):
    """A picture could not be drawn; the message says which and why."""


def blank(width: float, height: float) -> Any:
    """Return a white ``matplotlib.figure.Figure`` of so many inches; MissingExtraError without matplotlib."""
    _matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def axes_or_new(ax: Any, width: float = 5.0, height: float = 5.0) -> Any:
    """Return ``ax``, or the axes of a new figure of so many inches: one pyplot shows, where the user works with it."""
    if ax is not None:
        return ax
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None:
        return blank(width, height).add_subplot()
    return pyplot.figure(figsize=(width, height), layout="constrained").add_subplot()


@contextmanager
def picture(path: Path, width: float, height: float, *, dpi: float = 110) -> Iterator[Any]:
    """Yield a figure of so many inches to draw on; then write it as a PNG.

    It looks the same whatever backend, style or matplotlibrc the user has, and changes none of them.

    Raises
    ------
    NoPictureError
        It could not be drawn, or matplotlib is not installed.
    OSError
        It was drawn and could not be written.
    """
    drawn = BytesIO()
    try:
        matplotlib = _matplotlib()
        plain = {name: value for name, value in matplotlib.rcParamsDefault.items() if name not in _BACKEND}
        with matplotlib.rc_context(plain):
            figure = blank(width, height)
            yield figure
            figure.savefig(drawn, format="png", dpi=dpi)
    except Exception as error:
        why = (str(error).splitlines() or [""])[-1] or type(error).__name__
        raise NoPictureError(f"{path.name} could not be drawn: {why}") from error
    write_bytes(path, drawn.getvalue())


def attempt(draw: Callable[[], None]) -> None:
    """Draw a picture that no other file depends on; where there will be none, the log says why."""
    try:
        draw()
    except OSError:  # the disk: of all files or none
        raise
    except Exception as error:
        logger.warning("%s", str(error) or type(error).__name__)


def _matplotlib() -> Any:
    """Import matplotlib; once more without the user's settings where they keep it from being imported at all."""
    try:
        return require("matplotlib")
    except MissingExtraError:
        raise
    except Exception:
        for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
            del sys.modules[name]  # half a package, which nobody can have used
        with _own_settings():
            return require("matplotlib")


@contextmanager
def _own_settings() -> Iterator[None]:
    """Have matplotlib read its own matplotlibrc, and a backend that is always there."""
    home = find_spec("matplotlib").submodule_search_locations[0]  # type: ignore[union-attr, index]
    ours = {"MATPLOTLIBRC": str(Path(home, "mpl-data", "matplotlibrc")), "MPLBACKEND": "agg"}
    theirs = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)
    try:
        yield
    finally:
        for name, value in theirs.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
