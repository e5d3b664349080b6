"""What a real image shows that echoes of a clean beam do not: clutter, haze, and surfaces seen from all sides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from .. import _validate

_HARMONIC_SHARES = {"side_lobes_db": 1.0, "grating_db": 1.0, "haze_db": 2 / 3, "tail_db": 0.5, "multiples_db": 0.5}
"""Of what harmonic imaging lowers."""
_LOUDEST_MULTIPLES_DB = -10.0
"""Louder ones of strong reflectors would grow from one to the next."""
_LEVELS = ("side_lobes_db", "grating_db", "haze_db", "tail_db", "multiples_db")
HARMONIC_NOISE_DB = 6.0
"""More noise over a harmonic: set by eye."""


@dataclass(frozen=True, kw_only=True)
class Artefacts:
    """Parts of a real image beyond its clean beams, each with its level; None, or False, switches one off.

    Parameters
    ----------
    diffuse : bool, default: True
        Whether surfaces scatter to all sides (by the roughness of their tissues, 12 to 18 dB below the mirror's
        echo), turn with the tissue, and fluids have walls of two lines.
    side_lobes_db : float or None, default: -22
        What a beam six times as wide and three times as thick adds to uniform speckle: side lobes and the slice's
        skirts, which fill cysts. Set by eye; clutter in vivo lies 0 to 35 dB below the tissue beside it.
    grating_db : float or None, default: -48
        Grating lobes: a point's echo from beside the beam, 31 degrees (linear) or 44 (curvilinear) off, below the same
        point's in it. Of SIMUS, for Verasonics' arrays; see :mod:`sonospline.ultrasound.grating`.
    haze_db : float or None, default: 0
        Reverberation under the probe's face, over liver speckle at the surface. Set by eye.
    tail_db : float or None, default: -30
        Reverberation behind what echoes: what uniform speckle would hear of itself. Set by eye.
    multiples_db : float or None, default: -12
        What the probe's face sends back of an echo, whose reflector is then seen again at multiples of its distance:
        of what stands 20 dB over liver at its depth. Set by eye.
    defocus_db : float or None, default: 3
        How much louder side lobes become off the probe's transmit focus, where it has one. Set by eye.
    harmonic_db : float or None, default: 12
        How much less of lobes harmonic imaging hears, and two thirds of it of haze, half of it of tails and multiples.
        Set by eye.
    needle : bool, default: True
        Whether a needle has speckle and drop-outs along its shaft, a bevel with two echoes, a comet tail and a
        whole shadow.

    Raises
    ------
    ValueError
        A level that is not finite or above 20 dB.

    Examples
    --------
    >>> from sonospline.ultrasound import Artefacts
    >>> Artefacts(haze_db=None).side_lobes_db
    -22.0
    >>> Artefacts().in_harmonic_mode().side_lobes_db
    -34.0
    """

    diffuse: bool = True
    side_lobes_db: float | None = -22.0
    grating_db: float | None = -48.0
    haze_db: float | None = 0.0
    tail_db: float | None = -30.0
    multiples_db: float | None = -12.0
    defocus_db: float | None = 3.0
    harmonic_db: float | None = 12.0
    needle: bool = True

    def __post_init__(self) -> None:
        for name in (*_LEVELS, "defocus_db", "harmonic_db"):
            level = getattr(self, name)
            if level is not None and not _validate.real(name, level) <= 20:
                raise ValueError(f"{name} = {level} is too loud; give at most 20 dB, or None for none")
        if self.multiples_db is not None and self.multiples_db > _LOUDEST_MULTIPLES_DB:
            raise ValueError(
                f"multiples_db = {self.multiples_db} sends back more than there was; give at most "
                f"{_LOUDEST_MULTIPLES_DB:g} dB, or None for none"
            )

    @classmethod
    def none(cls) -> Artefacts:
        """Return those of clean beams."""
        return cls(diffuse=False, needle=False, **dict.fromkeys((*_LEVELS, "defocus_db")))

    def in_harmonic_mode(self) -> Artefacts:
        """Return them for tissue harmonic imaging, which weak side lobes and the near field hardly excite."""
        less = 0.0 if self.harmonic_db is None else self.harmonic_db
        lowered: dict[str, Any] = {
            name: None if (level := getattr(self, name)) is None else level - share * less
            for name, share in _HARMONIC_SHARES.items()
        }
        return replace(self, **lowered)
