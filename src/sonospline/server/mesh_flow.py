"""Which positions of meshes a viewer is given: those of tissue that moved since the last ones, and not too often."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ..simulator.console import Console
    from ..simulator.console_frame import ConsoleFrame
    from ..simulator.scene import Scene


class MeshFlow:
    """Positions for one viewer, a page for one.

    Parameters
    ----------
    hz : float
        How often they are sent at most.
    """

    def __init__(self, hz: float) -> None:
        self._hz = hz
        self.grid_wanted = self.has_grid = False
        """Whether grid lines are shown, and whether the last positions had them."""
        self._sent: object = None
        self._shown: Scene | None = None
        self._at = -1.0

    def begin(self, console: Console) -> None:
        """Go on with a console's frames; it has no meshes of it yet."""
        self._shown, self._sent, self._at = None, console.session.rest, -1.0

    def show(self, scene: Scene) -> None:
        """Have positions sent from now on: it knows the meshes."""
        self._shown = scene

    def positions(self, scene: Scene, shown: ConsoleFrame) -> NDArray[np.float32] | None:
        """Return deformed vertices where the tissue moved since they were last sent, and that was long enough ago."""
        if scene is not self._shown:
            return None
        now = time.monotonic()
        changed = shown.field is not self._sent or self.grid_wanted != self.has_grid
        if not changed or now - self._at < 1 / self._hz:
            return None
        self._sent, self._at, self.has_grid = shown.field, now, self.grid_wanted
        return scene.deformed(shown.field, grid=self.grid_wanted)
