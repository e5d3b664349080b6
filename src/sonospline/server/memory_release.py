"""Give memory that sessions left behind back to the system."""

from __future__ import annotations

import ctypes
import gc


def release_memory() -> None:
    """Collect what is unreachable, and have the C library return free pages where it can.

    Each session works in a thread of its own, and the memory of threads that ended stays with the process until
    it is asked for: without this a server that is visited all day looks as if it leaked.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc alone has it
    if trim is not None:
        trim(0)
