"""A data set's table in Croissant 1.0, by which search engines and loaders find what is in it."""

from __future__ import annotations

from typing import Any

from .layout import table_name
from .reader import DataSet
from .shard import Receipt
from .table_form import COLUMNS, RECIPE_COLUMNS, is_list, is_real, is_whole

_CONTEXT = {
    "@language": "en", "@vocab": "https://schema.org/", "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/", "sc": "https://schema.org/", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "dataType": {"@id": "cr:dataType", "@type": "@vocab"}, "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject", "fileSet": "cr:fileSet", "includes": "cr:includes", "recordSet": "cr:recordSet",
    "repeated": "cr:repeated", "source": "cr:source",
}  # fmt: skip
_PARQUET = "application/x-parquet"


def croissant(data: DataSet) -> dict[str, Any]:
    """Return the description of a data set's table as JSON-LD holds it.

    Source: Croissant format specification 1.0, MLCommons.
    """
    held = data.manifest
    receipts = [Receipt.of(shard) for shard in held["shards"]]
    tables = [_file(table_name(one.shard), *one.files[table_name(one.shard)]) for one in receipts]
    columns = RECIPE_COLUMNS if data.form == "recipe" else COLUMNS
    return {
        "@context": _CONTEXT, "@type": "sc:Dataset", "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": held["name"], "description": held["description"] or "Synthetic needle insertions under ultrasound.",
        "license": held["licence"], "version": "1.0.0",
        "distribution": [
            *tables,
            {"@type": "cr:FileSet", "@id": "table", "name": "table", "encodingFormat": _PARQUET,
             "containedIn": [{"@id": one["@id"]} for one in tables], "includes": "*.parquet"},
        ],
        "recordSet": [
            {"@type": "cr:RecordSet", "@id": "samples", "name": "samples", "field": [_field(name) for name in columns]}
        ],
    }  # fmt: skip


def _file(name: str, sha256: str, size: int) -> dict[str, Any]:
    """A part of the table."""
    return {
        "@type": "cr:FileObject", "@id": name, "name": name, "contentUrl": name, "contentSize": f"{size} B",
        "encodingFormat": _PARQUET, "sha256": sha256,
    }  # fmt: skip


def _field(name: str) -> dict[str, Any]:
    """A column of the table."""
    kind = "sc:Integer" if is_whole(name) else "sc:Float" if is_real(name) else "sc:Text"
    source = {"fileSet": {"@id": "table"}, "extract": {"column": name}}
    repeated = {"repeated": True} if is_list(name) else {}
    return {"@type": "cr:Field", "@id": f"samples/{name}", "name": name, "dataType": kind, "source": source, **repeated}
