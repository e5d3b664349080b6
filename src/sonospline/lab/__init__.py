"""A skills lab: participants, their attempts in a database, learning curves, tables to export."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
