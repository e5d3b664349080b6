"""The JSON schema of what page and server say to each other; ``python -m sonospline.server.schema`` writes it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from . import client_messages, server_messages, wire

FILE = Path(__file__).parents[3] / "web" / "protocol.schema.json"
"""Where the page's build looks for it; it is kept with the sources."""
_SAID = {
    "server": server_messages.Said, "client": client_messages.Message, "frame": wire.FrameHeader,
    "geometry": wire.GeometryHeader,
}  # fmt: skip


def protocol_schema() -> dict[str, Any]:
    """Return the JSON schema of all messages: texts both ways, and the headers of binary messages."""
    return schema_of("Protocol", "What page and server say to each other", _SAID)


def schema_of(title: str, what: str, messages: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of some kinds of messages by what they are."""
    said, parts = msgspec.json.schema_components(list(messages.values()), ref_template="#/$defs/{name}")
    for part in parts.values():
        if "properties" in part:  # whatever is said is said whole, defaults too
            part["required"] = list(part["properties"])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": title, "type": "object",
        "description": f"{what}, version {server_messages.PROTOCOL}.",
        "properties": dict(zip(messages, said, strict=True)), "required": list(messages),
        "additionalProperties": False,
        "$defs": dict(sorted(parts.items())),
    }  # fmt: skip


def text(schema: dict[str, Any]) -> str:
    """Return a schema as its file holds it."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    from ..io.writing import write_text  # the server says the schema and writes nothing

    write_text(FILE, text(protocol_schema()))
