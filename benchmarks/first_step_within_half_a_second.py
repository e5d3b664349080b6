"""From process start to the first 25^3 step, and the import alone, each in a fresh process.

Claim: import under 0.5 s, NumPy included; first step within 0.5 s of process start.
"""

import statistics
import subprocess
import sys
import time

IMPORT = "import sonospline"
STEP = """
import sonospline as ss
insertion = ss.Insertion(ss.Tissue(ss.Grid.unit_cube(25)))
insertion.advance(ss.Needle((0, .5, .5), (.6, .5, .5))).on_grid()
"""


def seconds(code):
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    return time.perf_counter() - start


for name, code in (("bare interpreter", "pass"), ("numpy", "import numpy"), ("import", IMPORT), ("first step", STEP)):
    rounds = [seconds(code) for _ in range(8)][1:]
    print(f"{name:18s} median {statistics.median(rounds):.3f} s  (min {min(rounds):.3f}, max {max(rounds):.3f})")
