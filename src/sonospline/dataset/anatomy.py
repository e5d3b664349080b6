"""One anatomy of a data set, as its number draws it: shape, materials, acoustics, and the probe that looks at it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np
from msgspec.structs import replace as changed
from numpy.random import Generator
from numpy.typing import NDArray

from ..geometry.label_map import LabelMap
from ..geometry.tissue import Tissue
from ..mechanics.tissue_map import TissueMap
from ..simulator.scene_file import ProbePart
from ..simulator.scene_view import probe_of
from ..ultrasound.acoustics import NO_ECHO
from ..ultrasound.phantom import Phantom
from ..ultrasound.probe import Probe
from .draws import Array, Stream, between, factor_between, stream
from .source import Form, Origin, Painted, Source, source
from .specification import Specification

_LOUDEST_DB = 40.0
_LARGEST_SEED = 2**32


@dataclass(frozen=True)
class _Factors:
    """How far a tissue is from the table's."""

    stiffness: float
    backscatter_db: float
    attenuation: float


@dataclass(frozen=True, eq=False)
class Anatomy:
    """An anatomy; what takes long to make is made when asked for."""

    asked: Specification
    source: Source
    form: Form
    factors: Mapping[str, _Factors]
    probe: Probe
    seed: int
    """Of its speckle."""

    @classmethod
    def of(cls, asked: Specification, origins: Sequence[Origin], number: int) -> Anatomy:
        """Return an anatomy: a function of the specification and the number alone."""
        random = stream(asked.seed, Stream.ANATOMY, number)
        found = source(asked, _drawn_origin(random, origins))
        form = found.drawn(random, asked)
        factors = {name: _drawn_factors(random, asked) for name in sorted(_names(found))}
        probe = _drawn_probe(random, asked, found.scene.probe, artefacts=found.scene.display.artefacts)
        return cls(asked, found, form, factors, probe, int(random.integers(_LARGEST_SEED)))

    @cached_property
    def tissue(self) -> Tissue:
        """Its box."""
        return Tissue(self.source.grid, entry_face=self.source.scene.tissue.entry_face)

    @cached_property
    def painted(self) -> Painted:
        """Its labels."""
        return self.form.paint()

    @cached_property
    def phantom(self) -> Phantom:
        """What ultrasound meets."""
        tissues = {}
        for label, tissue in self.source.tissues.items():
            factors = self.factors[self.source.names[label]]
            level = tissue.backscatter_db
            if level > NO_ECHO:
                level = float(np.clip(level + factors.backscatter_db, NO_ECHO, _LOUDEST_DB))
            loss = tissue.attenuation_db_cm_mhz * factors.attenuation
            tissues[label] = replace(tissue, backscatter_db=level, attenuation_db_cm_mhz=loss)
        return Phantom(self.painted.acoustic, tissues)

    @cached_property
    def tissues(self) -> TissueMap | None:
        """What mechanics meets; None where tissue is all one."""
        labels, materials = self.painted.mechanical, self.source.materials
        if labels is None:
            return None
        names = self._mechanical_names
        changed = {
            label: material
            if material.rigid
            else replace(material, stiffness_kpa=material.stiffness_kpa * self.factors[names[label]].stiffness)
            for label, material in materials.items()
        }
        return TissueMap(LabelMap.of(labels).named(names), changed, self.source.membranes)

    @property
    def _mechanical_names(self) -> dict[int, str]:
        return mechanical_names(self.source)

    def targets(self) -> dict[str, Array]:
        """Return the places that needles may be aimed at, by name.

        Raises
        ------
        ValueError
            The specification names targets or tissues that are not there.
        """
        wanted = self.asked.target.names
        found = {
            name: at
            for name, at in self.form.targets.items()
            if not wanted or any(fnmatchcase(name, pattern) for pattern in wanted)
        }
        if not found:
            known = ", ".join(self.form.targets)
            raise ValueError(f"target.names = {list(wanted)} are none of the scene's; it has {known}")
        return found

    def place_in_tissue(self, random: Generator) -> tuple[str, Array]:
        """Return the name and the place of a voxel of the tissues that are aimed at, inside the box.

        Raises
        ------
        ValueError
            There is none.
        """
        if not len(self._aimed_at):
            known = ", ".join(sorted(set(self.source.names.values())))
            raise ValueError(
                f"target.tissues = {list(self.asked.target.tissues)} are nowhere in the tissue, which has {known}"
            )
        index = self._aimed_at[int(random.integers(len(self._aimed_at)))]
        label = int(self.painted.acoustic.voxels[tuple(index)])
        return self.source.names[label], self.painted.acoustic.position(index.astype(float)[None])[0]

    @cached_property
    def _aimed_at(self) -> NDArray[np.intp]:
        """(m, 3) voxels of the tissues that are aimed at."""
        patterns = self.asked.target.tissues
        labels = [n for n, name in self.source.names.items() if any(fnmatchcase(name, pattern) for pattern in patterns)]
        index = np.argwhere(np.isin(self.painted.acoustic.voxels, labels))
        if not len(index):
            return index
        return index[self.source.grid.contains(self.painted.acoustic.position(index.astype(float)))]


def origin_of(asked: Specification, origins: Sequence[Origin], number: int) -> Origin:
    """Return what an anatomy is drawn from, by its number."""
    return _drawn_origin(stream(asked.seed, Stream.ANATOMY, number), origins)


def _drawn_origin(random: Generator, origins: Sequence[Origin]) -> Origin:
    ends = np.cumsum([origin.weight for origin in origins])
    chosen = int(np.searchsorted(ends, random.random() * ends[-1], side="right"))
    return origins[min(chosen, len(origins) - 1)]


def mechanical_names(source: Source) -> dict[int, str]:
    """Return the names of a source's labels for mechanics."""
    labels = getattr(source, "mechanical", None)
    own: dict[int, str] = {} if labels is None else dict(getattr(labels, "names", {}))
    return {label: own.get(label) or source.names.get(label) or str(label) for label in source.materials}


def tissue_names(source: Source) -> set[str]:
    """Return the names of everything that a source's image may show."""
    return set(source.names.values())


def _names(source: Source) -> set[str]:
    return tissue_names(source) | set(mechanical_names(source).values()) | {"tissue"}


def _drawn_factors(random: Generator, asked: Specification) -> _Factors:
    part = asked.anatomy
    return _Factors(
        factor_between(random, part.stiffness),
        between(random, part.backscatter_db),
        factor_between(random, part.attenuation),
    )


def _drawn_probe(random: Generator, asked: Specification, scene: ProbePart, *, artefacts: bool) -> Probe:
    """The scene's probe, with the frequency and depth drawn."""
    view = asked.view
    frequency = between(random, view.frequency_mhz or (scene.frequency_mhz, scene.frequency_mhz))
    depth = between(random, view.depth_mm or (scene.depth_mm, scene.depth_mm))
    part = changed(scene, frequency_mhz=frequency, depth_mm=depth, lines=view.lines)
    return probe_of(part, artefacts=artefacts)
