"""Sonospline: real-time tissue deformation under a needle, for ultrasound-guided surgery simulation.

Not a medical device; not for clinical use.
"""

from typing import Any

import lazy_loader

_find, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Look the version up only when asked: it costs more than the rest of the import."""
    if name == "__version__":
        from importlib.metadata import version

        return version("sonospline")
    return _find(name)
