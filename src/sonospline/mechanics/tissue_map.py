"""Labelled tissue: which material is where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.grid import FACES, Grid, face_slice
from ..geometry.label_map import HALF, LabelMap
from ..geometry.volume import Volume
from ..io.labels import labels_named, names_of, read_labels
from .material import Material
from .material_table import BACKGROUND, Materials, MaterialTable, read_label_names
from .moduli import Moduli, check_ratio

Array = NDArray[np.float64]

_MOST_SAMPLES = 3
"""Samples of the label map along each axis of a cell, at most."""
_NO_BACKGROUND = "labels end inside the tissue's box, and label 0, the background beyond, has no material; add one"


@dataclass(frozen=True, eq=False)
class TissueMap:
    """A label image and the material of each label.

    Parameters
    ----------
    labels : Volume
        Whole numbers; where the image ends, label 0 goes on: the background.
    materials : mapping of int to Material
        One for each label that occurs, and for label 0 where the tissue's box is larger than the image.

    Raises
    ------
    ValueError
        Labels that are not whole numbers, or one without a material.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline.mechanics import TissueMap
    >>> from sonospline.mechanics import labelled_cube
    >>> tissues = labelled_cube("layers")
    >>> sorted(tissues.materials), tissues.moduli(ss.Grid.unit_cube(13)).shear.shape
    ([0, 1, 2], (12, 12, 12))
    """

    labels: Volume
    materials: Mapping[int, Material]

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", LabelMap.of(self.labels))
        missing = sorted(set(self._present) - set(self.materials))
        if missing:
            raise ValueError(f"labels {missing} have no material; add them to those of {sorted(self.materials)}")
        for material in self.materials.values():
            check_ratio(material.poissons_ratio)

    @classmethod
    def read(
        cls,
        labels: str | PathLike[str],
        *,
        names: str | PathLike[str] | None = None,
        materials: str | PathLike[str] | None = None,
    ) -> TissueMap:
        """Read a label image, the names of its labels and a table of materials.

        Parameters
        ----------
        labels : path
            Any image SimpleITK reads.
        names : path, optional
            CSV with the columns ``label`` and ``name``; by default the file beside the image
            with its name and ``.csv`` for its suffix. Label 0 is soft tissue where it has no name.
        materials : path, optional
            TOML, see :meth:`MaterialTable.read`; by default the assumed ones.

        Raises
        ------
        ValueError
            A file that cannot be read, or a label without a name or a material.
        """
        found = read_labels(labels)
        by_name = MaterialTable.assumed() if materials is None else MaterialTable.read(materials)
        by_label = read_label_names(names_of(labels, names))
        with labels_named(labels):
            return cls.named(found, by_label, by_name)

    @classmethod
    def of(cls, labels: LabelMap, materials: Materials | None = None) -> TissueMap:
        """Return a label map's tissues, by the names it carries; label 0 is soft tissue where it has none.

        Parameters
        ----------
        labels : LabelMap
            With names.
        materials : path-like, MaterialTable or mapping of str to Material, optional
            By name, over the assumed ones.

        Raises
        ------
        ValueError
            Labels without names, or a name without a material.
        """
        if not labels.names:
            raise ValueError(f"labels = {labels!r} has no names; read it with them: read_labels(path, names=...)")
        return cls.named(labels, {0: BACKGROUND, **labels.names}, MaterialTable.of(materials))

    @classmethod
    def named(cls, labels: Volume, names: Mapping[int, str], table: MaterialTable) -> TissueMap:
        """Return a map whose labels have names, and whose names have materials."""
        found = LabelMap.of(labels)
        present = [int(label) for label in np.unique(found.voxels)]
        nameless = [label for label in present if label not in names]
        if nameless:
            raise ValueError(f"labels {nameless} have no name; known are {', '.join(map(str, sorted(names)))}")
        background = [0] if 0 in names else []
        return cls(found, {label: table[names[label]] for label in {*background, *present}})

    def moduli(self, grid: Grid) -> Moduli:
        """Return the moduli of a grid's cells: geometric means of what a cell holds, bone by majority.

        Raises
        ------
        ValueError
            The label image and the grid do not overlap, the grid is larger and label 0 has no material, or
            a fluid reaches every face of the box.
        """
        cells = _Samples(self.labels, self._places, grid, self._background)
        table = [self.materials[label] for label in self._known]
        rigid = np.array([material.rigid for material in table])
        _refuse_leaking(cells.mean(np.array([material.fluid for material in table], float)))
        bone = cells.mean(rigid.astype(float))
        moduli = []
        for logs in np.log([material.lame_moduli for material in table] + np.array([1e-30, 0.0])).T:
            soft = cells.mean(logs * ~rigid) / np.maximum(1 - bone, 1e-9)
            stiff = cells.mean(logs * rigid) / np.maximum(bone, 1e-9)
            moduli.append(np.exp(np.where(bone >= 0.5, stiff, soft)))
        return Moduli(grid, moduli[0], moduli[1])

    def resistance(self, points: Array) -> tuple[Array, Array]:
        """Return friction in N/mm and cutting force in N at each of the world points (m, 3)."""
        labels = self.labels_at(points)
        place = np.minimum(np.searchsorted(self._known, labels), len(self._known) - 1)
        if (np.array(self._known)[place] != labels).any():
            raise ValueError(_NO_BACKGROUND)
        return self._friction[place], self._cutting_force[place]

    def labels_at(self, points: Array) -> NDArray[np.integer]:
        """Return the label (m,) at each of the world points (m, 3): the nearest voxel's, 0 beyond the image."""
        return self.labels.sample(points)

    def stiffness_image(self) -> Volume:
        """Return an image to look at: the place of each voxel's stiffness among those that occur, 0 the softest.

        Stiffness itself, even its logarithm, would leave all but bone black.
        """
        stiffness = {label: self.materials[label].stiffness_kpa for label in self._known}
        occurring = np.unique([stiffness[label] for label in self._present])
        order = np.searchsorted(occurring, list(stiffness.values())).astype(np.float32)
        return self._with(order[self._places])

    @cached_property
    def _present(self) -> list[int]:
        return [int(label) for label in np.unique(self.labels.voxels)]

    @cached_property
    def _known(self) -> list[int]:
        """Labels that occur, and label 0 where it has a material."""
        background = [0] if 0 in self.materials else []
        return sorted({*self._present, *background})

    @property
    def _background(self) -> int | None:
        """Place of label 0 among those known; None where it has no material."""
        return 0 if self._known[0] == 0 else None

    @cached_property
    def _places(self) -> NDArray[np.integer]:
        """Number of each voxel's label among those known, in as few bytes as hold it."""
        places = np.searchsorted(self._known, self.labels.voxels)
        return places.astype(np.min_scalar_type(len(self._known)))

    @cached_property
    def _friction(self) -> Array:
        return np.array([self.materials[label].friction_n_per_mm for label in self._known])

    @cached_property
    def _cutting_force(self) -> Array:
        return np.array([self.materials[label].cutting_force_n for label in self._known])

    def _with(self, voxels: NDArray[Any]) -> Volume:
        at = self.labels
        return Volume(voxels=voxels, spacing=at.spacing, origin=at.origin, direction=at.direction)

    def __repr__(self) -> str:
        return f"TissueMap({self.labels!r}, {len(self.materials)} materials)"


