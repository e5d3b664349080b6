"""Ten minutes of two rude clients leave a link well: no stall, no leak, the page's session unharmed.

Two clients come and go, vanish within messages, send garbage and headers that lie, at least a million of them in all.
Beside them a page's session goes on in a Runner, and a well-behaved client reads its frames. Printed are the longest
time between two of its images, the memory of the process at the end over that after a tenth of the time, its threads
and open files. It exits with 1 where an image is more than 2 s late, memory grows by more than a tenth and 20 MB,
threads or files are left over, or the session has reported an error.

    python benchmarks/ten_minutes_of_rude_clients_leave_the_link_well.py [--minutes 10] [--headers 1000000]
"""

import argparse
import json
import logging
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from link_soak import leaks, soak


def well(found: dict[str, object]) -> bool:
    """Whether a link is as it should be afterwards."""
    return found["longest_gap_s"] < 2.0 and not leaks(found)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--headers", type=int, default=1_000_000)
    parser.add_argument("--scene", default="gel")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    report = soak(60 * arguments.minutes, arguments.headers, arguments.scene)
    print(json.dumps(report, indent=2))
    print("well" if well(report) else "HARMED")
    sys.exit(0 if well(report) else 1)
