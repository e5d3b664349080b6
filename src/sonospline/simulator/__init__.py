"""The live simulator: a needle and a probe in tissue that answers, without a browser."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
