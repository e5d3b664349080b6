"""The core's own tests again, on a build that stops at the first wrong address, overflow, shift or conversion."""

import shutil
import subprocess
import sys

import pytest

import sanitized
from builds import needs_core

TESTS = (
    "core_injected.py",
    "test_core.py",
    "test_core_borders.py",
    "test_core_exit.py",
    "test_core_fork.py",
    "test_core_fuzz.py",
    "test_core_threads.py",
    "test_elastic_core.py",
    "test_multilevel.py",
    "test_ultrasound_bmode.py",
    "test_ultrasound_reslice.py",
)


@needs_core
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ builds it")
def test_the_core_runs_clean_under_the_sanitizers():
    sanitized.build()
    tests = [str(sanitized.ROOT / "tests" / name) for name in TESTS]
    command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "-m", "not slow", *tests]
    run = subprocess.run(command, env=sanitized.environment(), capture_output=True, text=True, check=False)
    assert run.returncode == 0, (run.stdout + run.stderr)[-8000:]
