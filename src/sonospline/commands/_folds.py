"""Tissue that is turned inside out is no result: it is refused unless it is asked for."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import Grid


def add_argument(group: Any) -> None:
    """Declare the option that lets folds pass."""
    group.add_argument("--allow-folds", action="store_true", help="write a field that folds over, instead of failing")


def refuse(det: NDArray[np.float64], grid: Grid, args: argparse.Namespace) -> None:
    """Raise RuntimeError where a field folds over and ``--allow-folds`` was not given.

    Parameters
    ----------
    det : (nx, ny, nz) ndarray
        det J at the nodes of ``grid``; at or below zero tissue is turned inside out.
    """
    if det.min() > 0 or args.allow_folds:
        return
    place = grid.node(np.array(np.unravel_index(det.argmin(), det.shape))[None])[0]
    where = ", ".join(f"{x:.1f}" for x in place)
    raise RuntimeError(
        f"the tissue folds over: det J = {det.min():.2f} at ({where}) mm RAS, at or below zero at "
        f"{int((det <= 0).sum()):,} of {det.size:,} nodes; end the needle earlier or keep it out of stiff tissue, "
        "or give --allow-folds to write the field all the same"
    )
