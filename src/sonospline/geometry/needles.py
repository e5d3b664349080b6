"""Several needles, each with a name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from .._shown import shown
from .needle import Needle

Needles = Mapping[str, Needle] | Iterable[tuple[str, Needle]]
Named = tuple[tuple[str, Needle], ...]

NO_NEEDLES: Mapping[str, Needle] = MappingProxyType({})


def named(needles: Needles) -> Named:
    """Return needles by name, in the order of their names: sums over them have the same bits in any order.

    Raises
    ------
    ValueError
        Needles without names, two of one name, or something that is no needle.
    """
    if isinstance(needles, Needle):
        raise ValueError('needles = a Needle has no name; give {"needle": needle}')
    try:
        pairs = [(name, needle) for name, needle in (needles.items() if isinstance(needles, Mapping) else needles)]
    except (TypeError, ValueError):
        raise ValueError(f'needles = {shown(needles)} has no names; give {{"needle": Needle(entry, tip)}}') from None
    seen: dict[str, Needle] = {}
    for name, needle in pairs:
        if not isinstance(name, str) or not isinstance(needle, Needle):
            raise ValueError(f'needles has {shown(name)}: {shown(needle)}; give {{"needle": Needle(entry, tip)}}')
        if name in seen:
            raise ValueError(f"needles has two named {name!r}; give each a name of its own")
        seen[name] = needle
    return tuple(sorted(seen.items(), key=lambda pair: pair[0]))
