"""What a trainee did, in numbers: a trace of needle, probe and target over time, and metrics of it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
