"""Tracked tools: where one coordinate system is in another, how poses go on, and a recorded hand."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
