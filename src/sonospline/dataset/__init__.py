"""Data sets of insertions with all that is true of them, from one processor to a cluster."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
