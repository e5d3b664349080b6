"""What of the compiled core is here, for tests of it, and a Python that lacks a package."""

import subprocess
import sys

import pytest

from sonospline import _core

INSTRUCTION_SETS = [] if _core.native is None else _core.native.instruction_sets()

needs_core = pytest.mark.skipif(_core.native is None, reason="the compiled core is not built")


def run_without(package, *arguments):
    """Run the command line in a process where a package cannot be found."""
    code = (
        "import sys, importlib.util as u; find = u.find_spec\n"
        f"u.find_spec = lambda name, *a: None if name == {package!r} else find(name, *a)\n"
        "from sonospline.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)
