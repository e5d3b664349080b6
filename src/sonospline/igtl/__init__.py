"""OpenIGTLink, the protocol of trackers, scanners and 3D Slicer: messages as small values, and their bytes.

:func:`encode` and :func:`decode` know bytes alone, no sockets.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
