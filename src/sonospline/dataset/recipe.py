"""The recipe of a sample: all that is drawn of it, in less than a kilobyte, from which it is made again."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from importlib.metadata import version
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.random import Generator

from ..geometry.needle import Needle
from ..simulator.command import ProbeCommand
from ..simulator.skin_frame import room_along
from .anatomy import Anatomy
from .draws import Array, Stream, between, stream, towards_anywhere
from .specification import Specification

TRIES = 60
"""Draws of a view or a needle before it is given up."""
_SHORTEST_MM = 5.0
_INSIDE_MM = 0.5

Triple = tuple[float, float, float]


class UnplaceableError(ValueError):
    """No view or no needle of the ranges fits the tissue."""


class Recipe(msgspec.Struct, frozen=True, kw_only=True):
    """What a sample is made of; mm, degrees and dB.

    Examples
    --------
    >>> from sonospline.dataset import Plan, Recipe, Specification
    >>> asked = Specification.parse('samples = 10\\n[[sources]]\\nkind = "block"')
    >>> recipe = Plan(asked).recipe(7)
    >>> recipe.index, len(recipe.as_json()) < 1000, Recipe.parse(recipe.as_json()) == recipe
    (7, True, True)
    """

    index: int
    seed: int
    version: str
    scene: str
    """Hash of what its anatomy was drawn from."""
    anatomy: int
    view: int
    target: str
    target_mm: Triple
    probe: tuple[float, float, float, float]
    """Slide, sweep, rotation and fan, seen from the skin."""
    entry_mm: Triple
    tip_mm: Triple
    speed_mm_s: float
    gain_db: float
    noise_db: float

    @property
    def needle(self) -> Needle:
        """The needle as it is asked for; bone may stop it before."""
        return Needle(self.entry_mm, self.tip_mm)

    @property
    def probe_command(self) -> ProbeCommand:
        """The probe's pose, seen from the skin."""
        slide, sweep, rotate, fan = self.probe
        return ProbeCommand(slide=slide, sweep=sweep, rotate=rotate, fan=fan)

    def as_json(self) -> str:
        """Return it as a line of JSON; every number reads back as it was."""
        return msgspec.json.encode(self).decode()

    @classmethod
    def parse(cls, text: str | bytes) -> Recipe:
        """Return the recipe that a line of JSON is.

        Raises
        ------
        ValueError
            It is none.
        """
        try:
            return msgspec.json.decode(text, type=cls)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"recipe cannot be read ({error}); give one that a data set holds") from None


class View(NamedTuple):
    """Where the probe is, and what it is aimed at."""

    target: str
    at: Array
    probe: tuple[float, float, float, float]
    pose: Array
    """(4, 4) ProbeToReference."""


def drawn_recipe(asked: Specification, anatomy: Anatomy, index: int) -> Recipe:
    """Return the recipe of a sample: a function of the specification and the index alone.

    Raises
    ------
    UnplaceableError
        No draw fits the tissue.
    """
    number = index // asked.view.samples
    view = drawn_view(asked, anatomy, number)
    random = stream(asked.seed, Stream.SAMPLE, index)
    needle = next(_needles(random, asked, anatomy, view))
    return Recipe(
        index=index, seed=asked.seed, version=_version(), scene=anatomy.source.hash,
        anatomy=index // asked.anatomy.samples, view=number, target=view.target, target_mm=_triple(view.at),
        probe=view.probe, entry_mm=_triple(needle.entry), tip_mm=_triple(needle.tip),
        speed_mm_s=between(random, asked.needle.speed_mm_s), gain_db=between(random, asked.view.gain_db),
        noise_db=between(random, asked.view.noise_db),
    )  # fmt: skip


def drawn_view(asked: Specification, anatomy: Anatomy, number: int) -> View:
    """Return where the probe is in a run of samples."""
    random = stream(asked.seed, Stream.VIEW, number)
    frame, part = anatomy.source.frame, asked.view
    sides = frame.sides(anatomy.source.grid)
    for _ in range(TRIES):
        name, at = _target(random, asked, anatomy)
        right, deep, away = frame.parts(at - frame.origin)
        rotate, fan = between(random, part.rotate_deg), between(random, part.fan_deg)
        slide = between(random, part.slide_mm)
        sweep = between(random, part.sweep_mm) - deep * float(np.tan(np.radians(fan)))
        cos, sin = float(np.cos(np.radians(rotate))), float(np.sin(np.radians(rotate)))
        place = (right + slide * cos + sweep * sin, away - slide * sin + sweep * cos)
        if deep > 0 and all(low <= p <= high for p, (low, high) in zip(place, sides, strict=True)):
            probe = (*place, rotate, fan)
            command = ProbeCommand(slide=place[0], sweep=place[1], rotate=rotate, fan=fan)
            return View(name, at, probe, frame.probe_to_reference(command, anatomy.source.press_mm))
    raise UnplaceableError(
        f"no probe fits the skin of {anatomy.source.scene.name!r} in {TRIES} draws; give narrower view.slide_mm, "
        "sweep_mm or fan_deg"
    )


def _target(random: Generator, asked: Specification, anatomy: Anatomy) -> tuple[str, Array]:
    if asked.target.tissues:
        return anatomy.place_in_tissue(random)
    targets = sorted(anatomy.targets().items())
    return targets[int(random.integers(len(targets)))]


def _needles(random: Generator, asked: Specification, anatomy: Anatomy, view: View) -> Iterator[Needle]:
    """Needles of the ranges that fit the tissue; at most so many are tried for each."""
    part, grid, frame = asked.needle, anatomy.source.grid, anatomy.source.frame
    x, y, z = view.pose[:3, :3].T
    for _ in range(TRIES):
        aim = view.at + between(random, asked.target.off_mm) * towards_anywhere(random)
        angle, swing = np.radians(between(random, part.angle_deg)), np.radians(between(random, part.swing_deg))
        left, reach = random.random() < 0.5, between(random, part.reach)
        side = {"left": 1.0, "right": -1.0, "both": 1.0 if left else -1.0}[part.sides]
        along = np.cos(swing) * (side * np.cos(angle) * x + np.sin(angle) * y) + np.sin(swing) * z
        down = float(along @ frame.depth)
        depth = float((aim - frame.origin) @ frame.depth)
        if down <= 0 or depth <= 0:
            continue
        whole = depth / down
        entry = aim - whole * along
        fits = bool(grid.contains(np.stack([entry, aim]), tolerance=1e-6).all())
        length = reach * whole
        if not fits or not _SHORTEST_MM <= length <= anatomy.source.scene.needle.length_mm:
            continue
        if length > room_along(grid, entry + 1e-6 * along, along) - _INSIDE_MM:
            continue
        yield Needle(entry, entry + length * along)
    raise UnplaceableError(
        f"no needle fits {anatomy.source.scene.name!r} in {TRIES} draws ({view.target} is "
        f"{float((view.at - frame.origin) @ frame.depth):.0f} mm deep); give steeper needle.angle_deg"
    )


@lru_cache(maxsize=1)
def _version() -> str:
    return version("sonospline")


def _triple(point: Array) -> Triple:
    x, y, z = (float(value) for value in point)
    return x, y, z
