"""The machine a race was run on, and the processors it was held to."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from .. import _core, _memory

PACKAGES = ("sonospline", "numpy", "scipy", "vtk", "itk", "pykeops", "torch")


def pin(threads: int) -> list[int]:
    """Hold this process, and every thread it will start, to its first ``threads`` processors."""
    processors = sorted(os.sched_getaffinity(0))[:threads]
    os.sched_setaffinity(0, processors)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = str(len(processors))
    os.environ["OMP_WAIT_POLICY"] = "passive"
    if _core.native is not None:
        _core.native.set_thread_count(len(processors))
    return processors


def describe(processors: list[int]) -> dict[str, Any]:
    """Return what a reader needs to know to place the figures."""
    return {
        "processor": processor(),
        "processors_used": processors,
        "memory_gb": round((_memory.available_bytes() or 0) / 1e9, 1),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "backend": _core.backend(),
        "instruction_set": _core.instruction_set(),
        "versions": {name: version_of(name) for name in PACKAGES},
    }


def processor_ticks() -> tuple[int, int] | None:
    """Return the time of all processors so far, in ticks: withheld by the host of this machine, and in all."""
    try:
        line = Path("/proc/stat").read_text().partition("\n")[0]
    except OSError:
        return None
    ticks = [int(value) for value in line.split()[1:9]]  # user, nice, system, idle, waiting, two interrupts, stolen
    return ticks[7], sum(ticks)


def withheld_since(before: tuple[int, int] | None) -> float | None:
    """Return the share of the processors' time that the host kept for others; None where nobody counts it."""
    now = processor_ticks()
    if before is None or now is None:
        return None
    return (now[0] - before[0]) / max(1, now[1] - before[1])


def peak_gb() -> float:
    """Largest memory this process held since :func:`forget_peak`, in GB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1e6
    return float("nan")


def forget_peak() -> None:
    """Start the peak anew (Linux only; elsewhere it stays the peak of the whole run)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def version_of(package: str) -> str | None:
    """Return the version of an installed package, or None."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
