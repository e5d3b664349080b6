"""What the race is run for: each claim, what it promises, and what came out."""

from __future__ import annotations

from typing import Any

Row = dict[str, Any]


def judge(results: dict[str, Any]) -> list[Row]:
    """Return one row a claim: text, promise, figure, kept (None where a peer is absent)."""
    steps, nodes = results["whole_step"], results["all_nodes"]
    claims: list[Row] = []

    def claim(text: str, promise: float, figure: float | None, *, at_most: bool = False) -> None:
        kept = None if figure is None else (figure <= promise if at_most else figure >= promise)
        claims.append({"claim": text, "promise": promise, "at_most": at_most, "figure": figure, "kept": kept})

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
