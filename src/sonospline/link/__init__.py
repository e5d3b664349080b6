"""What joins the simulator and the world's instruments: the force in the hand, and the devices that give it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
