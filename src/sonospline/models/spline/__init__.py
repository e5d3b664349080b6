"""The paper: a polyharmonic spline through anchors and landmarks, equations (1) to (21) and Algorithm 1."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
