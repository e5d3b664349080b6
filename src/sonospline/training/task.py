"""What an attempt was for, as far as metrics depend on it."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class Task:
    """What a needle is to reach, and what it must not.

    Parameters
    ----------
    forbidden : tuple of str
        Names of structures that are not to be hit; ``*`` and ``?`` as in file names.
    target_in : tuple of str
        Names of the structure that the target is in; leaving it ahead is a perforation of its back wall.
    axis : (float, float, float), optional
        Direction in which the needle should come, into the target: of a papilla, from cortex to calyx.

    Examples
    --------
    >>> Task(forbidden=("colon*",)).forbids("colon_descending")
    True
    """

    forbidden: tuple[str, ...] = ()
    target_in: tuple[str, ...] = ()
    axis: tuple[float, float, float] | None = None

    def forbids(self, structure: str) -> bool:
        """Return whether a structure must not be hit."""
        return any(fnmatchcase(structure, pattern) for pattern in self.forbidden)

    def aims_into(self, structure: str) -> bool:
        """Return whether a structure is the one with the target."""
        return any(fnmatchcase(structure, pattern) for pattern in self.target_in)
