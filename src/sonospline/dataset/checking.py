"""Whether a data set is what its manifest says: every file's hash, and samples made again."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .layout import MANIFEST
from .plan import Plan
from .reader import DataSet
from .recipe import Recipe
from .sample import World
from .shard import Receipt, check_worker
from .specification import Specification

Progress = Callable[[int, int], None]


@dataclass
class Checked:
    """What a check found."""

    files: int = 0
    remade: int = 0
    problems: list[str] = field(default_factory=list)
    damaged: list[int] = field(default_factory=list)
    """Shards of which a file is gone or is not what the manifest says."""


def check(
    data: DataSet, *, remade: int = 0, seed: int = 0, folder: Path | None = None, progress: Progress | None = None
) -> Checked:
    """Check every file of a data set against its hash, and some samples against what their recipes make.

    Parameters
    ----------
    data : DataSet
        The data set.
    remade : int, default: 0
        Samples to make again, bit for bit; here, from the specification's own sources.
    seed : int, default: 0
        Of which they are.
    folder : Path, optional
        From where the files of its specification are seen, where samples are made again; by default from here.
    progress : callable, optional
        Called with files and samples done, and all.

    Raises
    ------
    WorkerError
        Samples are to be made again, and this machine would make other bits.
    """
    receipts = [Receipt.of(held) for held in data.manifest["shards"]]
    indices = _chosen(data, remade, seed)
    total, found = sum(len(receipt.files) for receipt in receipts) + len(indices), Checked()
    tell = progress or (lambda done, of: None)
    for receipt in receipts:
        before = len(found.problems)
        for name, (known, _) in receipt.files.items():
            found.problems += _problem(data, receipt.shard, name, known)
            found.files += 1
            tell(found.files, total)
        if len(found.problems) > before:
            found.damaged.append(receipt.shard)
    if indices and not found.problems:
        asked = data.specification if folder is None else data.specification.seen_from(folder)
        for problem in _remade(data, asked, indices):
            found.remade += 1
            found.problems += problem
            tell(found.files + found.remade, total)
    return found


def _problem(data: DataSet, shard: int, name: str, known: str) -> list[str]:
    try:
        content = data.store.read(name)
    except FileNotFoundError:
        return [f"shard {shard}: {name} is gone; make the data set again to have it back"]
    if hashlib.sha256(content).hexdigest() != known:
        return [f"shard {shard}: {name} is not what {MANIFEST} says; remove it and make the data set again"]
    return []


def _chosen(data: DataSet, count: int, seed: int) -> list[int]:
    known = [index for index in range(len(data)) if index not in data.failed] if count else []
    random = np.random.default_rng(seed)
    return sorted(int(index) for index in random.choice(known, min(count, len(known)), replace=False)) if known else []


def _remade(data: DataSet, asked: Specification, indices: list[int]) -> Iterator[list[str]]:
    """For each of some samples, what differs when it is made again."""
    check_worker(data.manifest["made_by"], who="this machine")
    plan, rows = Plan(asked), {}
    wanted = set(indices)
    for row in data.rows(columns=["recipe"]):
        if row["index"] in wanted:
            rows[row["index"]] = row
    for index in indices:
        recipe = Recipe.parse(rows[index]["recipe"])
        if plan.recipe(index) != recipe:
            yield [f"sample {index}: its recipe is not what the specification draws"]
            continue
        if not data.forms:
            yield []
            continue
        made = World(plan.anatomy(recipe.anatomy), data.manifest["labels"]).sample(recipe)
        number, place = divmod(index, data.specification.shard)
        held = data.shard(number)
        differ = [name for name, array in made.arrays.items() if not np.array_equal(array, held[name][place])]
        yield [f"sample {index}: {', '.join(differ)} come out otherwise than stored"] if differ else []
