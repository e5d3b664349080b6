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
    yield _by_specimen(friction)
    yield "![errors of the three models in the middle plane](models_maps.png)"
    yield "![errors of the three models against depth](models_depth.png)"
    yield "By tissue, error over displacement within it; what hardly moves, as bone does, is left out:"
    yield _by_tissue(friction)
    if results["anatomy"]["friction"]:
        yield from _anatomy(results["anatomy"], scope)
    yield "### Load case D: a shaft that is held"
    titles = model_titles()
    factors = ", ".join(f"{titles[name]} {value:.2f}" for name, value in models["factors"].items())
    yield (
        f"Full depth, against finite elements on the same {scope['side']}^3 nodes (which nodes are held depends on "
        "the mesh). The kernels' fields are multiplied by one factor each, fitted to this load on the three tuning "
        f"insertions in homogeneous tissue: {factors}. *elastic* is not in the table: held by its own forces it is "
        "the reference, equal to scikit-fem's to 1e-5."
    )
    yield _by_specimen(models["held"])
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


def _anatomy(found: Row, scope: Row) -> Iterable[str]:
    rows = [row for row in found["friction"] if row["depth"] == 1.0]
    yield "### Real anatomy"
    yield (
        "The same in labelled anatomy in mm, kPa and N: " + _which(found) + ". The needles are the held-out ones that "
        "meet no bone; materials are the assumed ones. The kernels and *one stiffness* know neither these forces nor "
        "these stiffnesses: each is multiplied by the one factor that fits this very field best, which nobody could "
        f"know before. *elastic* takes {scope['steps']} steps at its defaults; the reference is its own solution on "
        f"{scope['fine'] ** 3:,} nodes, and on {scope['checked'] ** 3:,} that equals scikit-fem's on the same cells to "
        f"{max(row['difference'] for row in found['scikit_fem']):.0e} of the peak."
    )
    yield _by_specimen(rows)
    yield "Needle by needle, what *elastic* publishes and what it is off by, over the mean displacement:"
    yield table(
        ("anatomy", "insertion", "error estimate", "from its own converged field", "from the fine grid", "at the tip"),
        [
            (
                row["specimen"],
                row["insertion"],
                *(f"{row[name]:.3f}" for name in ("published", "iteration", "relative", "tip_share")),
            )
            for row in rows
            if row["model"] == "elastic"
        ],
    )
    yield "![errors of the models in real anatomy](models_anatomy.png)"
    yield "By tissue:"
    yield _by_tissue(rows)


def _which(found: Row) -> str:
    names = list(found["maps"])
    if len(names) > 1:
        return f"the {names[0]}, and in *{names[1]}* the cube in which most tissues meet"
    return f"the {names[0]} (no patient's label map was given: `--labels FILE`)"


def _by_specimen(rows: list[Row]) -> str:
    means = {(row["specimen"], row["model"]): row for row in mean_rows(rows, "specimen", "model")}
    titles = {model: title for model, title in model_titles().items() if any(found == model for _, found in means)}
    return table(
        ("tissue", *titles.values()),
        [
            (specimen, *(_errors_of(means.get((specimen, model))) for model in titles))
            for specimen in dict.fromkeys(specimen for specimen, _ in means)
        ],
    )


def _by_tissue(rows: list[Row]) -> str:
    titles = model_titles()
    found: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in rows:
        for tissue, relative in row["tissues"].items():
            found.setdefault((row["specimen"], tissue), {}).setdefault(row["model"], []).append(relative)
    return table(
        ("in", "tissue", *titles.values()),
        [
            (*place, *(f"{np.mean(errors[model]):.3f}" if model in errors else "" for model in titles))
            for place, errors in found.items()
        ],
    )


def _errors_of(row: Row | None) -> str:
    return "" if row is None else f"{row['relative']:.3f} ({row['tip_share']:.3f})"
