"""Fig. 3 of the paper: error against depth for each mesh, and time per step against nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..io.canvas import picture

Row = dict[str, Any]

BASELINES = {
    "from_scratch_ms": "FEM, assembled and solved from scratch",
    "multigrid_ms": "FEM, assembled once, multigrid",
    "direct_ms": "FEM, factored once, back-substitution",
    "dense_ms": "PHS, the paper's dense step",
    "ours_ms": "PHS, ours",
}
PAPER_TIMES = {"FEM, the paper": (48**3, 18_919.7), "PHS, the paper": (48**3, 45.8)}


def draw_curves(errors: list[Row], times: list[Row], path: Path) -> None:
    """Write Fig. 3.

    Parameters
    ----------
    errors : list of dict
        ``side``, ``depth`` (fraction of the way), ``mae``, ``rmse``, ``relative``; means over the held-out insertions.
    times : list of dict
        ``nodes`` and the medians that ``BASELINES`` names; absent or None where not measured.
    path : Path
        File to write.
    """
    with picture(path, 18, 5.6) as figure:
        depth, share, cost = figure.subplots(1, 3)
        for side in sorted({row["side"] for row in errors}):
            rows = sorted((row for row in errors if row["side"] == side), key=lambda row: row["depth"])
            at = [row["depth"] for row in rows]
            (line,) = depth.plot(at, [1e3 * row["mae"] for row in rows], marker="o", ms=3, label=f"{side}^3")
            depth.plot(at, [1e3 * row["rmse"] for row in rows], ls="--", color=line.get_color())
            share.plot(
                at, [row["relative"] for row in rows], marker="o", ms=3, color=line.get_color(), label=f"{side}^3"
            )
        depth.set_ylabel("error (1e-3 cube sides)")
        depth.set_title("a) MAE (solid) and RMSE (dashed), held-out insertions")
        share.set_ylabel("MAE / mean |u(FEM)|")
        share.set_title("the same MAE, relative")
        share.axhline(1, color="0.4", ls=":", lw=1.2, label="doing nothing")
        for panel in (depth, share):
            panel.set_xlabel("insertion depth (of the way)")
            panel.set_ylim(bottom=0)
            panel.grid(alpha=0.3, lw=0.4)
            panel.legend(title="nodes", fontsize=8, loc="lower left")
        _times(cost, times)


def _times(panel: Any, times: list[Row]) -> None:
    for name, label in BASELINES.items():
        points = sorted((row["nodes"], row[name]) for row in times if row.get(name) is not None)
        if points:
            panel.loglog(*np.transpose(points), marker="o", ms=4, lw=2.5 if name == "ours_ms" else 1.4, label=label)
    for label, (nodes, ms) in PAPER_TIMES.items():
        panel.plot(nodes, ms, marker="x" if "FEM" in label else "+", ms=9, ls="", color="0.35", label=label)
    panel.set_xlabel("nodes")
    panel.set_ylabel("time per step (ms)")
    panel.set_title("b) time per step, one thread each")
    panel.set_ylim(top=30 * panel.get_ylim()[1])  # room for the legend
    panel.grid(alpha=0.3, which="both", lw=0.4)
    panel.legend(fontsize=8, loc="upper left", ncols=2)
