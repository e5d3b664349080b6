"""A phantom to be imaged: a label map and the acoustic properties of its labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from .._by_value import ByValue
from .._shown import lengths, shown, size
from ..geometry.label_map import LabelMap
from ..geometry.volume import Volume
from ..io.volumes import to_sitk
from ..io.writing import write_image
from .acoustics import NO_ECHO, TISSUES, AcousticTissue, textured, write_table
from .flow import Flow
from .interfaces import Interfaces
from .scatterers import echo_scene

Array = NDArray[np.float64]

LARGEST_LABEL = 255


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Phantom(ByValue):
    """Tissue labels on a lattice (undeformed, world coordinates) and what each label is.

    The phantom may be wider than the mechanical box: beyond a pinned face nothing moves.

    Parameters
    ----------
    labels : Volume
        Whole numbers 0 to 255. What lies beyond the volume counts as label 0.
    tissues : mapping of int to AcousticTissue or str
        Properties of every label that occurs; a string names one of the default table.
    flows : iterable of Flow, optional
        What flows in its vessels, which colour Doppler shows: the blood of a vessel is what its middle is labelled.

    Raises
    ------
    ValueError
        Labels that are not whole numbers 0 to 255, a label without properties, or a flow whose middle lies outside the
        labels or in a tissue without echo.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.ultrasound import Phantom
    >>> from sonospline.geometry.volume import Volume
    >>> Phantom.uniform("liver", size_mm=(60, 20, 60)).tissues[0].name
    'liver'
    """

    labels: LabelMap
    tissues: Mapping[int, AcousticTissue]
    flows: tuple[Flow, ...]

    def __init__(
        self, labels: Volume, tissues: Mapping[int, AcousticTissue | str], *, flows: Iterable[Flow] = ()
    ) -> None:
        if not isinstance(labels, Volume):
            raise ValueError(f"labels = {shown(labels)} is not a Volume; read one with read_labels")
        object.__setattr__(self, "labels", LabelMap.of(labels, largest=LARGEST_LABEL))
        known = {
            int(label): tissue if isinstance(tissue, AcousticTissue) else _named(int(label), tissue)
            for label, tissue in tissues.items()
        }
        object.__setattr__(self, "tissues", known)
        for label in (0, *self.labels.present):
            if label not in known:
                raise ValueError(
                    f"label {label} has no acoustic properties; name its tissue, one of {', '.join(sorted(TISSUES))}, "
                    "or give an AcousticTissue"
                )
        object.__setattr__(self, "flows", tuple(flows))
        for flow in self.flows:
            if self.blood_of(flow).backscatter_db <= NO_ECHO:
                raise ValueError(f"{flow} is in {self.blood_of(flow).name}, which has no echo; give blood that has one")

    def __repr__(self) -> str:
        lattice = self.labels.lattice
        return f"Phantom({size(lattice.shape)}, {lengths(lattice.spacing)}, {len(self.tissues)} tissues)"

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_echoes"}  # made anew where asked for

    @classmethod
    def uniform(
        cls, tissue: str | AcousticTissue, *, size_mm: tuple[float, float, float], spacing_mm: float = 1.0
    ) -> Phantom:
        """Return a box of one tissue, its first voxel at the origin of the world."""
        shape = tuple(max(2, round(side / spacing_mm) + 1) for side in size_mm)
        labels = Volume(voxels=np.zeros(shape, np.uint8), spacing=(spacing_mm,) * 3)
        return cls(labels, {0: tissue})

    def blood_of(self, flow: Flow) -> AcousticTissue:
        """Return what flows in a vessel: the tissue in its middle."""
        return self.tissues[self._label_in(flow)]

    @cached_property
    def still(self) -> Phantom:
        """The phantom with its flowing blood silent, which is heard by itself; a vessel without flow keeps its echo."""
        voxels, tissues = self.bytes, dict(self.tissues)
        for label in {self._label_in(flow) for flow in self.flows}:
            middles = [flow.middle for flow in self.flows if self._label_in(flow) == label]
            at_rest = (self.bytes == label) & ~self.labels.connected(label, middles)
            if at_rest.any():
                other = min(set(range(LARGEST_LABEL + 1)) - set(tissues), default=label)  # without one all are silent
                voxels, tissues[other] = np.where(at_rest, np.uint8(other), voxels), tissues[label]
            tissues[label] = replace(tissues[label], backscatter_db=NO_ECHO)
        labels = self.labels if voxels is self.bytes else replace(self.labels, voxels=voxels)
        still = object.__new__(Phantom)
        still.__dict__.update(labels=labels, tissues=tissues, flows=())
        return still

    def textured(self) -> Phantom:
        """Return the phantom with textures: fibrils, septa, portal triads, as each tissue's name has them."""
        tissues = {label: textured(tissue) for label, tissue in self.tissues.items()}
        return Phantom(self.labels, tissues, flows=self.flows)

    def _label_in(self, flow: Flow) -> int:
        lattice = self.labels.lattice
        index = np.rint(lattice.local(flow.middle[None])[0] / lattice.spacing).astype(int)
        if not ((index >= 0) & (index < lattice.shape)).all():
            raise ValueError(f"{flow} has its middle outside the labels; give a vessel inside them")
        return int(self.bytes[tuple(index)])

    def table(self, quantity: str) -> Array:
        """Return one property of every label, (256,) or (256, 3); labels without a tissue take label 0's."""
        plain = np.asarray(getattr(self.tissues[0], quantity), float)
        values = np.broadcast_to(plain, (256, *plain.shape)).copy()
        for label, tissue in self.tissues.items():
            values[label] = getattr(tissue, quantity)
        return values

    @cached_property
    def bytes(self) -> NDArray[np.uint8]:
        """The label map as the core takes it."""
        return np.ascontiguousarray(self.labels.voxels, np.uint8)

    @cached_property
    def interfaces(self) -> Interfaces:
        """Points on the surfaces where the impedance steps."""
        points, normals, reflection, area = self.echoes.interfaces()
        lattice = self.labels.lattice
        world, turned = lattice.world(points), normals @ lattice.direction.T
        return Interfaces(world.astype(np.float32), turned.astype(np.float32), reflection, area)

    def prepare(self) -> None:
        """Find the interfaces that no probe has looked at yet, from any thread: looks elsewhere are then faster."""
        self.echoes.prepare()

    @property
    def echoes(self) -> Any:
        """The core's part of the phantom, which chooses scatterers; made once for each backend."""
        backend = _core.backend()
        if backend not in self._echoes:
            self._echoes[backend] = echo_scene(self.bytes, self.labels.lattice.spacing, self.table)
        return self._echoes[backend]

    @cached_property
    def _echoes(self) -> dict[str, Any]:
        return {}

    def refined(self, spacing_mm: float) -> Phantom:
        """Return the same phantom on a finer lattice, its surfaces rounded instead of stepped.

        Each label's indicator is interpolated linearly, slightly smoothed, and the largest one wins.
        """
        return Phantom(self.labels.refined(spacing_mm), self.tissues, flows=self.flows)

    def save(self, labels: str | PathLike[str], table: str | PathLike[str]) -> None:
        """Write the label map (``.seg.nrrd`` opens in 3D Slicer as a segmentation) and the acoustic table (CSV)."""
        lattice = self.labels.lattice
        image = to_sitk(
            Volume(voxels=self.bytes, spacing=lattice.spacing, origin=lattice.origin, direction=lattice.direction)
        )
        present = [label for label in self.labels.present if label]
        for number, label in enumerate(present):
            colour = np.random.default_rng(label).uniform(0.2, 0.95, 3)
            entries = {
                "ID": f"Segment_{label}",
                "Name": self.tissues[label].name,
                "LabelValue": str(label),
                "Layer": "0",
                "Color": " ".join(f"{c:.3f}" for c in colour),
                "NameAutoGenerated": "0",
                "ColorAutoGenerated": "0",
                "Extent": " ".join(f"0 {n - 1}" for n in self.bytes.shape),
            }
            for key, value in entries.items():
                image.SetMetaData(f"Segment{number}_{key}", value)
        image.SetMetaData("Segmentation_SourceRepresentation", "Binary labelmap")
        write_image(image, labels)
        write_table(table, sorted(self.tissues.items()))


def _named(label: int, name: str) -> AcousticTissue:
    if name not in TISSUES:
        raise ValueError(
            f"label {label} is {name!r}, which has no acoustic properties; use one of {', '.join(sorted(TISSUES))}"
        )
    return TISSUES[name]
