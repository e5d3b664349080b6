"""Have the scripted expert do every shipped exercise from several starts, and write what it reached as a band.

    python scripts/make_expert_band.py [--starts 12] [NAME...]

The file is data of the package: each attempt's metrics, from which `sonospline.training.Band` makes means and spreads.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from importlib.metadata import version
from pathlib import Path

from sonospline.io.writing import write_text
from sonospline.simulator import make_scene
from sonospline.training import SHIPPED_EXERCISES, Attempt, Exercise, Expert, performed

FILE = Path(__file__).parents[1] / "src" / "sonospline" / "training" / "expert_band.json"
DT_S = 0.1
DIGITS = 6


def attempts(name: str, starts: int) -> list[dict[str, float | None]]:
    """The metrics of an expert's attempts; None for what a trace does not tell."""
    exercise = Exercise.shipped(name)
    scene = make_scene(exercise.scene_file())
    found = []
    for seed in range(starts):
        result = performed(Attempt(exercise, scene, seed=seed), Expert(across="out-of-plane" in name), dt=DT_S)
        sys.stderr.write(f"{name} from start {seed}: {result.verdict}\n")
        found.append({key: known(value) for key, value in result.metrics.items()})
    return found


def known(value: float) -> float | None:
    """A number as JSON has it."""
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=SHIPPED_EXERCISES, help="exercises; by default all")
    parser.add_argument("--starts", type=int, default=12, help="seeds 0 to this (12)")
    args = parser.parse_args()
    table = json.loads(FILE.read_text()) if FILE.exists() else {"exercises": {}}
    table["made_by"] = (
        f"scripts/make_expert_band.py with sonospline {version('sonospline')}: the scripted expert, which knows where "
        f"the target is, a command each {DT_S:g} s, one attempt from each of seeds 0 to {args.starts - 1}"
    )
    for name in args.names:
        rows = attempts(name, args.starts)
        table["exercises"][name] = {key: [row[key] for row in rows] for key in rows[0]}
        text = json.dumps(table, indent=1)
        text = re.sub(
            r"\[[^\[\]{}]*\]", lambda found: " ".join(found[0].split()), text
        )  # an attempt's numbers in a line
        write_text(FILE, text + "\n")


if __name__ == "__main__":
    main()
