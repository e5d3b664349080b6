"""PerkTutor's own scripts, where a copy of them is to be had: SONOSPLINE_PYTHONMETRICS names its folder."""

import importlib.util
import os
import sys
import types
from pathlib import Path

import numpy as np
import pytest


def scripts():
    """The folder of PythonMetrics; a test that needs it skips where there is none."""
    folder = os.environ.get("SONOSPLINE_PYTHONMETRICS")
    if not folder:
        pytest.skip("SONOSPLINE_PYTHONMETRICS names no folder of github.com/PerkTutor/PythonMetrics")
    pytest.importorskip("vtk")
    return Path(folder)


def metric(name, times, poses):
    """What a script makes of a tool's poses."""
    import vtk

    base = types.ModuleType("PythonMetricsCalculator")
    base.PerkEvaluatorMetric = type("PerkEvaluatorMetric", (), {"__init__": lambda self: None})
    sys.modules["PythonMetricsCalculator"] = base
    spec = importlib.util.spec_from_file_location(name, scripts() / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = getattr(module, name)()
    takes_role = found.AddTimestamp.__code__.co_argcount == 5
    for time, pose in zip(times, poses, strict=True):
        matrix = vtk.vtkMatrix4x4()
        matrix.DeepCopy(np.ascontiguousarray(pose).ravel().tolist())
        point = [*pose[:3, 3].tolist(), 1.0]
        found.AddTimestamp(float(time), matrix, point, *(["Any"] if takes_role else []))
    return found.GetMetric()
