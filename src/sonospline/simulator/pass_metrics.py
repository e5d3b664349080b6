"""Which pass of the needle this is, and how long it takes."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, kw_only=True)
class PassMetrics:
    """The present pass, or the last one; never changed, each frame makes the next.

    What a pass looked like is measured by :func:`sonospline.training.measure`.

    Examples
    --------
    >>> from sonospline.simulator.pass_metrics import PassMetrics
    >>> metrics = PassMetrics().entered(10.0)
    >>> metrics.moved(now=13.0)
    PassMetrics(passes=1, time_s=3.0, began=10.0)
    """

    passes: int = 0
    time_s: float = 0.0
    began: float = 0.0

    def entered(self, now: float) -> PassMetrics:
        """Return the metrics of a new pass."""
        return PassMetrics(passes=self.passes + 1, began=now)

    def moved(self, now: float) -> PassMetrics:
        """Return the metrics with the tip inside the tissue."""
        return replace(self, time_s=now - self.began)

    def later(self, seconds: float) -> PassMetrics:
        """Return the metrics as if the pass had begun later: time that was frozen does not count."""
        return replace(self, began=self.began + seconds)
