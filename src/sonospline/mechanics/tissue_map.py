"""Labelled tissue: which material is where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._shown import shown
from ..fields.field import Field
from ..geometry.grid import FACES, Grid, face_slice
from ..geometry.label_map import LabelMap
from ..geometry.needle import Needle
from ..geometry.volume import Volume
from ..geometry.voxels_along import voxels_along
from ..io.labels import labels_named, names_for, read_labels
from .cell_samples import NO_BACKGROUND, CellSamples
from .fragments import fragments_of
from .held_bone import HeldBone
from .layers import layers_of
from .material import Material
from .material_table import BACKGROUND, Materials, MaterialTable
from .membranes import Membrane
from .mixture import mixing_shares
from .moduli import Moduli, check_ratio
from .obstacle import Obstacle

Array = NDArray[np.float64]

_PER_VOXEL, _PER_STEP = 4, 65
"""Places along a needle at which a fragment that has moved is looked for, and between the two where it is met."""
_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T


@dataclass(frozen=True, eq=False)
class TissueMap:
    """A label image and the material of each label.

    Parameters
    ----------
    labels : Volume
        Whole numbers; where the image ends, label 0 goes on: the background.
    materials : mapping of int to Material
        One for each label that occurs, and for label 0 where the tissue's box is larger than the image.
    membranes : sequence of Membrane
        What a tip has to break between them, where a model knows membranes.

    Raises
    ------
    ValueError
        Labels that are not whole numbers, one without a material, or a membrane around none of the tissues.

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
    membranes: tuple[Membrane, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", LabelMap.of(self.labels))
        missing = sorted(set(self._present) - set(self.materials))
        if missing:
            raise ValueError(f"labels {missing} have no material; add them to those of {sorted(self.materials)}")
        for material in self.materials.values():
            check_ratio(material.poissons_ratio)
        object.__setattr__(self, "membranes", tuple(self.membranes))
        for membrane in self.membranes:
            if not any(membrane.holds(name) for name in self.names.values()):
                raise ValueError(
                    f"membrane {membrane.name!r}: around = {shown(list(membrane.around))} is none of the tissues; "
                    f"they are {', '.join(self.names.values())}"
                )

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
        by_label = {0: BACKGROUND, **names_for(found, labels, names)}
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
        known = {0, *present} if 0 in names else present
        return cls(
            found.named({label: names[label] for label in known}), {label: table[names[label]] for label in known}
        )

    def moduli(self, grid: Grid) -> Moduli:
        """Return the moduli of a grid's cells, and what cells of several tissues resist beyond them.

        Such a cell takes the geometric mean, and is stiffer along its layers than across. Tissues
        more than a hundred times apart in shear modulus do not mix: the larger part takes the cell.
        A cell is rigid that nothing else fills; one that bone fills in part is what else it holds, and its corners
        are held by springs, see :class:`~sonospline.mechanics.held_bone.HeldBone`. Bone that floats takes the cells
        half of which is rigid.

        Raises
        ------
        ValueError
            The label image and the grid do not overlap, the grid is larger and label 0 has no material,
            a fluid reaches every face of the box, rigid tissue fills it, or a floating fragment is a single
            cell or touches bone that does not move.
        """
        cells = CellSamples(self.labels, self._places, grid, self._background)
        lame, shear = np.array([material.lame_moduli for material in self._materials]).T
        _refuse_leaking(cells.mean(np.array([material.fluid for material in self._materials], float)))
        bone = cells.mean(self._rigid.astype(float))
        half = bone >= 0.5
        if half.all():
            raise ValueError("labels: rigid tissue fills the box, so nothing can move; give a larger box or more nodes")
        floating = self._floating(cells, half)
        rigid = floating | (bone == 1)
        shares = mixing_shares(shear[cells.held], ~self._rigid[cells.held])
        moduli = []
        for values in (lame, shear):
            of_cells = values[cells.first]
            logs = sum(shares * np.log(values + 1e-30)[cells.held])  # in their order, however many kinds there are
            of_cells[cells.mixed] = np.exp(logs)[cells.kind]
            of_cells[rigid] = np.median(of_cells[~rigid])  # any will do, and this adds no contrast
            moduli.append(of_cells)
        layers = layers_of(cells, lame, shear, shares, ~rigid, np.array(grid.spacing))
        fragments = fragments_of(floating, half & ~floating)
        held = HeldBone.of(cells, self._rigid & ~self._loose, ~rigid, np.array(grid.spacing))
        return Moduli(grid, moduli[0], moduli[1], rigid, fragments, layers, held)

    def mean_of_cells(self, grid: Grid, of_labels: Mapping[int, Sequence[float]]) -> Array:
        """Return numbers of a grid's cells (k, cx, cy, cz) from k numbers for each label: means over what they hold.

        Of those tissues of a cell that mix in its moduli, see :meth:`moduli`.

        Raises
        ------
        ValueError
            As :meth:`moduli`.
        """
        cells = CellSamples(self.labels, self._places, grid, self._background)
        values = np.array([of_labels[label] for label in self._known], float).T
        shear = np.array([material.shear_modulus for material in self._materials])
        shares = mixing_shares(shear[cells.held], ~self._rigid[cells.held])
        means = values[:, cells.first]
        means[:, cells.mixed] = (shares * values[:, cells.held]).sum(axis=1)[:, cells.kind]
        return np.asarray(means)

    def _floating(self, cells: CellSamples, rigid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Rigid cells in which most of the bone is loose."""
        loose, bone = (cells.mean(which.astype(float)) for which in (self._loose, self._rigid))
        floating = rigid & (loose > 0.5 * bone)
        if loose.any() and not floating.any():
            raise ValueError(
                "labels: a floating fragment is half of no cell of the solver's grid; give more nodes, or make it soft"
            )
        return floating

    def resistance(self, points: Array) -> tuple[Array, Array]:
        """Return friction in N/mm and cutting force in N at each of the world points (m, 3); a fluid has neither."""
        labels, known = self.labels_at(points), self._labels_known
        place = np.minimum(np.searchsorted(known, labels), len(known) - 1)
        if (known[place] != labels).any():
            raise ValueError(NO_BACKGROUND)
        return self._friction[place], self._cutting_force[place]

    def labels_at(self, points: Array) -> NDArray[np.integer]:
        """Return the label (m,) at each of the world points (m, 3): the nearest voxel's, 0 beyond the image."""
        return self.labels.sample(points)

    def obstacle(self, needle: Needle, field: Field | None = None) -> Obstacle | None:
        """Return where a needle first enters rigid tissue between its entry and its tip; None where it does not.

        Exact, voxel by voxel. A needle that runs in the very face of a bone, or through no more than an edge or a
        corner of it, passes by.

        Parameters
        ----------
        needle : Needle
            In the world.
        field : Field, optional
            How the tissue has moved, and loose fragments of bone with it; those are then met where they are, to a
            hundredth of a voxel where they are as thick as one. Other bone does not move.

        Examples
        --------
        >>> import sonospline as ss
        >>> from sonospline.mechanics import Material, TissueMap, labelled_cube
        >>> cube = labelled_cube("layers", side=90)
        >>> tissues = TissueMap(cube.labels, {**cube.materials, 1: Material(rigid=True)})
        >>> tissues.obstacle(ss.Needle(entry=(0, 45, 45), tip=(60, 45, 45)))
        Obstacle('label 1' at 30 mm, (30, 45, 45))
        """
        if not self.has_bone:
            return None
        moved = field if self.has_fragments else None
        fixed = self._unmoved(needle, self._rigid if moved is None else self._rigid & ~self._loose)
        if moved is None or (fixed is not None and fixed.depth_mm == 0):
            return fixed
        before = needle if fixed is None else Needle(needle.entry, fixed.point)
        return self._moved(before, moved) or fixed

    def _unmoved(self, needle: Needle, rigid: NDArray[np.bool_]) -> Obstacle | None:
        """The first of some of the labels known that a needle enters, where they are in undeformed tissue."""
        line = (needle.entry.tobytes(), needle.tip.tobytes(), rigid.tobytes())
        last, met = self.__dict__.get("_last_met", (None, None))
        if line != last:  # a console, its session and its model ask for the same needle in turn
            met = self._first_met(needle, rigid)
            self.__dict__["_last_met"] = line, met
        return met

    def _first_met(self, needle: Needle, rigid: NDArray[np.bool_]) -> Obstacle | None:
        places, first, last = voxels_along(self.labels, needle)
        for piece in np.flatnonzero(self._among(rigid, first) & self._among(rigid, last)):
            shared = np.stack([first[piece], last[piece]])[_CORNERS, range(3)]
            if self._among(rigid, shared).all():
                depth, leaves = places[piece : piece + 2].tolist()
                within = needle.entry + 0.5 * (depth + leaves) * needle.direction
                return self._met(needle, depth, int(self.labels_at(within)))
        return None

    def _moved(self, needle: Needle, field: Field) -> Obstacle | None:
        """The first loose fragment that a needle enters, where a field has moved it to."""
        loose = [label for label, is_loose in zip(self._known, self._loose, strict=True) if is_loose]

        def labels(depths: Array) -> NDArray[np.integer]:
            rest = field.inverse(needle.entry + depths[:, None] * needle.direction)
            known = np.isfinite(rest).all(axis=1)  # no label is where tissue folds
            return np.where(known, self.labels_at(np.nan_to_num(rest)), -1)

        finest = min(self.labels.spacing)
        depths = np.linspace(0, needle.depth, 2 + int(_PER_VOXEL * needle.depth / finest))
        found = labels(depths)
        met = np.flatnonzero(np.isin(found, loose))
        if not len(met):
            return None
        if (place := met[0]) == 0:
            return self._met(needle, 0.0, int(found[0]))
        between = np.linspace(depths[place - 1], depths[place], _PER_STEP)
        inside = np.isin(labels(between), loose)
        depth = between[max(0, int(inside.argmax()) - 1)]
        return self._met(needle, float(depth), int(found[place]))

    def _met(self, needle: Needle, depth: float, label: int) -> Obstacle:
        return Obstacle(label, self.names[label], depth, needle.entry + depth * needle.direction)

    @property
    def names(self) -> dict[int, str]:
        """The name of each label; one without is its number."""
        assert isinstance(self.labels, LabelMap)  # made so
        return {label: self.labels.names.get(label, f"label {label}") for label in self._known}

    @property
    def has_bone(self) -> bool:
        """Whether any of it is rigid: what no needle enters."""
        return bool(self._rigid.any())

    @property
    def has_fragments(self) -> bool:
        """Whether any bone is loose, and moves with the tissue."""
        return bool(self._loose.any())

    def stiffness_image(self) -> Volume:
        """Return an image to look at: the place of each voxel's stiffness among those that occur, 0 the softest.

        Stiffness itself, even its logarithm, would leave all but bone black.
        """
        stiffness = [np.inf if material.rigid else material.stiffness_kpa for material in self._materials]
        occurring = np.unique([stiffness[self._known.index(label)] for label in self._present])
        order = np.searchsorted(occurring, stiffness).astype(np.float32)
        return self._with(order[self._places])

    @cached_property
    def _present(self) -> list[int]:
        return [int(label) for label in np.unique(self.labels.voxels)]

    @cached_property
    def _known(self) -> list[int]:
        """Labels that occur, and label 0 where it has a material."""
        background = [0] if 0 in self.materials else []
        return sorted({*self._present, *background})

    @cached_property
    def _labels_known(self) -> NDArray[np.int64]:
        return np.array(self._known, np.int64)

    @cached_property
    def _rigid(self) -> NDArray[np.bool_]:
        """Whether each of the labels known is."""
        return np.array([material.rigid for material in self._materials])

    @cached_property
    def _loose(self) -> NDArray[np.bool_]:
        """Whether each of the labels known is a fragment of bone that moves."""
        return np.array([material.floating for material in self._materials])

    def _among(self, chosen: NDArray[np.bool_], voxels: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether each of the voxels (..., 3), some of them beyond the image, has one of the labels chosen."""
        within = np.all((voxels >= 0) & (voxels < self.labels.voxels.shape), axis=-1)
        i, j, k = np.moveaxis(np.where(within[..., None], voxels, 0), -1, 0)
        beyond = self._background is not None and chosen[0]
        return np.where(within, chosen[self._places[i, j, k]], beyond)

    @property
    def _background(self) -> int | None:
        """Place of label 0 among those known; None where it has no material."""
        return 0 if self._known[0] == 0 else None

    @cached_property
    def _places(self) -> NDArray[np.integer]:
        """Number of each voxel's label among those known, in as few bytes as hold it."""
        places = np.searchsorted(self._known, self.labels.voxels)
        return places.astype(np.min_scalar_type(len(self._known)))

    @property
    def _materials(self) -> list[Material]:
        """Those of the labels known, in their order."""
        return [self.materials[label] for label in self._known]

    @cached_property
    def _friction(self) -> Array:
        return np.array([material.friction_n_per_mm * (not material.fluid) for material in self._materials])

    @cached_property
    def _cutting_force(self) -> Array:
        return np.array([material.cutting_force_n * (not material.fluid) for material in self._materials])

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
