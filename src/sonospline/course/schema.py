"""The JSON schema of what a trainer's page says and hears; ``python -m sonospline.course.schema`` writes it."""

from __future__ import annotations

from typing import Any

from ..server import wire
from ..server.schema import FILE as PROTOCOL_FILE
from ..server.schema import schema_of, text
from . import trainer_messages

FILE = PROTOCOL_FILE.with_name("trainer.schema.json")


def trainer_schema() -> dict[str, Any]:
    """Return the JSON schema of all messages: texts both ways, and the headers of binary messages."""
    return schema_of(
        "TrainerProtocol", "What the trainer's page and the server say to each other",
        {
            "server": trainer_messages.Said, "client": trainer_messages.Message, "frame": wire.FrameHeader,
            "thumb": trainer_messages.ThumbHeader,
        },
    )  # fmt: skip


if __name__ == "__main__":
    from ..io.writing import write_text

    write_text(FILE, text(trainer_schema()))
