"""Where things are: grids, needles, poses, planes, volumes and the box of tissue; world RAS, mm."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
