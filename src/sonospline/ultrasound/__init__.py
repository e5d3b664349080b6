"""The image a probe would show: slices of a field, real images that deform, synthetic B-mode."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
