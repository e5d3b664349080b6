"""Where, and how deep, the three models of tissue differ from finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..io.canvas import picture
from .figure_mesh import NEEDLE
from .models_compared import model_titles
from .study import mean_rows

Row = dict[str, Any]

_SHOWN = ("tuned", "kelvinlet", "one stiffness", "elastic")
_DECADES = 3
"""Of the error's colour scale."""


def draw_maps(maps: dict[str, Row], path: Path) -> None:
    """Write the errors in the plane of the needle, a column for each specimen.

    Parameters
    ----------
    maps : dict of str to dict
        For each specimen, (depth, across) lists: ``reference`` displacement, the error of each model, ``labels``;
        and the ends of the ``needle`` in nodes.
    path : Path
        File to write.
    """
    from matplotlib.colors import LogNorm

    with picture(path, 3.1 * len(maps) + 1.2, 2.9 * (1 + len(_SHOWN)), dpi=100) as figure:
        panels = figure.subplots(1 + len(_SHOWN), len(maps), squeeze=False)
        drawn = {}
        for column, (specimen, fields) in zip(panels.T, maps.items(), strict=True):
            largest = np.max(fields["reference"])
            for panel, name in zip(column, ("reference", *_SHOWN), strict=True):
                panel.set_xticks([])
                panel.set_yticks([])
                if name not in fields:
                    panel.axis("off")
                    panel.text(0.5, 0.5, "no labels to know", ha="center", va="center", color="0.4")
                    continue
                shares = np.array(fields[name]).T / largest
                norm = None if name == "reference" else LogNorm(10.0**-_DECADES, 1.0, clip=True)
                shown = panel.imshow(
                    np.maximum(shares, 1e-12), origin="lower", norm=norm, cmap="viridis" if norm is None else "magma"
                )
                drawn[name] = shown
                labels = np.array(fields["labels"]).T
                for label in np.unique(labels)[1:]:
                    panel.contour(labels == label, levels=[0.5], colors="white", linewidths=0.7)
            column[0].plot(*np.transpose(fields["needle"]), color=NEEDLE, lw=1.5)
            column[0].set_title(specimen)
        for row, name in zip(panels, ("reference", *_SHOWN), strict=True):
            label = "finite elements, |u|" if name == "reference" else f"error, {model_titles()[name]}"
            row[-1].annotate(label, (1.04, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=9)
        figure.colorbar(drawn["reference"], ax=panels[0], label="of the largest", pad=0.03)
        figure.colorbar(
            drawn["elastic"], ax=panels[1:], label="error over the largest displacement", pad=0.03, aspect=60
        )


def draw_depths(rows: list[Row], path: Path) -> None:
    """Write the relative errors against depth, a panel for each cube.

    Parameters
    ----------
    rows : list of dict
        ``specimen``, ``model``, ``depth`` (fraction of the way) and ``relative``, for each insertion.
    path : Path
        File to write.
    """
    means = mean_rows(rows, "specimen", "model", "depth")
    cubes = list(dict.fromkeys(row["specimen"] for row in means))
    with picture(path, 3.1 * len(cubes), 4.0, dpi=100) as figure:
        panels = figure.subplots(1, len(cubes), sharey=True, squeeze=False)[0]
        for panel, cube in zip(panels, cubes, strict=True):
            for number, (model, label) in enumerate(model_titles().items()):
                line = [
                    (row["depth"], row["relative"]) for row in means if (row["specimen"], row["model"]) == (cube, model)
                ]
                if line:
                    style = {"marker": "o", "ms": 3, "lw": 2.2 if model == "elastic" else 1.3}
                    panel.semilogy(*zip(*line, strict=True), label=label, color=f"C{number}", **style)
            panel.axhline(1, color="0.4", ls=":", lw=1.2, label="doing nothing")
            panel.set_title(cube)
            panel.set_xlabel("depth (of the way)")
            panel.grid(alpha=0.3, which="both", lw=0.4)
        panels[0].set_ylabel("MAE / mean |u(FEM)|, load case F")
        figure.legend(*panels[-1].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=9)
