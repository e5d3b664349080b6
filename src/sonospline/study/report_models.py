"""The part of the report that compares the three models of tissue with finite elements."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .._markdown import table
from .models_compared import model_titles
from .study import mean_rows

Row = dict[str, Any]

COSTS = {
    "ours": "paper",
    "kelvinlet": "kelvinlet",
    "elastic": "elastic, 25^3 up-sampled",
    "elastic_fine": "elastic, on as many nodes",
}


def compared_models(results: Row) -> Iterable[str]:
    """Yield the paragraphs and tables of the section."""
    models, scope = results["models"], results["plan"]["scope"]
    count, fine = len(scope["insertions"]), scope["fine"]
    yield "## Three models of tissue, and finite elements, on the same loads"
    yield (
        f"{count} held-out insertion{'s' if count > 1 else ''} ({', '.join(scope['insertions'])}). What each model is "
        "told: *paper* and *kelvinlet* the needle alone; their displacements were tuned in homogeneous tissue on case "
        "F, seven parameters and one. *elastic* is told the friction, the tip force and every cell's stiffness, as "
        "the reference is; *one stiffness* is the same without the labels. A spline cannot know that one tissue is "
        "stiffer than its neighbour: that is what the labelled cubes show, not a fault of its tuning."
    )
    yield "### Load case F: friction along the shaft and a force at the tip"
    yield (
        f"Full depth, against the converged field on {fine}^3 nodes: MAE / mean u, and in brackets the error at the "
        f"tip over the largest displacement. *elastic* takes {scope['steps']} steps on "
        f"{scope['side']}^3 nodes."
    )
    friction = [row for row in models["friction"] if row["depth"] == 1.0]
    yield _by_cube(friction, scope["cubes"])
    yield "![errors of the three models in the middle plane](models_maps.png)"
    yield "![errors of the three models against depth](models_depth.png)"
    yield "By tissue, error over displacement within it (in bone the displacement is next to nothing):"
    yield _by_tissue(friction)
    yield "### Load case D: a shaft that is held"
    titles = model_titles()
    factors = ", ".join(f"{titles[name]} {value:.2f}" for name, value in models["factors"].items())
    yield (
        f"Full depth, against finite elements on the same {scope['side']}^3 nodes (which nodes are held depends on "
        "the mesh). The kernels' fields are multiplied by one factor each, fitted to this load on the three tuning "
        f"insertions in homogeneous tissue: {factors}. *elastic* is not in the table: held by its own forces it is "
        "the reference, equal to scikit-fem's to 1e-5."
    )
    yield _by_cube(models["held"], scope["cubes"])
    yield "### What a step costs"
    yield "Milliseconds, one thread, every node of the mesh evaluated; in the seven-tissue body for *elastic*."
    yield table(
        ("mesh", *COSTS.values(), "FEM from scratch", "elastic on as many nodes, times faster than from scratch"),
        [
            (
                f"{row['side']}^3",
                *(f"{row[f'{name}_ms']:.2f}" for name in COSTS),
                f"{row['from_scratch_ms']:,.0f}",
                f"{row['from_scratch_ms'] / row['elastic_fine_ms']:,.0f}",
            )
            for row in results["times"]
        ],
    )


def _by_cube(rows: list[Row], cubes: list[str]) -> str:
    means = {(row["cube"], row["model"]): row for row in mean_rows(rows, "cube", "model")}
    titles = {model: title for model, title in model_titles().items() if any(found == model for _, found in means)}
    return table(
        ("cube", *titles.values()),
        [(cube, *(_errors_of(means.get((cube, model))) for model in titles)) for cube in cubes],
    )


def _by_tissue(rows: list[Row]) -> str:
    titles = model_titles()
    found: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        for tissue, relative in row["tissues"].items():
            found.setdefault((row["cube"], tissue), {}).setdefault(row["model"], []).append(relative)
    return table(
        ("cube", "tissue", *titles.values()),
        [
            (*place, *(f"{np.mean(errors[model]):.3f}" if model in errors else "" for model in titles))
            for place, errors in found.items()
        ],
    )


def _errors_of(row: Row | None) -> str:
    return "" if row is None else f"{row['relative']:.3f} ({row['tip_share']:.3f})"
