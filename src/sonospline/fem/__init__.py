"""Finite element reference solutions: what the models are measured against.

Linear elasticity on the tissue's own nodes, with two load cases and two engines. Needs the
extra ``fem``; the engine ``"fenicsx"`` needs DOLFINx, in this or in another Python.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
