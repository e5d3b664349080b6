"""FEniCSx, the paper's own engine, in whichever Python has it.

DOLFINx comes from distributions, seldom from pip, and then belongs to the system's Python.
So it always runs in a process of its own, a worker that keeps its matrices from load to
load and is spoken to through files.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .._extras import MissingExtraError
from .engine import Engine, Mask, StepTimes, System

Array = NDArray[np.float64]

VARIABLE = "SONOSPLINE_FENICSX_PYTHON"
"""Environment variable that names the interpreter to use."""

_WORKER = Path(__file__).with_name("fenicsx_worker.py")
_PROBE = "import importlib.util, sys; sys.exit(importlib.util.find_spec('dolfinx') is None)"


class FEniCSx(Engine):
    """DOLFINx and PETSc, in the interpreter that :func:`interpreter` finds.

    PETSc's GAMG is the multigrid, MUMPS' Cholesky the direct solver. Held components are
    rows of the system like pinned ones, so a load case that holds others makes the
    hierarchy or factor anew.
    """

    def __init__(self, system: System) -> None:
        self._python = interpreter()
        self._system = system
        self._worker: _Worker | None = None

    def __reduce__(self) -> Any:
        return type(self), (self._system,)

    def solve(self, body_force: Array, prescribed: Array, held: Mask | None = None) -> tuple[Array, StepTimes]:
        given = np.broadcast_to(self._system.pinned[:, None], prescribed.shape)
        given = given if held is None else given | held
        worker, self._worker = self._worker, None  # one that fails is not used again
        if worker is None:
            worker = _Worker(self._python)
            worker.ask("build", **_arrays(self._system))
        answer = worker.ask("solve", body_force=body_force, prescribed=prescribed, given=given)
        self._worker = worker
        times = StepTimes.between(answer["clock"].tolist(), int(answer["iterations"]))
        return answer["displacement"], times


def interpreter() -> str:
    """Return the Python that has DOLFINx.

    The one that ``SONOSPLINE_FENICSX_PYTHON`` names, else the first of this Python,
    ``python3`` on the path and ``/usr/bin/python3`` that has it.

    Raises
    ------
    MissingExtraError
        None has it; the message says how to get it.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if not _has_dolfinx(named):
            raise MissingExtraError(f"{VARIABLE} = {named!r} is no Python that has DOLFINx; name another or unset it")
        return named
    candidates = (sys.executable, shutil.which("python3"), "/usr/bin/python3")
    for python in candidates:
        if python and _has_dolfinx(python):
            return python
    raise MissingExtraError(
        "DOLFINx is in no Python found; run: make fenicsx (Debian, Ubuntu), or name an interpreter that has it in "
        + VARIABLE
    )


def version() -> str:
    """Return the version of DOLFINx in the :func:`interpreter`; MissingExtraError as there."""
    command = [interpreter(), "-c", "import dolfinx; print(dolfinx.__version__)"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


@cache
def _has_dolfinx(python: str) -> bool:
    try:
        return subprocess.run([python, "-c", _PROBE], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def _arrays(system: System) -> dict[str, Array | NDArray[np.int64] | str | float]:
    lame, shear = system.moduli
    layered, of_layers = system.layers
    excess = np.zeros((len(system.cells), 6, 6) if len(layered) else (0, 6, 6))
    excess[layered] = of_layers
    return {
        "points": system.points,
        "cells": system.cells,
        "first_lame": lame,
        "shear_modulus": shear,
        "excess": excess,
        "springs": system.springs,
        "integration": system.integration,
        "solver": system.solver,
        "tolerance": system.tolerance,
    }


class _Worker:
    """A process that runs ``fenicsx_worker.py``; it ends with this object."""

    def __init__(self, python: str) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="sonospline-fenicsx-"))
        self._log = (self._folder / "log").open("w+", errors="replace")
        self._process = subprocess.Popen(
            [python, str(_WORKER), str(self._folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        weakref.finalize(self, _end, self._process, self._log, self._folder)

    def ask(self, task: str, **arrays: object) -> dict[str, NDArray[np.float64]]:
        """Have one task done; return the arrays it answers with."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        np.savez(self._folder / "task.npz", **arrays)  # type: ignore[arg-type]
        with suppress(BrokenPipeError):  # it died; its answer is missing too
            self._process.stdin.write(task + "\n")
            self._process.stdin.flush()
        if self._process.stdout.readline() != "done\n":
            self._log.seek(0)
            said = self._log.read().strip().splitlines() or ["nothing was said"]
            raise RuntimeError(f"the DOLFINx worker failed: {said[-1]}")
        with np.load(self._folder / "answer.npz") as answer:
            return dict(answer)


def _end(process: subprocess.Popen[str], log: IO[str], folder: Path) -> None:
    with log, process:
        pass  # leaving it closes its input, which ends it, and waits
    shutil.rmtree(folder, ignore_errors=True)  # made by mkdtemp for this worker alone
