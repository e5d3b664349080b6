"""The card of a data set: what is in it, how it was made, what it is not; in Markdown, with a picture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..io.png import png
from .reader import DataSet

_SHOWN = 4
_GAP = 4
_OVER = 0.35
"""Of a label's colour over the image."""
_NEEDLE = (255, 122, 48)
_USE = """```python
from sonospline.dataset import DataSet

data = DataSet("{address}")
sample = data.sample(0)  # arrays by name, and sample["row"]
for sample in data.samples("train", shuffle=0):
    ...
```"""


def card(data: DataSet, shown: str | None) -> str:
    """Return the card; ``shown`` is the name of its picture."""
    held = data.manifest
    lines = [
        "---", f"license: {held['licence'].lower()}", f"pretty_name: {held['name']}",
        "tags: [ultrasound, needle, synthetic]",
        "---", f"# {held['name']}", "", held["description"] or "Synthetic needle insertions under ultrasound.", "",
        f"{held['samples']:,} samples, {held['bytes_a_sample']:,.0f} bytes each, form `{data.form}`; "
        f"licence {held['licence']}. Made by Sonospline; not for clinical use.", "",
    ]  # fmt: skip
    if shown is not None:
        lines += [f"![Images, and what is true of them: tissue by colour, the needle in orange]({shown})", ""]
    lines += [*_splits(data), *_arrays(data), *_labels(data), *_origin(data), *_limits(data)]
    lines += ["## Use", "", _USE.format(address="."), ""]
    return "\n".join(lines)


def _splits(data: DataSet) -> Iterator[str]:
    yield from ("## Splits", "", "Whole anatomies are in one split: none of them is seen in two.", "")
    yield from ("| split | samples |", "| --- | --- |")
    yield from (f"| {name} | {count:,} |" for name, count in sorted(data.manifest["splits"].items()))
    yield from ("", f"{len(data.failed):,} samples could not be made; the manifest says why.", "")


def _arrays(data: DataSet) -> Iterator[str]:
    if not data.forms:
        yield from ("Recipes alone: `sonospline dataset rebuild` makes the arrays again, bit for bit.", "")
        return
    yield from ("## Arrays", "", "| name | shape | type | what |", "| --- | --- | --- | --- |")
    for name, form in data.forms.items():
        unit = " (0.01 mm)" if "scale_factor" in form.attributes else ""
        yield f"| `{name}` | {' x '.join(map(str, form.shape))} | {form.dtype}{unit} | {form.about} |"
    yield from ("", "The table has poses (RAS, mm), forces (N), the target at rest and now, and the recipe.", "")


def _labels(data: DataSet) -> Iterator[str]:
    names = ", ".join(f"{number} {name}" for number, name in sorted(data.labels.items()))
    yield from (f"Labels: 0 nothing, {names}.", "")


def _origin(data: DataSet) -> Iterator[str]:
    made = data.manifest["made_by"]
    kinds = ", ".join(
        part.kind if part.scene is None else f"{part.kind} {part.scene}" for part in data.specification.sources
    )
    yield from ("## Origin", "", f"Anatomies: {kinds}. Seed {data.specification.seed}.")
    yield f"Bits are those of {made['instruction_set']}, sonospline {made['sonospline']}, numpy {made['numpy']}."
    yield from (f"Hash of all shards: `{data.manifest['hash']}`.", "")


def _limits(data: DataSet) -> Iterator[str]:
    model = data.specification.model.use
    yield from ("## Limits", "")
    yield f"Tissue answers by the `{model}` model; materials are assumed, not measured. The needle is rigid."
    yield from (
        "Images are synthetic B-mode: nothing is claimed of what is learned of them on real ones.",
        "",
    )


def picture(data: DataSet) -> bytes:
    """Return a picture of some samples: images above, and what is true of them below."""
    chosen = _chosen(data)
    if not chosen:
        return png(np.zeros((1, 1), np.uint8))
    columns = [_column(data, index) for index in chosen]
    gap = np.full((columns[0].shape[0], _GAP, 3), 255, np.uint8)
    parts = [part for column in columns for part in (column, gap)][:-1]
    return png(np.ascontiguousarray(np.concatenate(parts, axis=1)))


def _chosen(data: DataSet) -> list[int]:
    """Samples from all over, each the first one from there to the end of its shard in which the needle is seen."""
    found: list[int] = []
    for first in range(0, len(data), -(-len(data) // _SHOWN)):
        rows = [row for row in data.sound_rows(first // data.specification.shard) if row["index"] >= first]
        rows = [row for row in rows if row["index"] not in found]
        found += [row["index"] for row in sorted(rows, key=lambda row: not row["needle_px"])[:1]]
    return found


def _column(data: DataSet, index: int) -> NDArray[np.uint8]:
    sample = data.sample(index)
    grey = np.repeat(sample["image"][..., None], 3, axis=2)
    true = grey.astype(np.float32)
    if "labels" in sample:
        colours = _colours(max(data.labels) + 1)
        over = colours[sample["labels"]].astype(np.float32)
        known = (sample["labels"] > 0)[..., None]
        true = np.where(known, (1 - _OVER) * true + _OVER * over, true)
    if "needle" in sample:
        true[sample["needle"] > 0] = _NEEDLE
    gap = np.full((_GAP, grey.shape[1], 3), 255, np.uint8)
    return np.concatenate([grey, gap, np.rint(true).astype(np.uint8)])


def _colours(count: int) -> NDArray[np.uint8]:
    """Hues as far from each other as the golden ratio leaves them."""
    hue = (np.arange(count) * 0.61803398875 % 1.0)[:, None] * 6
    channels = np.clip(np.abs((hue + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1, 0, 1)
    return (60 + 180 * channels).astype(np.uint8)
