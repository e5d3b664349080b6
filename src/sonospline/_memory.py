"""Refuse what would not fit in memory before it is allocated."""

from __future__ import annotations

from pathlib import Path

_SHARE = 0.8
_NEVER_REFUSED = 1 << 26  # asking the system costs more than such an allocation


def available_bytes() -> int | None:
    """Return the memory a new allocation can count on, None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    for line in lines:
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    return None


def refuse_beyond(wanted: int, what: str, *, remedy: str = "use a coarser grid") -> None:
    """Raise ValueError where ``wanted`` bytes are more than most of the free memory."""
    if wanted <= _NEVER_REFUSED:
        return
    free = available_bytes()
    if free is not None and wanted > _SHARE * free:
        raise ValueError(f"{what} would take {wanted:,} bytes, and {free:,} are free; {remedy}")
