"""How much of the study is done."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from .._extras import present
from . import dense_steps
from .models_compared import Scope
from .parallel import usable_processors
from .tuning import GENERATIONS, POPULATION


@dataclass(frozen=True)
class Plan:
    """How much of the study is done, and with which engine."""

    seed: int
    solver: str
    """Of the references, which scikit-fem computes: "multigrid", or "direct" where Pardiso is at hand."""
    timed: dict[str, str]
    """The engine each solver is timed with."""
    sides: tuple[int, ...] = (25, 31, 37, 43, 48, 53)
    """Nodes a side of the meshes errors and times are measured on; the first is tuned on."""
    depths: int = 10
    """Equal steps to the target at which errors are measured."""
    tuning_depths: int = 2
    """How many of them are tuned on; a divisor of their number."""
    population: int = POPULATION
    generations: int = GENERATIONS
    drawn: int = 60
    """Insertions, from all faces, that sets of parameters are compared on."""
    alone: int = 12
    """How many of them parameters are fitted to, each by itself."""
    fits: int = 450
    """Evaluations of each such fit."""
    scope: Scope = field(default_factory=Scope)
    """How much the three models are compared."""
    dense_side: int = dense_steps.SIDE
    """Nodes a side of the mesh that dense steps are timed on."""
    dense_counts: tuple[int, ...] = dense_steps.COUNTS
    """Their landmarks."""
    labels: Path | None = None
    """A label map, with the names of its labels, that the models are compared in too."""
    workers: int = field(default_factory=usable_processors, compare=False)

    @classmethod
    def full(cls, seed: int, labels: Path | None = None) -> Plan:
        """Return the whole study, timed with the paper's own engine, FEniCSx, and the fastest factor at hand."""
        pardiso = present("pypardiso")
        timed = dict.fromkeys(("from_scratch", "multigrid", "direct"), "fenicsx")
        return cls(
            seed,
            "direct" if pardiso else "multigrid",
            timed | {"direct": "scikit-fem"} if pardiso else timed,
            labels=labels,
        )

    @classmethod
    def quick(cls, seed: int, labels: Path | None = None) -> Plan:
        """Return a study of a few minutes: two meshes, a small search, the engine that pip installs."""
        timed = dict.fromkeys(("from_scratch", "multigrid", "direct"), "scikit-fem")
        return cls(
            seed,
            "multigrid",
            timed,
            sides=(25, 31),
            depths=2,
            tuning_depths=1,
            population=16,
            generations=12,
            drawn=12,
            alone=2,
            fits=90,
            scope=Scope(("H3",), fine=49, depths=4, real=1, checked=19),
            labels=labels,
        )
