"""Which revision a database has and which is the newest; cheap, for each start asks it."""

from __future__ import annotations

import ast
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psycopg

from semmap.database.error import DatabaseError
from semmap.database.files import migrations_folder, schema_folder
from semmap.database.maps import driver_of
from semmap.syntax_tree import parse_module

if TYPE_CHECKING:
    from sqlalchemy import Engine

VERSION_TABLE = "semmap_version"
VERSION_SCHEMA = "public"
"""Not in `semmap`, for a revision may rename that schema."""

CODE = ("functions/*.sql", "views/*.sql", "roles.sql")
"""The files of `schema/` that are made again at each upgrade."""


def installed(connection: psycopg.Connection[Any]) -> str | None:
    """The revision that the database has; None where there is no schema yet.

    A downgrade drops the functions: without them, a revision is told as ``0001 without functions``;
    with those of another version of semmap, the newest is told as ``0005 with other functions``.
    DatabaseError where the user has no right to read it.
    """
    try:
        with connection.transaction():
            row = connection.execute(
                "SELECT version_num, EXISTS (SELECT FROM pg_proc "
                "WHERE pronamespace = to_regnamespace('semmap')), "
                "obj_description(to_regnamespace('semmap'), 'pg_namespace') "
                f"FROM {VERSION_SCHEMA}.{VERSION_TABLE}"
            ).fetchone()
    except psycopg.errors.UndefinedTable:
        return None
    except psycopg.ProgrammingError as error:
        raise DatabaseError(f"the schema's revision cannot be read: {error}") from error
    if row is None:
        return None
    version, has_code, mark = row
    if not has_code:
        return f"{version} without functions"
    return f"{version} with other functions" if version == newest() and mark != code() else version


def code() -> str:
    """What the comment on the schema says of the functions, views and rights in `schema/`."""
    digest = hashlib.sha256()
    for path in sorted(file for pattern in CODE for file in schema_folder().glob(pattern)):
        digest.update(path.read_bytes())
    return f"semmap's functions {digest.hexdigest()[:16]}"


def installed_on(engine: Engine) -> str | None:
    """The revision of an engine's database; None where there is no schema yet."""
    with engine.connect() as connection:
        return installed(driver_of(connection))


def newest() -> str:
    """The revision that no other one follows; DatabaseError where there is none, or more than one.

    Read off the files without Alembic, whose import takes longer than all else that a start does.
    """
    known = parents()
    heads = sorted(set(known) - {parent for parent in known.values() if parent})
    if len(heads) != 1:
        raise DatabaseError(
            f"{migrations_folder() / 'versions'} has {len(heads)} newest revisions "
            f"({', '.join(heads) or 'none'}); it needs one"
        )
    return heads[0]


def parents() -> dict[str, str | None]:
    """Each known revision with the one that it follows."""
    files = sorted((migrations_folder() / "versions").glob("*.py"))
    stated = (_assignments(path) for path in files)
    return {s["revision"]: s.get("down_revision") for s in stated if s.get("revision")}


def _assignments(path: Path) -> dict[str, str]:
    found = {}
    for node in parse_module(path.read_bytes()).body:
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            found.update({t.id: value.value for t in targets if isinstance(t, ast.Name)})
    return found


class OldSchema(DatabaseError):
    """The database lacks the schema, or has it at a former revision."""


def check_revision(version: str | None) -> None:
    """Refuse a revision of the schema that is not this semmap's.

    OldSchema where there is no schema, or a former one: ``semmap db upgrade`` helps. DatabaseError
    where another semmap made it, a newer one or one from before 0.1.0.
    """
    if version == newest():
        return
    if version is None:
        raise OldSchema(
            "the database has no semmap schema: semmap db upgrade makes it, semmap import FILE, too"
        )
    if version.split(" ")[0] not in parents():
        raise DatabaseError(
            f"the database has the revision {version}, which this semmap does not know: a newer "
            "semmap made it, or one from before 0.1.0, and it takes that one to use it"
        )
    raise OldSchema(
        f"the schema is at revision {version}, this semmap needs {newest()}: run semmap db upgrade"
    )
