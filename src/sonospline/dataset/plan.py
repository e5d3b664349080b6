"""The samples of a specification by their numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from .anatomy import Anatomy, origin_of, tissue_names
from .draws import even
from .recipe import Recipe, UnplaceableError, drawn_recipe
from .source import Origin, origins, source
from .specification import Specification

SPLITS = ("train", "validation", "test")
MOST_LABELS = 255

_KEPT = 2
_TRIED = 64
"""Samples drawn before any is made."""
_MOST_FAILED = 0.25


class Plan:
    """Recipes of a specification; anatomies that were drawn are kept.

    Parameters
    ----------
    asked : Specification
        What is asked for.
    given : sequence of Origin, optional
        Its sources, where they are known already.

    Examples
    --------
    >>> from sonospline.dataset import Plan, Specification
    >>> plan = Plan(Specification.parse('samples = 512\\n[[sources]]\\nkind = "block"'))
    >>> plan.recipe(300).anatomy, plan.split(300), plan.labels()["tumour"]
    (1, 'train', 8)
    """

    def __init__(self, asked: Specification, given: Sequence[Origin] | None = None) -> None:
        self.asked = asked
        self.origins = origins(asked) if given is None else tuple(given)
        files = dict.fromkeys(origin.file for origin in self.origins if origin.file is not None)
        self._files = {file: number for number, file in enumerate(files)}
        self.anatomy = lru_cache(maxsize=_KEPT)(self._anatomy)
        """An anatomy by its number; the last ones are kept."""

    def _anatomy(self, number: int) -> Anatomy:
        return Anatomy.of(self.asked, self.origins, number)

    def origin(self, anatomy: int) -> Origin:
        """Return what an anatomy is drawn from, by its number."""
        return origin_of(self.asked, self.origins, anatomy)

    def recipe(self, index: int) -> Recipe:
        """Return the recipe of a sample.

        Raises
        ------
        UnplaceableError
            No draw of its view or needle fits the tissue.
        """
        return drawn_recipe(self.asked, self.anatomy(index // self.asked.anatomy.samples), index)

    def __getstate__(self) -> dict[str, Any]:
        return {"asked": self.asked, "given": self.origins}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def split(self, index: int) -> str:
        """Return which split a sample is in: that of its anatomy, and of the label map that this is warped from."""
        anatomy = index // self.asked.anatomy.samples
        file = self.origin(anatomy).file if self._files else None
        place, end = even(self.asked.seed, anatomy if file is None else self._files[file]), 0.0
        for name in SPLITS[:-1]:
            end += getattr(self.asked.split, name)
            if place < end:
                return name
        return SPLITS[-1]

    def labels(self) -> dict[str, int]:
        """Return the number of each tissue in the label images, 1 and on by name; 0 is nothing, outside the fan.

        Raises
        ------
        ValueError
            More than 255 tissues, or a source that cannot be read.
        """
        return self.labels_and_hashes()[0]

    def labels_and_hashes(self) -> tuple[dict[str, int], dict[Origin, str]]:
        """Return :meth:`labels` and the hash of every source, each read once.

        Raises
        ------
        ValueError
            As :meth:`labels`.
        """
        hashes, found = dict[Origin, str](), set[str]()
        for origin in self.origins:
            read = source(self.asked, origin)
            hashes[origin] = read.hash
            found |= tissue_names(read)
        if len(found) > MOST_LABELS:
            raise ValueError(f"sources have {len(found)} tissues, and label images hold {MOST_LABELS}; give fewer")
        return {name: number for number, name in enumerate(sorted(found), 1)}, hashes

    def check(self) -> None:
        """Draw some samples, spread over all; ValueError where the ranges leave the tissue for many of them."""
        count = min(_TRIED, self.asked.samples)
        problems: Counter[str] = Counter()
        for number in range(count):
            try:
                self.recipe(number * self.asked.samples // count)
            except UnplaceableError as error:
                problems[str(error)] += 1
        failed = problems.total()
        if failed > _MOST_FAILED * count:
            raise ValueError(
                f"{failed} of {count} samples tried reach outside the tissue: {problems.most_common(1)[0][0]}"
            )
