"""What is wrong with a header."""

from __future__ import annotations

WHOLE = "check that the file is whole"


class HeaderError(ValueError):
    """A header that cannot be used; ``remedy`` says what to do."""

    def __init__(self, problem: str, remedy: str = WHOLE) -> None:
        self.remedy = remedy
        super().__init__(problem)
