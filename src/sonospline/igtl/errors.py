"""What is wrong with a message on the wire, one class for each way; each a ValueError with one clear line."""


class WireError(ValueError):
    """A message of OpenIGTLink that cannot be read. The one after it can, but for :class:`TooLargeError`."""


class UnknownVersionError(WireError):
    """A version of the header that is not known here."""


class UnknownTypeError(WireError):
    """A type of message that is not known here."""


class TooLargeError(WireError):
    """A message announces more than is taken: what follows on its connection can no longer be told apart."""


class ChecksumError(WireError):
    """The check in the header is not that of the body."""


class SizeError(WireError):
    """A body is shorter or longer than its type and its own counts say."""


class ContentError(WireError):
    """A body has values that its type does not allow, such as coordinates that are not finite."""
