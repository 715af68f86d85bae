"""Open a database: SQLite in WAL mode by default, any other by its URL."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, inspect, make_url, select
from sqlalchemy.exc import ArgumentError, DatabaseError, NoSuchModuleError, OperationalError
from sqlalchemy.orm import Session
from sqlalchemy.pool import StaticPool

from common.errors import InvalidValue, NotWritable, StoreError
from services.control.models import SCHEMA_VERSION, Base, DatabaseRow

IN_MEMORY = "sqlite://"
BUSY_TIMEOUT_MS = 5000


class Database:
    """Transactions on one database. Opening it checks that it can be written, by writing.

    Args:
        url: SQLAlchemy URL; `sqlite://` is in memory.

    Raises:
        InvalidValue: Not the URL of a database for which a driver is installed.
        NotWritable: It cannot be opened and written.
        StoreError: Another version of LEGATO made it.
    """

    def __init__(self, url: str) -> None:
        self._url = _parse(url)
        in_memory = self._url.get_backend_name() == "sqlite" and not self._url.database
        self._engine = _create_engine(self._url, in_memory=in_memory)
        self._writing = self._engine.execution_options(writes=True)
        # In memory there is one connection for all threads: one transaction at a time.
        self._turn = threading.RLock() if in_memory else nullcontext()
        try:
            self._prepare()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    @contextmanager
    def read(self) -> Generator[Session, None, None]:
        """A transaction that sees one state of the database."""
        with self._turn, self._translated(), Session(self._engine) as session:
            yield session

    @contextmanager
    def write(self) -> Generator[Session, None, None]:
        """A transaction that is written as a whole when the block ends, or not at all."""
        with self._turn, self._translated(), Session(self._writing) as session, session.begin():
            yield session

    @contextmanager
    def _translated(self) -> Generator[None, None, None]:
        try:
            yield
        except DatabaseError as error:
            # Its subclasses but one tell of mistakes of our own, not of the place it is in.
            if type(error) not in (DatabaseError, OperationalError):
                raise
            raise NotWritable(self._name, str(error.orig)) from error

    @property
    def _name(self) -> str:
        return self._url.render_as_string(hide_password=True)

    def _prepare(self) -> None:
        """Create or check the tables, and leave a mark: only writing shows that one can."""
        with self.write() as session:
            connection = session.connection()
            if inspect(connection).has_table(DatabaseRow.__tablename__):
                self._check_version(session.scalar(select(DatabaseRow.schema_version)))
            Base.metadata.create_all(connection)
            session.merge(
                DatabaseRow(id=1, schema_version=SCHEMA_VERSION, opened_at=datetime.now(UTC))
            )

    def _check_version(self, version: int | None) -> None:
        if version != SCHEMA_VERSION:
            raise StoreError(
                f"{self._name} has schema version {version}",
                expected=f"expected version {SCHEMA_VERSION}",
                action="use the LEGATO that made it, or another --data folder",
            )


def database_url(data: Path) -> str:
    """URL of the SQLite file in a data folder, which is made if it is not there.

    Raises:
        NotWritable: The folder cannot be made.
    """
    try:
        data.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise NotWritable(str(data), error.strerror or str(error)) from error
    return f"sqlite:///{data / 'legato.db'}"


def _parse(url: str) -> URL:
    try:
        return make_url(url)
    except ArgumentError as error:
        # Not the value itself: it may hold a password.
        raise InvalidValue("--database", "(not a URL)", "e.g. sqlite:///runs/legato.db") from error


def _create_engine(url: URL, *, in_memory: bool) -> Engine:
    options: dict[str, Any] = {}
    if in_memory:
        options = {"poolclass": StaticPool, "connect_args": {"check_same_thread": False}}
    try:
        engine = create_engine(url, **options)
    except (NoSuchModuleError, ModuleNotFoundError) as error:
        name = url.render_as_string(hide_password=True)
        raise InvalidValue("--database", name, f"an installed driver ({error})") from error
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _set_up_sqlite(connection: sqlite3.Connection, _: object) -> None:
    # The driver's own idea of when a transaction begins would split them.
    connection.isolation_level = None
    for pragma in (
        f"busy_timeout = {BUSY_TIMEOUT_MS}",
        "journal_mode = WAL",
        "synchronous = NORMAL",
        "foreign_keys = ON",
    ):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    # A reader that turns writer after another one wrote would fail: writers begin as such.
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
