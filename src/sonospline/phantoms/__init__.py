"""Phantoms that are painted: a kidney with its flank, a block of gel with a vessel, the paper's cube."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
