"""What tissue is made of and what a needle does to it: materials, moduli, loads. No solver."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
