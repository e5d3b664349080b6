"""The short form of every model: one needle, pose after pose, without time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from numpy.typing import ArrayLike

from .. import _validate
from ..fields.field import Field
from ..geometry.needle import Needle, equal_steps
from .contract import Response, State, TissueModel

NEEDLE = "needle"
"""What the one needle is called in states and forces."""
_MOST_STEPS = 400
_SHORTEST_STEP = 1e-9
"""In sides of the tissue."""

T = TypeVar("T")


def until_blocked(way: Iterator[T], response: Callable[[], Response]) -> Iterator[T]:
    """Yield the steps of a way up to the first at whose end, by the response in force, a needle rests on bone."""
    for step in way:
        yield step
        if response().blocked:
            return


class NeedleInsertion:
    """A needle insertion: a model of tissue and the last response of it.

    A step that fails raises and leaves the last :attr:`response` in force. Insertions pickle and
    deep-copy, into other processes too; a copy goes on to the same bits and shares nothing that
    changes with its original.

    Parameters
    ----------
    tissue_model : TissueModel
        Any model of tissue, as of :func:`sonospline.models.make`.

    Examples
    --------
    >>> import sonospline as ss
    >>> from sonospline import models
    >>> insertion = models.NeedleInsertion(models.make("kelvinlet", ss.Tissue(ss.Grid.unit_cube(25))))
    >>> fields = list(insertion.run((0, .5, .5), (.6, .5, .5), steps=3))
    >>> insertion.response.settled, insertion.needle.depth
    (True, 0.6)
    """

    def __init__(self, tissue_model: TissueModel) -> None:
        self.tissue_model = tissue_model
        self.tissue = tissue_model.tissue
        self.reset()

    def reset(self) -> None:
        """Take the needle out and let the tissue return to its undeformed state."""
        self.response: Response = self.tissue_model.step(self.tissue_model.rest)

    def advance(self, needle: Needle) -> Field:
        """Move the needle to a pose and return the field it leaves.

        Raises
        ------
        ValueError
            A needle outside the tissue.
        """
        self.response = self.tissue_model.step(self.response.state, {NEEDLE: needle})
        return self.response.field

    def settle(self) -> Field:
        """Leave the needle where it is until the tissue has come to rest, and return the field.

        After 400 steps tissue that does not is left as it is: :attr:`response` says so.
        """
        if self.needle is not None:
            for _ in range(_MOST_STEPS):
                if self.response.settled:
                    break
                self.advance(self.needle)
        return self.field

    def run(self, entry: ArrayLike, target: ArrayLike, steps: int = 20) -> Iterator[Field]:
        """Advance from entry to target in equal steps, yielding the field after each (Sec. V); bone ends the way."""
        _validate.count("steps", steps)
        whole = Needle(entry, target)
        self.tissue.check_inside(entry=whole.entry, target=whole.tip)
        if whole.depth / steps < _SHORTEST_STEP * self.tissue.grid.side:
            raise ValueError(f"steps = {steps} are steps of {whole.depth / steps:.1e}; give fewer")
        way = (self.advance(needle) for needle in equal_steps(whole, steps))
        return until_blocked(way, lambda: self.response)

    @property
    def state(self) -> State:
        """Where the tissue is."""
        return self.response.state

    @property
    def field(self) -> Field:
        """The field in force."""
        return self.response.field

    @property
    def needle(self) -> Needle | None:
        """Where the needle is; None while it is out."""
        return dict(self.state.needles).get(NEEDLE)

    def __repr__(self) -> str:
        needle = "no needle" if self.needle is None else repr(self.needle)
        return f"{type(self).__name__}({self.tissue!r}, {needle})"
