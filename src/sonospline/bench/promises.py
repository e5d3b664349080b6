"""What is promised of speed: of the race against peers, and of the live simulator."""

from __future__ import annotations

from typing import Any

from .._markdown import table

Row = dict[str, Any]

SERVER_MS, SERVER_P95_MS = 20.0, 50.0
"""What a pose may take on the server until its frame is encoded: median, and 95th percentile."""
DRAWN_MS, DRAWN_P95_MS = 50.0, 100.0
"""What it may take until its frame is drawn in a browser."""


def promised(text: str, promise: float, figure: float | None, *, at_most: bool = False) -> Row:
    """Return a promise with what was measured, and whether it was kept: None where nothing was."""
    kept = None if figure is None else (figure <= promise if at_most else figure >= promise)
    return {"claim": text, "promise": promise, "at_most": at_most, "figure": figure, "kept": kept}


def table_of_promises(rows: list[Row]) -> str:
    """Return promises as a Markdown table."""
    verdict = {True: "kept", False: "MISSED", None: "not measured"}
    return table(
        ("claim", "promised", "measured", ""),
        [
            (
                row["claim"],
                f"{'at most' if row['at_most'] else 'at least'} {row['promise']:g}",
                "" if row["figure"] is None else f"{row['figure']:.3g}",
                verdict[row["kept"]],
            )
            for row in rows
        ],
    )


def of_the_simulator(latency: dict[str, Row], out_of_order: int) -> list[Row]:
    """Return the promises of the live simulator; of its frames in a browser, where there was one."""
    server, drawn = latency["server_ms"], latency.get("pose_to_drawn_ms")
    limits = [
        ("pose to encoded frame, median, ms", SERVER_MS, server["median"]),
        ("pose to encoded frame, 95th percentile, ms", SERVER_P95_MS, server["p95"]),
        ("frames out of order", 0, out_of_order),
    ]
    if drawn:
        limits += [
            ("pose to frame drawn in a browser, median, ms", DRAWN_MS, drawn["median"]),
            ("pose to frame drawn in a browser, 95th percentile, ms", DRAWN_P95_MS, drawn["p95"]),
        ]
    return [promised(text, most, figure, at_most=True) for text, most, figure in limits]


def of_the_race(results: Row) -> list[Row]:
    """Return the promises of the race; one whose peer is absent is not measured."""
    steps, nodes = results["whole_step"], results["all_nodes"]
    claims: list[Row] = []

    def claim(text: str, promise: float, figure: float | None, *, at_most: bool = False) -> None:
        claims.append(promised(text, promise, figure, at_most=at_most))

    def step_ratio(contender: str, n: int) -> float | None:
        return _find(steps, "ratio_to_ours", contender=contender, landmarks=n)

    for n, promise in ((300, 160), (1000, 180)):
        claim(f"step at 53^3, n = {n}: times faster than SciPy", promise, step_ratio("scipy RBFInterpolator", n))
    for name in ("KeOps float32", "torch cdist float32"):
        for n in (300, 1000):
            claim(f"step at 53^3, n = {n}: times faster than {name} with LAPACK fit", 80, step_ratio(name, n))
    for n in (300, 1000):
        mine = _find(steps, "step", contender="sonospline step", landmarks=n)
        vtk = _find(nodes, "evaluate", contender="VTK thin plate (basis R)", nodes=53**3, landmarks=n)
        ratio = vtk["median_ms"] / mine["median_ms"] if mine and vtk else None
        claim(f"step at 53^3, n = {n}: times faster than VTK's evaluation alone", 100, ratio)
    for side, n, promise in ((53, 300, 4), (53, 1000, 5), (216, 1000, 25)):
        ratio = _find(results["multilevel_against_direct"], "ratio", nodes=side**3, landmarks=n)
        claim(f"multilevel at {side}^3, n = {n}: times faster than our direct float32", promise, ratio)
    for total, promise in ((20, 20), (200, 40)):
        ratio = _find(results["incremental"], "ratio", steps=total)
        claim(f"append and solve over {total} steps to n = 1000: times faster than LAPACK at n = 1000", promise, ratio)
    scipy = _find(nodes, "evaluate", contender="scipy RBFInterpolator", nodes=53**3, landmarks=1000)
    ten, hundred = (_find(results["growth"], "ns_per_node", nodes=side**3) for side in (216, 464))
    claim(
        "10 million nodes, n = 1000: cost per node, times below SciPy's at 53^3",
        500,
        1e6 * scipy["median_ms"] / 53**3 / ten if scipy and ten else None,
    )
    claim("100 million nodes: memory in GB", 3.0, _find(results["growth"], "peak_gb", nodes=464**3), at_most=True)
    claim(
        "100 million nodes: cost per node over that at 10 million",
        1.0,
        hundred / ten if hundred and ten else None,
        at_most=True,
    )
    mine = _find(steps, "step", contender="sonospline step", landmarks=300)
    claim("step at 53^3, n = 300, in ms", 1.0, mine["median_ms"] if mine else None, at_most=True)
    drift = min((row["face_drift"] for row in results["insertion_step"]), default=None)
    claim("every face node pinned: drift of the faces in cube sides", 1e-6, drift, at_most=True)
    return claims


def _find(rows: list[Row], key: str, **wanted: Any) -> Any:
    for row in rows:
        if all(row.get(name) == value for name, value in wanted.items()):
            return row.get(key)
    return None
