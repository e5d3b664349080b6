"""Options that several verbs share, each declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def add_path(group: Any, units: str = "RAS mm") -> None:
    """Declare where a needle goes."""
    group.add_argument(
        "--entry", metavar="X,Y,Z|FILE", help=f"where the needle enters the tissue ({units}), or markups (.mrk.json)"
    )
    group.add_argument("--target", metavar="X,Y,Z|FILE", help="where its tip ends")


def add_nodes(group: Any) -> None:
    """Declare the size of the tissue's grid."""
    group.add_argument("--nodes", type=int, default=150_000, metavar="N", help="grid nodes, about (150000)")


def add_seed(group: Any, of: str) -> None:
    """Declare the seed of what is left to chance."""
    group.add_argument("--seed", type=int, default=0, help=f"seed {of}; the same one gives the same (0)")


def add_output(group: Any) -> None:
    """Declare the folder that a verb writes, and what it says."""
    group.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    group.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    group.add_argument("--quiet", action="store_true", help="say nothing meanwhile")
