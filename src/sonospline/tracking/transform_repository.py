"""Poses of coordinate systems in one another, by names as PLUS and 3D Slicer have them: ``NeedleToReference``."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._shown import shown

Array = NDArray[np.float64]
_NAME = re.compile(r"([A-Z]\w*?)To([A-Z]\w*)", re.ASCII)


def frames_of(name: str) -> tuple[str, str]:
    """Return the coordinate systems of a transform's name, from which and to which; ValueError where it has none.

    Examples
    --------
    >>> from sonospline.tracking import frames_of
    >>> frames_of("StylusTipToStylus")
    ('StylusTip', 'Stylus')
    """
    found = _NAME.fullmatch(name)
    if found is None:
        raise ValueError(f"transform = {shown(name)} names no coordinate systems; give it as in NeedleToReference")
    return found[1], found[2]


class TransformRepository:
    """Transforms by name; what was not given is composed of what was.

    Between two coordinate systems there is one way only: who would give another is refused.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.tracking import TransformRepository
    >>> known = TransformRepository()
    >>> known.set("NeedleToTracker", np.diag([1.0, -1, -1, 1]))
    >>> known.set("ReferenceToTracker", np.eye(4))
    >>> known.get("NeedleToReference").diagonal().tolist()
    [1.0, -1.0, -1.0, 1.0]
    """

    def __init__(self) -> None:
        self._to: dict[str, dict[str, Array]] = {}

    def copy(self) -> Self:
        """Return one that knows the same."""
        made = type(self)()
        made._to = {frame: dict(others) for frame, others in self._to.items()}
        return made

    def set(self, name: str, matrix: ArrayLike) -> None:
        """Give a transform, or give it anew.

        Raises
        ------
        ValueError
            A name without coordinate systems, a matrix that has no inverse, or a second way between the two.
        """
        source, target = frames_of(name)
        transform = np.array(matrix, float)
        if transform.shape != (4, 4) or not np.isfinite(transform).all() or abs(np.linalg.det(transform)) < 1e-12:
            raise ValueError(f"{name} = {shown(transform.tolist())} cannot be inverted; give a 4 x 4 matrix that can")
        way = self.way(source, target)
        if source == target or (way is not None and len(way) > 2):
            known = " - ".join(way or [source])
            raise ValueError(f"{name} is known already by way of {known}; leave one of these out")
        self._to.setdefault(source, {})[target] = transform
        self._to.setdefault(target, {})[source] = np.linalg.inv(transform)

    def forget(self, name: str) -> None:
        """Forget a transform that was given; nothing where it was not."""
        source, target = frames_of(name)
        for one, other in ((source, target), (target, source)):
            others = self._to.get(one, {})
            others.pop(other, None)
            if not others:
                self._to.pop(one, None)

    def get(self, name: str) -> Array:
        """Return a transform, (4, 4); ValueError where no way leads from the one system to the other."""
        source, target = frames_of(name)
        way = self.way(source, target)
        if way is None:
            raise ValueError(f"{name} is not known, nor are transforms that it could be made of; give one")
        transform = np.eye(4)
        for before, after in pairwise(way):
            transform = self._to[before][after] @ transform
        return transform

    @property
    def frames(self) -> frozenset[str]:
        """Every coordinate system that it knows of."""
        return frozenset(self._to)

    def way(self, source: str, target: str) -> list[str] | None:
        """Return the coordinate systems from one to another, both with them; None where there is no way."""
        ways, at = [[source]], 0
        seen = {source}
        while at < len(ways):
            way = ways[at]
            if way[-1] == target:
                return way
            for frame in self._to.get(way[-1], ()):
                if frame not in seen:
                    seen.add(frame)
                    ways.append([*way, frame])
            at += 1
        return None

    def __contains__(self, name: str) -> bool:
        return self.way(*frames_of(name)) is not None

    def __repr__(self) -> str:
        names = [f"{source}To{target}" for source, others in self._to.items() for target in others if source < target]
        return f"TransformRepository({shown(', '.join(names))})"
