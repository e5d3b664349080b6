"""What a needle pass looked like: time, tip path, how far off the image plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class PassMetrics:
    """Figures of the present pass, or the last one; never changed, each frame makes the next.

    Examples
    --------
    >>> import numpy as np
    >>> from sonospline.simulator.pass_metrics import PassMetrics
    >>> metrics = PassMetrics().entered(10.0)
    >>> for k in range(3):
    ...     metrics = metrics.moved(np.array([0.0, 0, k]), out_of_plane=-0.5, now=11.0 + k)
    >>> metrics.passes, metrics.tip_path_mm, metrics.max_off_plane_mm, metrics.time_s
    (1, 2.0, 0.5, 3.0)
    """

    passes: int = 0
    time_s: float = 0.0
    tip_path_mm: float = 0.0
    max_off_plane_mm: float = 0.0
    began: float = 0.0
    tip: Array | None = None

    def entered(self, now: float) -> PassMetrics:
        """Return the metrics of a new pass."""
        return PassMetrics(passes=self.passes + 1, began=now)

    def moved(self, tip: Array, out_of_plane: float, now: float) -> PassMetrics:
        """Return the metrics with the tip at a place inside the tissue."""
        step = 0.0 if self.tip is None else float(np.linalg.norm(tip - self.tip))
        return replace(
            self, tip=tip, time_s=now - self.began, tip_path_mm=self.tip_path_mm + step,
            max_off_plane_mm=max(self.max_off_plane_mm, abs(out_of_plane)),
        )  # fmt: skip

    def later(self, seconds: float) -> PassMetrics:
        """Return the metrics as if the pass had begun later: time that was frozen does not count."""
        return replace(self, began=self.began + seconds)
