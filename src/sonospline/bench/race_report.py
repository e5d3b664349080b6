"""The race on paper: tables for people, a picture of cost against nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .._markdown import table, table_of
from ..io.canvas import picture
from . import promises

Row = dict[str, Any]


SECTIONS = (
    (
        "**Growth** of the multilevel sum.",
        "growth",
        "nodes | landmarks | ms | ns a node | peak GB",
        "{nodes:,} | {landmarks} | {multilevel} | {ns_per_node:.1f} | {peak_gb:.2f}",
    ),
    (
        "**Multilevel against our direct float32 sum.**",
        "multilevel_against_direct",
        "nodes | landmarks | multilevel | direct32 | ratio",
        "{nodes:,} | {landmarks} | {multilevel} | {direct32} | {ratio:.1f}",
    ),
    (
        "**Append and solve**, mean step, against one dense LAPACK solve of all landmarks and of the step's own.",
        "incremental",
        "landmarks | steps | ours | LAPACK | ratio | ratio, own size | error of weights",
        "{landmarks} | {steps} | {mean_step} | {dense_solve} | {ratio:.1f} | {ratio_to_own_size:.1f} | "
        "{weights_error:.0e}",
    ),
    (
        "**Insertion at 53^3** through `Insertion.advance` and `on_grid`.",
        "insertion_step",
        "anchors | landmarks | ms | drift of the faces",
        "{anchors:,} | {landmarks} | {step} | {face_drift:.0e}",
    ),
)
"""Title, name in the results, headings and format of a row."""


def tables(results: dict[str, Any]) -> str:
    """Return every section as Markdown tables."""
    machine = results["machine"]
    sampling = [{"what": name, "times": times} for name, times in results["sampling"]["times"].items()]
    parts = [
        f"{machine['processor']}, processors {machine['processors_used']}, {machine['memory_gb']} GB free, "
        f"{machine['platform']}; {machine['backend']}, {machine['instruction_set']}; medians in ms (min to max)."
        + _withheld(machine["withheld"]),
        "**Whole step at 53^3**: select, append, solve, all nodes; a peer fits and evaluates as many landmarks.",
        table(("landmarks", "who", "ms", "times ours"), map(_step, results["whole_step"])),
        "**All nodes**: evaluation alone, fit, and largest error against the float64 sum.",
        table(
            ("nodes", "landmarks", "who", "evaluate", "times multilevel", "fit", "error"),
            map(_evaluation, results["all_nodes"]),
        ),
    ]
    for title, name, head, line in SECTIONS:
        parts += [title, table_of(map(_with_times, results[name]), head, line)]
    parts += [
        "**Sampling** the field at 53^3, n = 300.",
        table_of(map(_with_times, sampling), "what | ms", "{what} | {times}"),
        "**Claims.**",
        promises.table_of_promises(results["claims"]),
    ]
    return "\n\n".join(parts) + "\n"


def _withheld(share: float | None) -> str:
    if share is None:
        return ""
    return f" The host of this virtual machine withheld {share:.0%} of its processors' time meanwhile."


def _step(row: Row) -> tuple[Any, ...]:
    if "left_out" in row:
        return row["landmarks"], row["contender"], f"left out: {row['left_out']}", ""
    ratio = f"{row['ratio_to_ours']:.0f}" if "ratio_to_ours" in row else "1"
    return row["landmarks"], row["contender"], _ms(row["step"]), ratio


def _evaluation(row: Row) -> tuple[Any, ...]:
    head = (f"{row['nodes']:,}", row["landmarks"], row["contender"])
    if "left_out" in row:
        return (*head, f"left out: {row['left_out']}", "", "", "")
    fit = _ms(row["fit"]) if "fit" in row else f"left out: {row['fit_left_out']}"
    return (*head, _ms(row["evaluate"]), f"{row['ratio_to_multilevel']:.1f}", fit, f"{row['error']:.0e}")


def _with_times(row: Row) -> Row:
    """A row whose times are texts."""
    return {name: _ms(value) if isinstance(value, dict) else value for name, value in row.items()}


def _ms(times: Row) -> str:
    def short(value: float) -> str:
        return f"{value:.2f}" if value < 10 else f"{value:.0f}"

    return f"{short(times['median_ms'])} ({short(times['min_ms'])} to {short(times['max_ms'])})"


def draw_cost(results: dict[str, Any], path: Path) -> None:
    """Write cost against nodes, log-log, at n = 1000."""
    curves: dict[str, list[tuple[int, float]]] = {}
    most = max(row["landmarks"] for row in results["all_nodes"])
    for row in results["all_nodes"]:
        if row["landmarks"] == most and "evaluate" in row:
            curves.setdefault(row["contender"], []).append((row["nodes"], row["evaluate"]["median_ms"]))
    grown = [(r["nodes"], r["multilevel"]["median_ms"]) for r in results["growth"] if r["landmarks"] == 1000]
    curves["sonospline multilevel"] = sorted(set(grown))
    with picture(path, 8, 5.5, dpi=120) as figure:
        panel = figure.subplots()
        for name, points in curves.items():
            ours = name == "sonospline multilevel"
            panel.loglog(*zip(*sorted(points), strict=True), marker="o", ms=4, lw=2.5 if ours else 1.2, label=name)
        panel.axhline(1, color="0.6", lw=0.8, ls=":")
        panel.text(panel.get_xlim()[0], 1.1, " 1,000 volumes a second", color="0.4", fontsize=8)
        panel.set_xlabel("nodes")
        panel.set_ylabel("evaluation of all nodes (ms)")
        panel.set_title(f"Cost against nodes, {most:,} landmarks")
        panel.grid(alpha=0.3, which="both", lw=0.4)
        panel.legend(fontsize=8)
