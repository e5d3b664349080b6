"""Elastic tissue in real time: stiffness by place, loads in physical units, error estimates.

Linear finite elements on a grid of their own, warm-started multigrid iterations.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
