"""A function called in a fresh process with one thread: a BLAS fixes its threads when it is first loaded.

Run as a program it prints, as JSON, what the named function returns of the JSON list of its arguments.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "SONOSPLINE_THREADS"), "1")


def in_one_thread(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function of a module returns in a process of its own; arguments and result are JSON.

    Raises
    ------
    RuntimeError
        That process failed; the last line it said is quoted.
    """
    command = [sys.executable, "-m", __name__, function.__module__, function.__name__, json.dumps(arguments)]
    done = subprocess.run(command, env=os.environ | _ONE_THREAD, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["nothing"]
        raise RuntimeError(f"{function.__name__}{arguments} failed: {said[-1]}")
    return json.loads(done.stdout)


if __name__ == "__main__":
    module, name, given = sys.argv[1:]
    json.dump(getattr(import_module(module), name)(*json.loads(given)), sys.stdout)
