"""Environments for learning, by Gymnasium's interface: importing it makes their names known to ``gymnasium.make``."""

import lazy_loader

from .registration import register

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
register()
