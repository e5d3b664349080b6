"""Refuse what would not fit in memory before it is allocated."""

from __future__ import annotations

from pathlib import Path

_SHARE = 0.8
_NEVER_REFUSED = 1 << 26  # asking the system costs more than such an allocation


def available_bytes() -> int | None:
    """Return the memory a new allocation can count on, in this machine and container; None where nobody says."""
    known = [limit for limit in (_machine_bytes(), _group_bytes()) if limit is not None]
    return min(known, default=None)


def _machine_bytes() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    for line in lines:
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    return None


def free_bytes(wanted: int) -> int | None:
    """Return how much of the free memory may be asked for; None where little is wanted, or nobody knows."""
    free = None if wanted <= _NEVER_REFUSED else available_bytes()
    return None if free is None else int(_SHARE * free)


def refuse_beyond(wanted: int, what: str, *, remedy: str = "use a coarser grid") -> None:
    """Raise ValueError where ``wanted`` bytes are more than most of the free memory."""
    free = free_bytes(wanted)
    if free is not None and wanted > free:
        raise ValueError(f"{what} would take {wanted:,} bytes, and {free:,} can be had; {remedy}")


def _group_bytes() -> int | None:
    """Return what the control group of this process (a container) may still take; None without a limit."""
    group = Path("/sys/fs/cgroup")
    try:
        most = int((group / "memory.max").read_text())  # "max" where there is no limit
        held = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
        return max(0, most - int(held["anon"]))
    except (OSError, ValueError, KeyError):
        return None
