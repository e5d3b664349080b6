"""The end of a run: what the arrays are, the manifest with the hash of every shard, and the card."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from .._digest import digest
from .card import card, picture
from .croissant import croissant
from .layout import CARD, CROISSANT, MANIFEST, PICTURES
from .reader import DataSet
from .shard import Job, Receipt
from .zarr_form import metadata

_PICTURE = f"{PICTURES}/samples.png"


def finish(job: Job, plan: Mapping[str, Any], receipts: Sequence[Receipt]) -> dict[str, Any]:
    """Write what makes shards a data set; the manifest that names them is last but for what describes it.

    Returns
    -------
    dict
        The manifest.
    """
    asked = job.plan.asked
    manifest = _manifest(job, plan, receipts)
    if asked.storage.form == "zarr":
        about = {"name": asked.name, "labels": dict(job.labels), "licence": asked.licence}
        for name, content in metadata(job.forms, asked.samples, asked.shard, about).items():
            job.place.write(name, content)
    job.place.write(MANIFEST, json.dumps(manifest, indent=1, sort_keys=True).encode())
    data = DataSet(job.place)
    job.place.write(CROISSANT, json.dumps(croissant(data), indent=1).encode())
    shown = None if asked.storage.form == "recipe" or not asked.stored.image else picture(data)
    if shown is not None:
        job.place.write(_PICTURE, shown)
    job.place.write(CARD, card(data, None if shown is None else _PICTURE).encode())
    return manifest


def _manifest(job: Job, plan: Mapping[str, Any], receipts: Sequence[Receipt]) -> dict[str, Any]:
    asked = job.plan.asked
    failed = {index: reason for receipt in receipts for index, reason in receipt.failed.items()}
    splits = Counter[str]()
    for anatomy in range(asked.anatomies):
        first = anatomy * asked.anatomy.samples
        splits[job.plan.split(first)] += min(asked.anatomy.samples, asked.samples - first)
    size = sum(receipt.bytes for receipt in receipts)
    shards = [receipt.as_json() for receipt in receipts]
    return {
        **plan, "name": asked.name, "description": asked.description, "licence": asked.licence,
        "samples": asked.samples, "splits": splits, "failed": failed, "bytes": size,
        "bytes_a_sample": size / asked.samples, "beams": job.beams, "shards": shards,
        "hash": digest([(file, held["sha256"]) for shard in shards for file, held in shard["files"].items()]),
        "arrays": {
            name: {"shape": form.shape, "dtype": form.dtype, "axes": form.axes, "about": form.about,
                   **form.attributes} for name, form in job.forms.items()
        },
    }  # fmt: skip
