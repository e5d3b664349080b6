"""The compiled core and its NumPy twin: the same functions, chosen once at import.

``SONOSPLINE_BACKEND=core`` demands the compiled core, ``numpy`` the twin; unset, the core
is used where it was built. ``SONOSPLINE_ISA`` names one of :func:`instruction_sets` and
``SONOSPLINE_THREADS`` the number of threads of the core.

Threads may share the core's objects: each call has its object alone. Arrays given to a plan or a
scene are its own from then on. A fork waits until no thread computes; parent and child go on with
the same objects. Where memory ends a call raises MemoryError, and the object is as it was.
"""

from __future__ import annotations

import logging
import os
from types import ModuleType

from . import twin

try:
    from . import _native as native
except ImportError:
    native = None  # type: ignore[assignment]

logger = logging.getLogger(__name__)

_MOST_THREADS = 1024


def _choose(wanted: str) -> ModuleType:
    if wanted not in ("", "core", "numpy"):
        raise ImportError(f"SONOSPLINE_BACKEND={wanted!r} is not known; use 'core' or 'numpy'")
    if wanted == "core" and native is None:
        raise ImportError(
            "SONOSPLINE_BACKEND='core', but the compiled core is not installed; "
            "install a C++17 compiler and reinstall sonospline, or use 'numpy'"
        )
    if wanted == "numpy" or native is None:
        logger.info("running on the NumPy twin of the compiled core")
        return twin
    _choose_instruction_set(os.environ.get("SONOSPLINE_ISA", ""))
    _choose_threads(os.environ.get("SONOSPLINE_THREADS", ""))
    return native


def _choose_instruction_set(wanted: str) -> None:
    if not wanted:
        return
    try:
        native.use_instruction_set(wanted)
    except ValueError:
        available = ", ".join(native.instruction_sets())
        raise ImportError(f"SONOSPLINE_ISA={wanted!r} cannot run here; use one of {available}") from None


def _choose_threads(wanted: str) -> None:
    if not wanted:
        return
    if not wanted.isdecimal() or len(wanted) > 4 or not 1 <= int(wanted) <= _MOST_THREADS:
        raise ImportError(f"SONOSPLINE_THREADS={wanted!r} is not a number of threads; use 1 to {_MOST_THREADS}")
    native.set_thread_count(int(wanted))


active = _choose(os.environ.get("SONOSPLINE_BACKEND", ""))


def backend() -> str:
    """Return the name of the backend in use: ``"core"`` or ``"numpy"``."""
    return "numpy" if active is twin else "core"


def instruction_set() -> str:
    """Return the instruction set in use, such as ``"avx512"``; ``"numpy"`` on the twin."""
    return "numpy" if active is twin else str(active.instruction_set())
