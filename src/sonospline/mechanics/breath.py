"""The breath of whoever lies there: begun, held, released and ended as a session asks, without a jump."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from .breathing import Breathing

BreathingAsked = Literal["none", "free", "held"]


@dataclass(frozen=True)
class Breath:
    """Breathing since a time; what it leads to is a pure function of time.

    Parameters
    ----------
    breathing : Breathing
        Whose time 0, at rest, is when it began.
    began_s : float
        Time of the session at which it began.
    ends_s : float, default: inf
        When the last breath is drawn out.

    Examples
    --------
    >>> from sonospline.mechanics import Breathing, Spread
    >>> from sonospline.mechanics.breath import Breath
    >>> breath = Breath(Breathing(Spread(15, 0, 15, 15), Spread(17, 0, 17, 17)), began_s=10.0)  # a breath is 4 s long
    >>> [round(breath.excursion_mm(t), 1) for t in (10.0, 11.0, 12.0)]
    [0.0, 4.2, 17.0]
    >>> ending = breath.asked("none", 11.0)
    >>> round(ending.excursion_mm(12.0), 1), ending.excursion_mm(14.0), ending.asked("none", 14.0)
    (17.0, 0.0, None)
    """

    breathing: Breathing
    began_s: float
    ends_s: float = float("inf")

    def excursion_mm(self, now: float) -> float:
        """Return how far towards the feet the diaphragm is from its rest."""
        return 0.0 if now >= self.ends_s else float(self.breathing.excursion(now - self.began_s))

    def asked(self, how: BreathingAsked, now: float) -> Breath | None:
        """Return the breath as it goes on from now; None once the last one is drawn out and no more is asked for."""
        if now >= self.ends_s:
            anew = Breath(replace(self.breathing, holds=()), now)
            return None if how == "none" else anew.asked(how, now)
        if how == "none":
            return self if self.ends_s < float("inf") else self._ending(now - self.began_s)
        going = replace(self, ends_s=float("inf"))
        return going._held(now - self.began_s) if how == "held" else going._released(now - self.began_s)

    def _held(self, t: float) -> Breath:
        """Held from a time on; holds that are over only put breathing off, and are forgotten so."""
        if self.breathing.is_held:
            return self
        past = self.breathing.holds
        if past and t >= past[-1].end_s + past[-1].return_s:
            put_off = sum(hold.end_s - hold.start_s for hold in past)
            anew = replace(self.breathing, holds=()).held(t - put_off)
            return Breath(anew, self.began_s + put_off)
        return replace(self, breathing=self.breathing.held(t))

    def _released(self, t: float) -> Breath:
        return replace(self, breathing=self.breathing.released(t)) if self.breathing.is_held else self

    def _ending(self, t: float) -> Breath:
        """To the end of a breath that finds the drift of a hold gone."""
        released = self._released(t)
        holds = released.breathing.holds
        steady = max(t, holds[-1].end_s + holds[-1].return_s) if holds else t
        return replace(released, ends_s=self.began_s + released.breathing.rests_at(steady))
