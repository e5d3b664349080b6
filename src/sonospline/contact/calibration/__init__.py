"""What tissues resist a needle with, fitted to its force against its depth."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
