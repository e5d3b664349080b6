"""Headers of image files, checked before a library that trusts them sees the file.

ITK ends in a crash or an endless loop on wild headers and fills what a short file lacks in silence. So a header is read
here first, by a grammar narrower than ITK's: what is not understood is refused, and ITK gets what is left.
"""

from .errors import WHOLE, HeaderError
from .header import Header
from .reading import SUFFIXES, read_header

__all__ = ["SUFFIXES", "WHOLE", "Header", "HeaderError", "read_header"]
