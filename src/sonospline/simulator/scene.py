"""A scene made ready: everything of it that does not change while a session runs; sessions share it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..fields.field import Field
from ..geometry.tissue import Tissue
from ..io.records import FieldError
from ..mechanics.tissue_map import TissueMap
from ..ultrasound.probe import Probe
from .command import Command
from .imaging import Imager
from .knobs import Knobs
from .scene_content import Undented
from .scene_file import SceneFile
from .skin_frame import SkinFrame
from .surfaces import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scene's tissue, what to see of it, where to go, and what may be asked; :func:`make_scene` makes it."""

    spec: SceneFile
    tissue: Tissue
    frame: SkinFrame
    tissues: TissueMap | None
    """Labelled tissue, for models that know labels; None where it is all one."""
    see: Callable[[Probe, Array], Imager]
    """What a probe at a pose sees."""
    probe: Probe
    targets: Mapping[str, Array]
    start: Command
    knobs: Knobs
    """What may be asked, and how far."""
    draw: Callable[[], tuple[Mesh, ...]]
    """Makes :attr:`meshes`."""
    undented: Undented | None
    """What its tissue is like without the dent that it is painted with; None where it has none."""
    flows: bool
    """Whether blood flows in it, which colour Doppler shows."""
    prepare: Callable[[], None]
    """Makes what the first picture did not need and others will; from any thread."""

    def check(self, command: Command) -> None:
        """Raise FieldError for what of a command is beyond the scene: a number, or breathing it has no part for."""
        self.knobs.check(command)
        if command.tissue is not None and command.tissue.breathing != "none" and self.spec.breathing is None:
            problem = f"= {command.tissue.breathing!r} is not for this scene; give its file a [breathing] part"
            raise FieldError(("tissue", "breathing"), problem)

    def deformed(self, field: Field, *, grid: bool) -> NDArray[np.float32]:
        """Return where a field takes the vertices of all meshes, with or without the grid lines, (m, 3)."""
        count = None if grid else -len(self.meshes[-1].points)
        rest = self._vertices[:count]
        return (rest + field.displacement(rest)).astype(np.float32)

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """What the 3-D view is drawn of, the grid lines last; made when first asked for."""
        return self.draw()

    @cached_property
    def _vertices(self) -> Array:
        """Of all meshes, those of the grid lines last."""
        return np.concatenate([mesh.points for mesh in self.meshes])

    @property
    def has_bone(self) -> bool:
        """Whether anything in it stops a needle."""
        return self.tissues is not None and self.tissues.has_bone

    @property
    def box(self) -> tuple[Array, Array]:
        """Lowest and highest corner of the mechanical box along the world axes."""
        corners = self.tissue.grid.world(np.indices((2, 2, 2)).reshape(3, -1).T * self.tissue.grid.extent)
        return corners.min(axis=0), corners.max(axis=0)

    def __repr__(self) -> str:
        return f"Scene({self.spec.name!r}, {self.tissue!r})"
