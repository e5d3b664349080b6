"""``sonospline doctor``: what is installed, what runs, and whether it computes correctly."""

from __future__ import annotations

import argparse
import platform
import time
from importlib.metadata import version
from typing import Any

import numpy as np

from .. import _core
from .._extras import PROVIDES, present
from ..geometry.grid import Grid
from ..geometry.needle import Needle
from ..geometry.tissue import Tissue
from ..models.spline.insertion import Insertion

HELP = "say which versions, backend and extras are in use, and check that they compute correctly"
EXAMPLES = """examples:
  sonospline doctor
  sonospline doctor --json
"""
_DISTRIBUTION = {"vtkmodules": "vtk", "skfem": "scikit-fem", "PIL": "pillow"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Do the verb; return its report."""
    native = _core.native
    report: dict[str, Any] = {
        "sonospline": version("sonospline"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "instruction_sets_available": native.instruction_sets() if native else [],
        "threads": native.thread_count() if native else 1,
        "extras": {
            module: version(_DISTRIBUTION.get(module, module)) if present(module) else None for module in PROVIDES
        },
    }
    report["self_check"] = _self_check()
    if not report["self_check"]["passed"]:
        raise RuntimeError(f"self-check failed: {report['self_check']}; reinstall sonospline")
    return report


def describe(report: dict[str, Any], args: argparse.Namespace) -> str:
    """Return the report as a few lines for a person."""
    check = report["self_check"]
    available = ", ".join(report["instruction_sets_available"])
    core = (
        f"compiled core, {report['instruction_set']} (of {available}), {report['threads']} threads"
        if report["backend"] == "core"
        else "NumPy twin (no compiled core in use: slower, same results)"
    )
    lines = [
        f"sonospline {report['sonospline']}, Python {report['python']}, {report['platform']}",
        f"numpy {report['numpy']}, scipy {report['scipy']}",
        f"backend: {core}",
    ]
    for module, found in report["extras"].items():
        lines.append(f"{module}: {found or f'absent (pip install {chr(39)}sonospline[{PROVIDES[module]}]{chr(39)})'}")
    lines.append(
        f"self-check: passed in {check['seconds']:.2f} s; a 25^3 step took {check['step_ms']:.1f} ms, "
        f"landmarks met to {check['landmark_error']:.0e}, backends agree to {check['backend_difference']:.0e}"
    )
    return "\n".join(lines)


def _self_check() -> dict[str, Any]:
    """Insert a needle into a small cube and check what must hold exactly."""
    start = time.perf_counter()
    insertion = Insertion(Tissue(Grid.unit_cube(25)))
    field = insertion.advance(Needle((0, 0.5, 0.5), (0.6, 0.5, 0.5)))
    field.on_grid("direct32")
    step_ms = 1e3 * (time.perf_counter() - start)
    anchored = float(np.abs(field.displacement(insertion.anchors)).max())
    difference = _backend_difference()
    return {
        "passed": anchored < 1e-9 and difference < 1e-11,
        "step_ms": step_ms,
        "landmark_error": anchored,
        "backend_difference": difference,
        "seconds": time.perf_counter() - start,
    }


def _backend_difference() -> float:
    """Largest difference between the backend in use and the NumPy twin on one random sum."""
    random = np.random.default_rng(0)
    points, centres, weights = random.random((500, 3)), random.random((50, 3)), random.random((50, 3))
    arguments = (0, points, centres, weights, np.zeros((4, 3)))
    ours, twins = _core.active.sum_at_points_f64(*arguments), _core.twin.sum_at_points_f64(*arguments)
    return float(np.abs(ours - twins).max() / np.abs(twins).max())
