"""The reading part of a map: its entities by name, questions, changes, SQL and the ORM."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import datetime
from typing import TYPE_CHECKING, Any, cast

import psycopg
from psycopg import errors
from psycopg.pq import TransactionStatus

from semmap.api.checked import EntityName, forms_of, taken
from semmap.api.map_entity import Door, MapEntity
from semmap.database.error import DatabaseError
from semmap.database.maps import see_map
from semmap.database.sure_connection import (
    HAPPENED,
    NotWrittenError,
    SureConnection,
    UnsettledError,
)
from semmap.error import InvalidArgumentError
from semmap.query import entity_query
from semmap.query.entity_query import Near
from semmap.query.refusal import refusal_text, refused
from semmap.query.snapshot import Snapshot, open_snapshot
from semmap.suggestions import suggestion

if TYPE_CHECKING:
    from sqlalchemy import Engine
    from sqlalchemy.orm import Session

    from semmap.api.database import Database
    from semmap.api.map import Map
    from semmap.query.map_check.rules import Finding
    from semmap.query.sql_statement import SqlRows

ATTEMPTS = 5
"""How often a single statement is tried that PostgreSQL ends for the locks of other sessions."""


class MapQuestions:
    """The part of `Map` that reads."""

    def __init__(self, database: Database, name: str) -> None:
        self.database, self.name = database, name
        self._begun: SureConnection | None = None  # whose transaction is open

    def __getitem__(self, name: EntityName) -> MapEntity:
        """The entity of a name; LookupError names those that come near it."""
        rows = self._rows(
            "SELECT id, kind, name FROM entity WHERE map_id = current_map() AND name = %s", name
        )
        if not rows:
            entity_query.entity_id(self.connection, name)  # raises
        return self.entity(*rows[0])

    def __contains__(self, name: object) -> bool:
        """Whether a name, or an entity, is in the map."""
        if isinstance(name, MapEntity):
            return name.map.database is self.database and self._has("id", name.id)
        return isinstance(name, str) and "\0" not in name and self._has("name", name)

    def _has(self, column: str, value: Any) -> bool:
        known = f"SELECT EXISTS (SELECT FROM entity WHERE map_id = current_map() AND {column} = %s)"
        return bool(self._rows(known, value)[0][0])

    def __iter__(self) -> Iterator[MapEntity]:
        """Each entity, by name."""
        return iter(self.find())

    def __len__(self) -> int:
        """How many entities there are."""
        return int(self._rows("SELECT count(*) FROM entity WHERE map_id = current_map()")[0][0])

    def __repr__(self) -> str:
        return f"<map {self.name}>"

    # --- questions

    def find(
        self,
        type: str | None = None,
        *,
        in_: EntityName | None = None,
        label: str | None = None,
        where: Mapping[str, Any] | None = None,
        near: Near | None = None,
        within: float | None = None,
        box: Sequence[float] | None = None,
        name: str | None = None,
        on: EntityName | None = None,
        limit: int | None = None,
    ) -> list[MapEntity]:
        """The entities that meet all conditions; with `near`, the nearest first, else by name.

        It is one statement; to print them needs no more.

        Parameters
        ----------
        type : a semantic type; its subtypes count
        in_ : name of an entity that holds them, directly or not
        where : values of its properties
        label : the property label of the entity or of its type, such as ``kitchen``
        near : a point (x, y, z) in the map's frame, metres, or the name of an entity: its origin
        within : metres from `near` to the entity's shape: to its triangles, not to its box. It is 0
            inside of a room, a region or a closed mesh. Without geometry: to its origin
        box : (x0, y0, z0, x1, y1, z1), metres: the entity's 3D box meets it
        name : the name, or a pattern in which ``*`` is any text and ``?`` any character

        Raises
        ------
        LookupError, ValueError
            As `semmap.query.entity_query.find`.
        """
        rows = entity_query.find(
            self._seen,
            type=type,
            holder=in_,
            label=label,
            where=where,
            near=near,
            within=within,
            box=box,
            name=name,
            on=on,
            limit=limit,
        )
        return [self.entity(row["id"], row["kind"], row["name"]) for row in rows]

    def table(
        self, type: str | None = None, *, in_: str | None = None, **conditions: Any
    ) -> list[dict[str, Any]]:
        """As `find`, but plain rows, as ``semmap ls --json`` prints them."""
        forms = forms_of(MapQuestions.find)
        conditions = {name: taken(name, forms, value) for name, value in conditions.items()}
        rows = entity_query.find(self._seen, type=type, holder=in_, **conditions)
        return [{key: value for key, value in row.items() if key != "id"} for row in rows]

    def describe(self, name: EntityName, at: datetime | None = None) -> dict[str, Any]:
        """All that the map has of an entity.

        `at`: a time; where the entity was then, too.
        """
        return entity_query.describe(self._seen, name, at)

    def types(self) -> list[dict[str, Any]]:
        """The semantic types with their parents, and how many entities of the map are of each."""
        return entity_query.list_types(self._seen)

    def incomplete(self) -> list[dict[str, Any]]:
        """The entities that lack geometry, type, placement or topology."""
        return entity_query.list_incomplete(self._seen)

    def guessed_types(self) -> list[dict[str, Any]]:
        """The entities whose type an import guessed from a name, the least certain first."""
        return entity_query.list_guessed_types(self._seen)

    def check(self) -> list[Finding]:
        """Where the map disagrees with itself and with physics, the gravest first.

        It judges by poses, meshes, stated voxels and outlines of rooms, not by the holders that
        were derived of them. An error makes answers wrong; warnings and notes are for you to judge.
        A finding has its kind, severity, the names of entities, a sentence, and its fix.
        """
        from semmap.api.voxel_check import check_voxels
        from semmap.query.map_check.rules import check_map

        with self.snapshot() as seen:
            return [*check_voxels(seen), *check_map(seen)]

    def fix(self, findings: Iterable[Finding]) -> int:
        """Derive stale data again, by the findings of `check`; no entity moves.

        Returns how many fixes were run. The others are for you: each finding has its call.
        """
        safe = [finding.fix for finding in findings if finding.safe]
        with self.transaction():
            for statement in safe:
                self._write(statement)
        return len(safe)

    def entity(self, id: int, kind: str, name: str) -> MapEntity:
        """The entity of a row of the database, without a statement; a connector is a `Door`."""
        made = Door if kind == "connector" else MapEntity
        return made(cast("Map", self), id, kind, name)

    # --- for SQL and the ORM

    def execute(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        """The rows of a SQL statement (psycopg's ``%s`` for values); tables have all maps.

        It may write: without ``WHERE map_id = current_map()``, it changes all maps; `sql` has the
        views of this map alone. Outside of transactions, a statement that PostgreSQL ends because
        of a deadlock or a lock that is not free in time is tried five times. If the connection is
        lost, nobody knows whether such a statement was done; of a `transaction`, semmap finds out.

        Raises
        ------
        ValueError
            The statement is wrong, or breaks a rule of the map; it changed nothing.
        """
        try:
            return self._rows(statement, *values)
        except (psycopg.OperationalError, DatabaseError):
            HAPPENED.commits += not HAPPENED.open  # perhaps: so it is not done again
            raise

    def _write(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        """As `execute`, in a transaction."""
        return self._rows(statement, *values, around=self.transaction)

    def _rows(
        self,
        statement: str,
        *values: Any,
        around: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> list[tuple[Any, ...]]:
        """As `execute`, of a statement that reads."""
        session = self.connection
        attempts = ATTEMPTS if session.info.transaction_status == TransactionStatus.IDLE else 1
        while True:
            attempts -= 1
            try:
                with around():
                    cursor = session.execute(statement, values or None)
                    return cursor.fetchall() if cursor.description else []
            except (
                errors.DeadlockDetected,
                errors.SerializationFailure,
                errors.LockNotAvailable,  # the next attempt ends a robot that is in the way
            ):
                if not attempts:
                    raise
            except errors.InsufficientPrivilege:
                raise
            except psycopg.Error as error:
                told = refused(error)
                if told is None and isinstance(error, psycopg.ProgrammingError):
                    told = InvalidArgumentError(refusal_text(error))
                if told is None:
                    raise
                raise told from error

    def sql(
        self, statement: str, *values: Any, write: bool = False, rows: int | None = None
    ) -> SqlRows:
        """Run a SQL statement that reads, unless `write` is True; tables have all maps.

        The views ``entry`` (a row for each entity), ``object`` (one for each of its types, with
        supertypes), ``incomplete`` and ``guessed_type`` have this map alone. Tables, and all other
        views, have all maps of the database: add ``WHERE map_id = current_map()``. Join a table
        that has no `map_id` with `entity`; the views for GIS have `map`, the name. Without the
        condition, an UPDATE or DELETE changes all maps. ``entity_id('mug1')`` is of this map.

        On the embedded database it reads with a login that can only read. In a transaction of this
        map it reads the changes of the transaction. Returns the rows, a sequence of tuples;
        `columns` has their names. Where a statement returns none, the column `rows` says how many
        rows it changed.

        Parameters
        ----------
        statement : a statement of PostgreSQL, with psycopg's ``%s`` for each of `values`; where
            there are no values, it is run as it stands
        write : let the statement change the map; all of it or nothing
        rows : refuse an answer of more rows, of a statement that reads

        Raises
        ------
        ValueError
            The statement is wrong or not allowed; it changed nothing. The driver's error is its
            cause.
        """
        if write:
            return sql_rows(self.connection, statement, values, write=True)
        with self.reading() as session:
            return sql_rows(session, statement, values, write=False, most=rows)

    @contextmanager
    def reading(self) -> Iterator[psycopg.Connection[Any]]:
        """A psycopg connection for questions: ``current_map()`` is this map, tables have all maps.

        On the embedded database, its login can only read. Within a transaction of `connection`, it
        is that connection.
        """
        opened: SureConnection | None = vars(self).get("_writer")
        begun = opened and opened.info.transaction_status != TransactionStatus.IDLE
        yield opened if opened and begun else self._reader()

    def _reader(self) -> psycopg.Connection[Any]:
        from semmap.database.reading_login import reading_session

        session: psycopg.Connection[Any] | None = vars(self).get("_reading")
        if session is None or session.closed:
            self.database._release_idle(self)
            session = reading_session(self.database.session)
            if session is None:
                return self.connection
            see_map(session, self.name, lasting=True)
            vars(self)["_reading"] = session
        return session

    def check_type(self, type: str, remedy: str = "semmap types lists them") -> None:
        """Refuse a semantic type that the map does not have.

        LookupError names the types that come near it, and the `remedy`.
        """
        if not self._rows("SELECT 1 FROM semantic_type WHERE name = %s", type):
            names = [row[0] for row in self._rows("SELECT name FROM semantic_type")]
            hint = suggestion(type, names, "semmap types lists them")
            remedy = "" if remedy in hint else f"; {remedy}"
            raise LookupError(f"the map has no type {type}{hint}{remedy}")

    @contextmanager
    def transaction(self) -> Iterator[Any]:
        """A transaction: all statements in the ``with`` block, or none.

        Where the connection breaks during the commit, it asks the server whether it was done.

        Raises
        ------
        DatabaseError
            The connection was lost, and nothing was written; or no server could be asked for a
            minute. A method of semmap that wrote nothing yet is tried again, unless a transaction
            is open.
        """
        begun, self._begun = self._begun, self._begun or self.connection
        try:
            with self._begun.transaction() as made:
                yield made
        except (NotWrittenError, UnsettledError) as error:
            raise DatabaseError(str(error)) from error
        finally:
            self._begun = begun

    def session(self) -> Session:
        """A SQLAlchemy session, for a ``with`` block; tables have all maps, as in `sql`.

        Its classes are of tables: state ``Object.map_id == func.current_map()`` in queries.
        """
        from semmap.model.session import map_session

        return map_session(self.database.engine, self.name)

    @property
    def connection(self) -> SureConnection:
        """The psycopg connection of this map, with autocommit; tables have all maps.

        One that the server left is opened again, unless a transaction is open.
        """
        if self._begun is not None:
            return self._begun
        session: SureConnection | None = vars(self).get("_writer")
        if session is None or session.closed:
            self.database._release_idle(self)
            session = self.database.session.twin()
            see_map(session, self.name, lasting=True)
            vars(self)["_writer"] = session
        return session

    @property
    def _seen(self) -> Snapshot:
        """What this connection sees: each statement, or transaction, the newest state."""
        return Snapshot(self.connection, self.name)

    @contextmanager
    def _change(self) -> Iterator[Snapshot]:
        """What a transaction of this map's connection sees, in which the map is changed."""
        with self.transaction(), self.snapshot() as seen:
            yield seen

    def snapshot(self) -> AbstractContextManager[Snapshot]:
        """One state of the map while a ``with`` block lasts, for readers of other packages."""
        return open_snapshot(self.connection, self.name)

    @property
    def engine(self) -> Engine:
        """The engine of the database."""
        return self.database.engine

    @property
    def _sessions(self) -> list[psycopg.Connection[Any]]:
        """The connections of this map that are open now."""
        return [vars(self)[name] for name in ("_reading", "_writer") if name in vars(self)]

    @property
    def in_transaction(self) -> bool:
        """Whether a transaction of this map is open."""
        return self.connection.info.transaction_status != TransactionStatus.IDLE

    def close(self) -> None:
        """Close the map's connections; they are opened again when they are used."""
        for name in ("_reading", "_writer"):
            if name in vars(self):
                getattr(self, name).close()
                del vars(self)[name]


def sql_rows(
    session: psycopg.Connection[Any],
    statement: str,
    values: tuple[Any, ...],
    *,
    write: bool,
    most: int | None = None,
) -> SqlRows:
    """Run a statement on a session as `MapSql.sql` does."""
    from semmap.query.sql_statement import SUPERUSER_NOTE, SqlRows, is_superuser, run_sql

    notes = (SUPERUSER_NOTE,) if not write and is_superuser(session) else ()
    columns, rows = run_sql(session, statement, values, write=write, most=most)
    return SqlRows(tuple(columns), tuple(rows), notes)


def aware(at: datetime | None) -> datetime | None:
    """A moment with a time zone, by default that of the machine; None stays."""
    return at if at is None or at.tzinfo else at.astimezone()
