"""3D Slicer's own core (PyPI: slicer-core, with trame-slicer), in a Python of its own: it pins another VTK."""

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PYTHON = Path(os.environ.get("SONOSPLINE_SLICER_PYTHON", ROOT / "build" / "slicer" / "bin" / "python"))
REQUIRED = os.environ.get("SONOSPLINE_REQUIRE_SLICER") == "1"


def read(*paths, **order):
    """What it makes of files; the test is skipped where it is not installed."""
    if not PYTHON.is_file():
        words = f"{PYTHON} is not there; scripts/setup.sh slicer installs it"
        pytest.fail(words) if REQUIRED else pytest.skip(words)
    done = subprocess.run(
        [PYTHON, ROOT / "tests" / "oracles" / "slicer_reads.py"],
        input=json.dumps({"load": [str(path) for path in paths], **order}),
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    answer = Path(done.stdout.splitlines()[-1])
    found = json.loads(answer.read_text())
    answer.unlink()
    assert all(found["loaded"]), found["messages"]
    return found
