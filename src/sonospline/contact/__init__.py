"""What happens between a needle and the tissue it is in, in time: friction that remembers, cutting, membranes.

A needle leaves a track: points fixed in the tissue, which stick to it or slip. The tissue answers by its compliance.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