def _refuse_leaking(fluid: Array) -> None:
    touched = [face for face in FACES if (fluid[face_slice(face)] >= 0.5).any()]
    if len(touched) == len(FACES):
        raise ValueError(
            "labels: the fluid reaches every face of the box, so nothing holds it; crop the box or "
            "make its material solid"
        )


def _within(index: Array, last: Any) -> NDArray[np.bool_]:
    """Whether continuous indices lie in a voxel, the first 0, the last ``last``."""
    return (index >= -HALF) & (index <= last + HALF)


class _Samples:
    """The labels of an image at regular places in the cells of a grid, and means over the cells."""

    def __init__(self, labels: Volume, places: NDArray[np.integer], grid: Grid, background: int | None) -> None:
        per_voxel = np.array(grid.spacing) / labels.spacing
        counts = np.clip(np.ceil(per_voxel - 1e-6), 1, _MOST_SAMPLES).astype(int)
        cells = np.array(grid.shape) - 1
        axes = [
            (np.arange(cells * count) + 0.5) * (h / count)
            for cells, count, h in zip(cells, counts, grid.spacing, strict=True)
        ]
        turn = labels.lattice.direction.T @ grid.direction
        start = labels.index(grid.origin[None])[0]
        last = np.array(labels.voxels.shape) - 1
        if np.allclose(turn, np.eye(3), atol=1e-9):
            index = [start[a] + axes[a] / labels.spacing[a] for a in range(3)]
            nearest = [np.clip(np.rint(i), 0, n).astype(int) for i, n in zip(index, last, strict=True)]
            found = places[np.ix_(*nearest)]
            x, y, z = (_within(i, n) for i, n in zip(index, last, strict=True))
            inside = np.asarray(x[:, None, None] & y[:, None] & z)
        else:
            local = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
            index_at = start + local @ turn.T / labels.spacing
            inside = np.asarray(_within(index_at, last).all(axis=-1))
            near = np.clip(np.rint(index_at), 0, last).astype(int)
            found = places[tuple(np.moveaxis(near, -1, 0))]
        if not inside.any():
            raise ValueError("labels do not overlap the tissue's box; give labels of the same patient and place")
        if not inside.all():
            if background is None:
                raise ValueError(_NO_BACKGROUND)
            found[~inside] = background
        samples = [
            found[first[0] :: counts[0], first[1] :: counts[1], first[2] :: counts[2]] for first in np.ndindex(*counts)
        ]
        self._pure = samples[0]
        self._mixed = np.any([sample != samples[0] for sample in samples], axis=0)
        self._held = np.stack([sample[self._mixed] for sample in samples])

    def mean(self, values: Array) -> Array:
        """Return the mean over each cell of a value for each label: few cells hold more than one."""
        means = values[self._pure]
        means[self._mixed] = values[self._held].mean(axis=0)
        return means
