"""An event in words, as a page shows it: known before anything that computes is loaded."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LoggedEvent:
    """An event in words, such as ``punctured "renal capsule" at 1.2 N``."""

    number: int
    """From 1 on."""
    text: str
    depth: float
    """How deep the needle was, mm."""

    def __repr__(self) -> str:
        return f"LoggedEvent({self.number}, {self.text!r}, {self.depth:.4g} mm)"


Log = tuple[LoggedEvent, ...]
