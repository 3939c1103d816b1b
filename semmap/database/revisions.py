"""Which revision a database has and which is the newest; cheap, for each start asks it."""

from __future__ import annotations

import ast
from pathlib import Path

from sqlalchemy import Engine
from sqlalchemy.exc import ProgrammingError

from semmap.database.error import DatabaseError
from semmap.database.files import migrations_folder

__all__ = ["VERSION_SCHEMA", "VERSION_TABLE", "installed", "newest"]

VERSION_TABLE = "semmap_version"
VERSION_SCHEMA = "public"
"""Not in `semmap`, for a revision may rename that schema."""


def installed(engine: Engine) -> str | None:
    """The revision that the database has; None where there is no schema yet.

    Raises
    ------
    DatabaseError
        The user may not know.
    """
    with engine.connect() as connection:
        try:
            version = connection.exec_driver_sql(
                f"SELECT version_num FROM {VERSION_SCHEMA}.{VERSION_TABLE}"
            ).scalar()
        except ProgrammingError as error:
            if getattr(error.orig, "sqlstate", None) == "42P01":  # undefined_table
                return None
            raise DatabaseError(f"the schema's revision cannot be read: {error.orig}") from error
    return None if version is None else str(version)


def newest() -> str:
    """The revision that no other one follows.

    Read off the files without Alembic, whose import takes longer than all else that a start does.

    Raises
    ------
    DatabaseError
        There is none, or more than one.
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
    for node in ast.parse(path.read_bytes()).body:
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        if isinstance(value, ast.Constant) and isinstance(value.value, str):
            found.update({t.id: value.value for t in targets if isinstance(t, ast.Name)})
    return found
