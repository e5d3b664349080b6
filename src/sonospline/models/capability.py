"""What a model of tissue may be able to do, and the error where it is not."""

from __future__ import annotations

from collections.abc import Iterable

CAPABILITIES = ("forces", "time", "labels", "several needles")
"""Forces on needles; seconds that matter; tissue that differs from place to place; more than one needle."""


class CapabilityError(ValueError):
    """A model was asked for what it cannot do; the message names those that can."""

    def __init__(self, model: str, capability: str, able: Iterable[str], asked: str = "") -> None:
        super().__init__(model, capability, tuple(able), asked)
        self.model, self.capability, self.able, self.asked = self.args

    def __str__(self) -> str:
        others = " or ".join(f"model = {name!r}" for name in self.able)
        remedy = f"use {others}" if others else "no model here can, leave it out"
        return f"model = {self.model!r} cannot do {self.capability}{self.asked and f' ({self.asked})'}; {remedy}"
