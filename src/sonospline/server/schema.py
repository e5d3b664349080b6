"""The JSON schema of what page and server say to each other; ``python -m sonospline.server.schema`` writes it."""

from __future__ import annotations

import json
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
    said, parts = msgspec.json.schema_components(list(_SAID.values()), ref_template="#/$defs/{name}")
    for part in parts.values():
        if "properties" in part:  # whatever is said is said whole, defaults too
            part["required"] = list(part["properties"])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Protocol", "type": "object",
        "description": f"What page and server say to each other, version {server_messages.PROTOCOL}.",
        "properties": dict(zip(_SAID, said, strict=True)), "required": list(_SAID), "additionalProperties": False,
        "$defs": dict(sorted(parts.items())),
    }  # fmt: skip


def text() -> str:
    """Return the schema as its file holds it."""
    return json.dumps(protocol_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    from ..io.writing import write_text  # the server says the schema and writes nothing

    write_text(FILE, text())
