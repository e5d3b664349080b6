"""The tables of the lab's database, and which version of them it has."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from .._extras import require

VERSION = "3"
"""Of the tables; a database of another one is refused."""
LACKS_TABLES = ("1", "2")
"""Versions that only lack tables of this one, and get them: 1 has no comments, 2 has no keys."""
LONGEST_NAME = 200
LONGEST_CODE = 16
LONGEST_COMMENT = 500


class Schema(NamedTuple):
    """The tables, of SQLAlchemy."""

    metadata: Any
    about: Any
    groups: Any
    participants: Any
    sessions: Any
    exercises: Any
    recordings: Any
    attempts: Any
    metrics: Any
    comments: Any
    keys: Any

    def __repr__(self) -> str:
        return f"Schema(version {VERSION}, {len(self.metadata.tables)} tables)"


@cache
def schema() -> Schema:
    """Return the tables.

    Raises
    ------
    MissingExtraError
        SQLAlchemy is not installed: ``pip install 'sonospline[lab]'``.
    """
    sql = require("sqlalchemy")
    metadata = sql.MetaData()

    def table(name: str, *columns: Any) -> Any:
        return sql.Table(name, metadata, sql.Column("id", sql.Integer, primary_key=True), *columns)

    def name(*, unique: bool = False) -> Any:
        return sql.Column("name", sql.String(LONGEST_NAME), nullable=False, unique=unique)

    def content_hash(*, unique: bool = False) -> Any:
        return sql.Column("content_hash", sql.String(32), nullable=False, unique=unique)

    def key(of: str, *, needed: bool) -> Any:
        return sql.Column(f"{of}_id", sql.ForeignKey(f"{of}s.id"), nullable=not needed)

    def value(name: str, kind: Any) -> Any:
        return sql.Column(name, kind, nullable=False)

    about = sql.Table(
        "about", metadata, sql.Column("key", sql.String(40), primary_key=True), value("value", sql.String(LONGEST_NAME))
    )
    groups = table("groups", name(unique=True))
    participants = table(
        "participants",
        sql.Column("code", sql.String(LONGEST_CODE), nullable=False, unique=True),
        key("group", needed=False),
    )
    sessions = table("sessions", name(unique=True), value("began", sql.DateTime))
    exercises = table("exercises", name(), content_hash(), sql.UniqueConstraint("name", "content_hash"))
    recordings = table("recordings", name(), content_hash(unique=True))
    attempts = table(
        "attempts", key("participant", needed=True), key("exercise", needed=True), key("session", needed=False),
        key("recording", needed=False), value("seed", sql.BigInteger), value("began", sql.DateTime),
        value("ended", sql.String(40)), value("passed", sql.Boolean), value("verdict", sql.Text),
        value("seconds", sql.Float), sql.Index("attempts_by_participant", "participant_id", "exercise_id", "id"),
        sql.Index("attempts_by_time", "began"),
    )  # fmt: skip
    metrics = sql.Table(
        "metrics", metadata,
        sql.Column("attempt_id", sql.ForeignKey("attempts.id"), primary_key=True),
        sql.Column("name", sql.String(60), primary_key=True), value("value", sql.Float),
    )  # fmt: skip
    comments = table(
        "comments", sql.Column("attempt_id", sql.ForeignKey("attempts.id"), nullable=False, index=True),
        value("time_s", sql.Float), value("text", sql.Text),
    )  # fmt: skip
    keys = sql.Table(
        "keys", metadata, sql.Column("key", sql.String(LONGEST_NAME), primary_key=True), value("number", sql.Integer)
    )
    return Schema(
        metadata, about, groups, participants, sessions, exercises, recordings, attempts, metrics, comments, keys
    )
