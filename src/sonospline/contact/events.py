"""What is worth a word when a needle goes through tissue."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Punctured:
    """The tip of a needle has gone through a membrane.

    Parameters
    ----------
    needle, membrane : str
        Their names.
    force_n : float
        Force at the tip that it took, N.

    Examples
    --------
    >>> from sonospline.contact import Punctured
    >>> str(Punctured("needle", "renal capsule", 1.2))
    'punctured "renal capsule" at 1.2 N'
    """

    needle: str
    membrane: str
    force_n: float

    def __str__(self) -> str:
        return f'punctured "{self.membrane}" at {self.force_n:.2g} N'


@dataclass(frozen=True)
class Left:
    """The tip of a needle is out of what a membrane is around, pulled back or on its far side.

    Examples
    --------
    >>> from sonospline.contact import Left
    >>> str(Left("needle", "renal capsule"))
    'left "renal capsule"'
    """

    needle: str
    membrane: str

    def __str__(self) -> str:
        return f'left "{self.membrane}"'


@dataclass(frozen=True)
class Held:
    """A needle turns no further, for the tissue beside its shaft would tear.

    Parameters
    ----------
    needle, by : str
        Its name, and the tissue's; empty where there is one alone.
    share : float
        How much of the way it turns, 0 to 1.

    Examples
    --------
    >>> from sonospline.contact import Held
    >>> str(Held("needle", "muscle", 0.25))
    'held by "muscle"'
    """

    needle: str
    by: str
    share: float

    def __str__(self) -> str:
        return f'held by "{self.by or "tissue"}"'


@dataclass(frozen=True)
class Touched:
    """The tip of a needle has come upon bone.

    Examples
    --------
    >>> from sonospline.contact import Touched
    >>> str(Touched("needle", "rib 11"))
    'touched "rib 11"'
    """

    needle: str
    bone: str

    def __str__(self) -> str:
        return f'touched "{self.bone}"'
