"""Ten minutes of scripted use leave the live simulator's memory flat within 5 %, in order, and without threads.

Pushes, probe moves, knobs, freezes, model switches, undo and reset at 30 commands a second; the page is reloaded every
20 s and every third one vanishes with frames in flight.

    python benchmarks/ten_minutes_of_use_leave_memory_flat.py [--minutes 10] [--scene kidney]
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from soak import soak

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--minutes", type=float, default=10.0)
parser.add_argument("--scene", default="kidney")
arguments = parser.parse_args()
result = soak(arguments.scene, 60 * arguments.minutes)
print(json.dumps(result, indent=2))
kept = (
    0.95 <= result["memory_mb"]["ratio"] <= 1.05
    and result["out_of_order"] == 0
    and not result["faults"]
    and result["threads"]["after"] <= result["threads"]["before"]
)
print("kept" if kept else "MISSED")
sys.exit(0 if kept else 1)
