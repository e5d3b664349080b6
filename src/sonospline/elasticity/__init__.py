"""Live finite elements: elastic tissue on a grid of its own, one multigrid iteration a step.

The models that needles drive are in :mod:`sonospline.models.elastic`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
