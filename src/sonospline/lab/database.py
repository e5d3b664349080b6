"""A connection to the lab's database, and what goes wrong with one in a line each."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from .._extras import require
from .._shown import shown
from .schema import LACKS_TABLES, VERSION, schema

T = TypeVar("T")

_READS = {"reads": True}
_WAIT_S = 20
"""For another process that writes."""
_OF_VALUES = ("22", "23")
"""Classes of SQLSTATE: a value that cannot be, or that breaks a rule of the tables."""


class LabDatabaseError(RuntimeError):
    """The database is away, full, or not the lab's."""


class LabDataError(LabDatabaseError):
    """The database does not take what it is given, however often it is tried."""


class Database:
    """An engine of SQLAlchemy with the lab's tables in it.

    Parameters
    ----------
    address : str or Path
        A file for SQLite, made where there is none, or an address as SQLAlchemy takes it.

    Raises
    ------
    ValueError
        No address of a database.
    LabDatabaseError
        It cannot be reached, or its tables are of another version.
    MissingExtraError
        ``pip install 'sonospline[lab]'``.
    """

    def __init__(self, address: str | Path) -> None:
        self.sql = require("sqlalchemy")
        self._url = self._address(address)
        self._is_sqlite = self._url.get_backend_name() == "sqlite"
        self.name = Path(self._url.database).name if self._is_sqlite else self._url.render_as_string(hide_password=True)
        """A file without its folder, an address without its password."""
        options: dict[str, Any] = {"timeout": _WAIT_S} if self._is_sqlite else {}
        self._interface_errors: tuple[type[Exception], ...] = ()
        with self._said():
            self._engine = self.sql.create_engine(self._url, connect_args=options, pool_pre_ping=True)
        self._interface_errors = (self._engine.dialect.loaded_dbapi.Error,)  # of a first connection, unwrapped
        if self._is_sqlite:
            self.sql.event.listen(self._engine, "connect", _as_one_writes)
            self.sql.event.listen(self._engine, "begin", _to_write)
        with self._said():
            self._make()

    @contextmanager
    def reading(self) -> Iterator[Any]:
        """A connection to ask; what others write meanwhile is not seen.

        Raises
        ------
        LabDatabaseError
            The database is away.
        """
        with self._said(), self._engine.connect().execution_options(**_READS) as connection, connection.begin():
            yield connection

    def write(self, work: Callable[[Any], T]) -> T:
        """Do some work on a connection and keep all of it, or nothing; return its answer.

        A second time where another writer has made the same row meanwhile.

        Raises
        ------
        LabDatabaseError
            The database is away or full.
        LabDataError
            It takes no such values.
        """
        with self._said():
            try:
                with self._engine.begin() as connection:
                    return work(connection)
            except self.sql.exc.IntegrityError:
                with self._engine.begin() as connection:
                    return work(connection)

    def close(self) -> None:
        """Leave the database."""
        self._engine.dispose()

    def _address(self, address: str | Path) -> Any:
        if isinstance(address, Path) or "://" not in str(address):
            path = Path(address)
            if not path.parent.is_dir():
                raise ValueError(f"database = {shown(str(address))}: there is no folder {path.parent}; make it first")
            if path.is_dir():
                raise ValueError(f"database = {shown(str(address))} is a folder; give a file in it, e.g. course.db")
            return self.sql.URL.create("sqlite", database=str(path))
        try:
            url = self.sql.make_url(address)
            url.get_dialect()
        except (self.sql.exc.ArgumentError, self.sql.exc.NoSuchModuleError):
            kind = str(address).partition("://")[0]
            raise ValueError(
                f"database: {shown(kind)}:// is no address that SQLAlchemy knows; give a file, or "
                "postgresql+pg8000://user@host/name"
            ) from None
        return url

    def _make(self) -> None:
        tables = schema()
        with self._engine.begin() as connection:
            if not self._is_sqlite:
                connection.exec_driver_sql("SELECT pg_advisory_xact_lock(7353)")  # two that come first, at once
            names = set(self.sql.inspect(connection).get_table_names())
            if "about" not in names:
                if names:
                    raise LabDatabaseError(
                        f"{self.name} holds tables of something else ({', '.join(sorted(names)[:3])}); give another one"
                    )
                tables.metadata.create_all(connection)
                connection.execute(tables.about.insert(), [{"key": "version", "value": VERSION}])
                return
            about = tables.about
            found = connection.scalar(self.sql.select(about.c.value).where(about.c.key == "version"))
            if found in LACKS_TABLES:
                tables.metadata.create_all(connection)
                connection.execute(about.update().where(about.c.key == "version").values(value=VERSION))
                return
        if found != VERSION:
            raise LabDatabaseError(
                f"{self.name} has tables of version {found}, this sonospline reads {VERSION}; export it with the one "
                "that wrote it, or give another file"
            )

    @contextmanager
    def _said(self) -> Iterator[None]:
        """Errors of drivers in one line, without the address's password."""
        try:
            yield
        except (self.sql.exc.SQLAlchemyError, ModuleNotFoundError, *self._interface_errors) as error:
            kind = LabDataError if self._is_of_values(error) else LabDatabaseError
            raise kind(f"{self.name}: {_reason(error)}") from None

    def _is_of_values(self, error: Exception) -> bool:
        errors = self.sql.exc
        return isinstance(error, errors.DataError | errors.IntegrityError) or _sqlstate(error)[:2] in _OF_VALUES

    def __repr__(self) -> str:
        return f"Database({self.name!r})"


def _as_one_writes(connection: Any, _: Any) -> None:
    """Readers do not wait for a writer; SQLAlchemy begins transactions, not the driver."""
    connection.isolation_level = None
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA foreign_keys=ON")


def _to_write(connection: Any) -> None:
    """A transaction that first reads and then writes would fail where another wrote between."""
    connection.exec_driver_sql("BEGIN" if connection.get_execution_options().get("reads") else "BEGIN IMMEDIATE")


def _sqlstate(error: Exception) -> str:
    """The code of PostgreSQL's error, as psycopg or pg8000 has it; empty of others."""
    cause = getattr(error, "orig", None)
    said = cause.args[0] if cause is not None and cause.args else None
    return str(getattr(cause, "sqlstate", None) or (said.get("C", "") if isinstance(said, dict) else ""))


def _reason(error: Exception) -> str:
    cause = getattr(error, "orig", None) or error
    if isinstance(cause, ModuleNotFoundError):
        return f"its driver {cause.name} is not installed; give postgresql+pg8000:// (extra lab)"
    text = " ".join(str(cause).split())
    if "full" in text or "No space" in text:
        return "its disk is full; nothing was kept of this attempt"
    found = re.search(r"'M': '([^']*)'", text)  # as pg8000 says what PostgreSQL says
    return (found[1] if found else text)[:160] or type(cause).__name__
