"""A label map: a volume whose numbers are names, so that nothing may be interpolated between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _validate
from .._memory import refuse_beyond
from .._shown import shown
from .volume import Volume

TOLERANCE = 1e-3
"""How far a stored number may be from a whole one: scale factors and float formats leave such rounding."""
LARGEST = 65_535
"""Largest label, unless what it is for allows less."""

_SLICES, _AGREEING = 64, 0.85
HALF = 0.5 + 1e-6
"""Voxels from the centre of the last one to its border, and rounding."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class LabelMap(Volume):
    """Whole numbers at or above zero on a lattice; 0 is background, also beyond the last voxel.

    It is never interpolated: between voxels it is the label of the nearest one.

    Parameters
    ----------
    voxels, spacing, origin, direction
        As for :class:`Volume`; whole numbers.
    names : mapping of int to str, default: {}
        What the labels are, where that is known.

    Raises
    ------
    ValueError
        Voxels that are not whole numbers at or above zero; :meth:`of` takes what files hold.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.geometry.label_map import LabelMap
    >>> labels = LabelMap(voxels=np.full((4, 4, 4), 7, np.uint8), spacing=(1, 1, 1))
    >>> labels.sample([[1.4, 1, 1], [9, 9, 9]]).tolist(), labels
    ([7, 0], LabelMap(4 x 4 x 4, 1.0 mm, 1 label))
    """

    names: Mapping[int, str]

    def __init__(
        self,
        *,
        voxels: NDArray[Any],
        spacing: float | Sequence[float] | NDArray[np.float64],
        origin: ArrayLike = (0, 0, 0),
        direction: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        names: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        super().__init__(voxels=voxels, spacing=spacing, origin=origin, direction=direction)
        if not np.issubdtype(self.voxels.dtype, np.integer):
            raise ValueError(f"voxels has type {self.voxels.dtype}; give whole numbers, or use LabelMap.of")
        if np.issubdtype(self.voxels.dtype, np.signedinteger) and self.voxels.min() < 0:
            raise ValueError(f"voxels has the value {self.voxels.min()}; give labels at or above zero")

        object.__setattr__(self, "names", {int(label): str(name) for label, name in names.items()})

    @cached_property
    def present(self) -> tuple[int, ...]:
        """Labels that occur, 0 among them."""
        largest = int(self.voxels.max())
        if largest > LARGEST:
            return tuple(np.unique(self.voxels).tolist())
        found = np.zeros(largest + 1, bool)
        for slab in _slabs(self.voxels):
            found |= np.bincount(slab.reshape(-1).astype(np.intp), minlength=largest + 1) > 0
        return tuple(np.flatnonzero(found).tolist())

    def _facts(self) -> list[str]:
        found = len(self.present)
        facts = super()._facts()
        facts[2] = f"{found} label{'s' if found != 1 else ''}{' with names' if self.names else ''}"
        return facts

    def named(self, names: Mapping[int, str]) -> LabelMap:
        """Return the same labels with names.

        Examples
        --------
        >>> import numpy as np
        >>> from sonospline.geometry import LabelMap
        >>> labels = LabelMap(voxels=np.full((4, 4, 4), 7, np.uint8), spacing=(1, 1, 1))
        >>> labels.named({7: "liver"}).names
        {7: 'liver'}
        """
        return replace(self, names=names)

    def sample(self, points: ArrayLike, *, outside: float = 0) -> NDArray[Any]:
        """Return labels (m,) at world points (m, 3): that of the nearest voxel, ``outside`` beyond the last one.

        At one point (3,) it is one label.
        """
        found, shape = _validate.rows("points", points)
        index = self.index(found)
        last = np.array(self.voxels.shape) - 1
        inside = ((index >= -HALF) & (index <= last + HALF)).all(axis=1)
        nearest = np.clip(np.rint(index), 0, last).astype(int)
        labels = np.where(inside, self.voxels[tuple(nearest.T)], self.voxels.dtype.type(outside))
        return labels.reshape(shape)[()]

    def connected(self, label: int, points: ArrayLike) -> NDArray[np.bool_]:
        """Return which voxels of a label are connected, face to face, to one of some world points (m, 3) in it.

        Examples
        --------
        >>> import numpy as np
        >>> from sonospline.geometry import LabelMap
        >>> voxels = np.zeros((2, 2, 4), np.uint8)
        >>> voxels[:, :, [0, 1, 3]] = 1
        >>> LabelMap(voxels=voxels, spacing=(1, 1, 1)).connected(1, [[0, 0, 0]])[0, 0].tolist()
        [True, True, False, False]
        """
        from scipy.ndimage import label as numbered

        found = self.voxels == label
        box = _bounding_box(found, margin=0)
        parts, _ = numbered(found[box])
        at = np.rint(self.index(np.asarray(points, float))).astype(int) - [side.start for side in box]
        found[box] = np.isin(parts, parts[tuple(at.T)])
        return found

    def refined(self, spacing_mm: float) -> LabelMap:
        """Return the labels on a finer lattice, their surfaces rounded instead of stepped.

        Each label's indicator is interpolated linearly, slightly smoothed, and the largest one wins.
        """
        from scipy.ndimage import gaussian_filter, zoom

        lattice = self.lattice
        factors = [max(1.0, h / spacing_mm) for h in lattice.spacing]
        shape = [round((n - 1) * f) + 1 for n, f in zip(lattice.shape, factors, strict=True)]
        refuse_beyond(9 * int(np.prod(shape)), f"spacing_mm = {spacing_mm}: the refined labels")
        best, winner = np.zeros(shape, np.float32), np.zeros(shape, self.voxels.dtype)
        exact = [(m - 1) / (n - 1) for m, n in zip(shape, lattice.shape, strict=True)]
        for label in self.present:
            box = _bounding_box(self.voxels == label, margin=3)
            soft = gaussian_filter((self.voxels[box] == label).astype(np.float32), 0.7)
            start = [round(s.start * e) for s, e in zip(box, exact, strict=True)]
            stop = [round((s.stop - 1) * e) + 1 for s, e in zip(box, exact, strict=True)]
            size = [b - a for a, b in zip(start, stop, strict=True)]
            fine = zoom(soft, [m / n for m, n in zip(size, soft.shape, strict=True)], order=1, grid_mode=False)
            window = tuple(slice(a, a + n) for a, n in zip(start, fine.shape, strict=True))
            wins = fine > best[window]
            best[window][wins] = fine[wins]
            winner[window][wins] = label
        spacing = [h * (n - 1) / (m - 1) for h, n, m in zip(lattice.spacing, lattice.shape, shape, strict=True)]
        return LabelMap(
            voxels=winner, spacing=spacing, origin=lattice.origin, direction=lattice.direction, names=self.names
        )

    @classmethod
    def of(cls, volume: Volume, *, name: str = "labels", largest: int = LARGEST) -> LabelMap:
        """Return a volume as a label map.

        Parameters
        ----------
        volume : Volume
            Voxels of any type; those within 1e-3 of a whole number are rounded to it.
        name : str, default: "labels"
            The argument, as an error names it.
        largest : int, default: 65535
            Largest label allowed.

        Raises
        ------
        ValueError
            A voxel that is not a whole number 0 to ``largest``.

        Examples
        --------
        >>> import numpy as np
        >>> from sonospline.geometry.label_map import LabelMap
        >>> from sonospline.geometry.volume import Volume
        >>> stored = Volume(voxels=np.full((2, 2, 2), 4.9999995), spacing=(1, 1, 1))
        >>> int(LabelMap.of(stored).voxels.max())
        5
        """
        if not isinstance(volume, Volume):
            raise ValueError(f"{name} = {shown(volume)} is no Volume; read one with read_labels, or make a LabelMap")
        voxels = volume.voxels
        if not np.issubdtype(voxels.dtype, np.integer):
            voxels = _rounded(voxels, name, largest)
        low, high = (0 if voxels.dtype == np.uint8 else int(voxels.min())), int(voxels.max())
        if low < 0 or high > largest:
            raise _refusal(name, low if low < 0 else high, largest)
        if isinstance(volume, cls):
            return volume
        return cls(voxels=voxels, spacing=volume.spacing, origin=volume.origin, direction=volume.direction)


def looks_like_labels(volume: Volume) -> bool:
    """Return whether an image seems to be a label map: whole numbers, most of them the same as their neighbours.

    Neighbours that are both background say nothing. Of those that are both above zero, over nine in ten agree in
    label maps of organs, and fewer than half in images, even of 16 grey levels.
    """
    try:
        labels = LabelMap.of(volume)
    except ValueError:
        return False
    slabs = _slabs(labels.voxels)
    slices = slabs[:: max(1, len(slabs) // _SLICES)]
    same, both = 0, 0
    for first, second in ((slices[:, 1:], slices[:, :-1]), (slices[:, :, 1:], slices[:, :, :-1])):
        inside = (first > 0) & (second > 0)
        both += int(np.count_nonzero(inside))
        same += int(np.count_nonzero(inside & (first == second)))
    return both > 0 and same >= _AGREEING * both


def _rounded(voxels: NDArray[Any], name: str, largest: int) -> NDArray[np.unsignedinteger[Any]]:
    """Whole numbers of the smallest type, from numbers that are nearly whole; slab by slab, to keep memory."""
    if not np.issubdtype(voxels.dtype, np.floating) and voxels.dtype != np.bool_:
        raise ValueError(f"{name} has voxels of type {voxels.dtype}; give whole numbers 0 to {largest}")
    labels = np.empty_like(voxels, np.min_scalar_type(largest))
    for stored, found in zip(_slabs(voxels), _slabs(labels), strict=True):
        slab = stored.astype(np.float64)
        with np.errstate(invalid="ignore"):
            whole = np.rint(slab)
            wrong = ~((np.abs(slab - whole) <= TOLERANCE) & (whole >= 0) & (whole <= largest))
        if wrong.any():
            raise _refusal(name, slab[wrong][0], largest)
        found[...] = whole
    return labels


def _slabs(voxels: NDArray[Any]) -> NDArray[Any]:
    """The voxels with the axis first along which they lie farthest apart in memory."""
    return np.moveaxis(voxels, int(np.argmax(np.abs(voxels.strides))), 0)


def _bounding_box(mask: NDArray[np.bool_], margin: int) -> tuple[slice, ...]:
    box = []
    for axis in range(mask.ndim):
        held = np.flatnonzero(mask.any(axis=tuple(a for a in range(mask.ndim) if a != axis)))
        box.append(slice(max(0, held[0] - margin), min(mask.shape[axis], held[-1] + margin + 1)))
    return tuple(box)


def _refusal(name: str, value: float, largest: int) -> ValueError:
    return ValueError(f"{name} has a voxel of {value:.9g}; give a label map, whole numbers 0 to {largest}")
