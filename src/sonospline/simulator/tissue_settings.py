"""What is asked of tissue in time."""

from typing import Annotated, Literal, get_args

from .._shown import shown
from ..io.records import FieldError, Record, about
from ..mechanics.breath import BreathingAsked

Contact = Literal["pose", "track"]
Relaxation = Literal["none", "tissue"]
ProbeAsked = Literal["looks", "presses"]
_WORDS = {"contact": Contact, "relaxation": Relaxation, "breathing": BreathingAsked, "probe": ProbeAsked}
NO_TRACK = "= 'tissue' is for needles that leave a track; give contact = 'track', too"


class TissueSettings(Record, frozen=True, kw_only=True):
    """What tissue does in time and under the probe, by models that know time; off, it answers to needles' poses alone.

    Raises
    ------
    FieldError
        A word that is not known, or tissue that relaxes under needles that leave no track.

    Examples
    --------
    >>> from sonospline.simulator import TissueSettings
    >>> TissueSettings(contact="track", breathing="free")
    TissueSettings(contact='track', relaxation='none', breathing='free', probe='looks')
    """

    contact: Annotated[Contact, about("forces of the needle's pose, or of the track it has left")] = "pose"
    relaxation: Annotated[Relaxation, about("whether tissue relaxes, where contact is a track")] = "none"
    breathing: Annotated[BreathingAsked, about("whether somebody breathes, or holds the breath")] = "none"
    probe: Annotated[ProbeAsked, about("whether the probe only looks, or dents the skin where it is")] = "looks"

    def __post_init__(self) -> None:
        for name, words in _WORDS.items():
            if getattr(self, name) not in get_args(words):
                known = ", ".join(get_args(words))
                raise FieldError((name,), f"= {shown(getattr(self, name))} is not known; choose one of {known}")
        if self.relaxation == "tissue" and self.contact == "pose":
            raise FieldError(("relaxation",), NO_TRACK)
