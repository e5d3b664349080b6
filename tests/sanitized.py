"""A build of the core that stops at the first fault, beside the ordinary one, and a Python that runs on it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build" / "sanitized"

# Finds the core there, whatever is installed, in this process and in those it starts.
SITE = """
import importlib.util, sys
from pathlib import Path

class Sanitized:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "sonospline._core._native":
            return importlib.util.spec_from_file_location(name, next(Path(__file__).parent.glob("_native*")))

sys.meta_path.insert(0, Sanitized)
"""


def build() -> None:
    """Compile what has changed since the last time."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", BUILD, ROOT]
    settings = ["cmake.define.SONO_SANITIZE=ON", "cmake.define.NPM=", f"build-dir={BUILD}/cmake"]
    subprocess.run([*command, *(f"-C{setting}" for setting in settings)], check=True)
    (wheel,) = BUILD.glob("*.whl")
    with zipfile.ZipFile(wheel) as package:
        (library,) = (name for name in package.namelist() if "/_native" in name and name.endswith(".so"))
        (BUILD / Path(library).name).write_bytes(package.read(library))
    wheel.unlink()
    (BUILD / "sitecustomize.py").write_text(SITE)


def environment() -> dict[str, str]:
    """Return what a Python needs to run on it: the sanitizer before all else, and what throws beside it.

    Leaks are not looked for: CPython itself keeps memory to the end, and so do the threads' scratch vectors.
    """
    return os.environ | {
        "LD_PRELOAD": f"{_library('libasan.so')} {_library('libstdc++.so')}",
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1:allocator_may_return_null=1:handle_segv=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONPATH": os.pathsep.join([str(BUILD), str(ROOT / "tests")]),
        "PYTHONMALLOC": "malloc",
    }


def _library(name: str) -> str:
    command = ["g++", f"-print-file-name={name}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
