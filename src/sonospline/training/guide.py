"""What may be shown beside the image of an exercise."""

from __future__ import annotations

from typing import Literal, get_args

Guide = Literal["path", "target", "tip", "numbers", "3-D view"]
ALL_GUIDES: frozenset[Guide] = frozenset(get_args(Guide))
