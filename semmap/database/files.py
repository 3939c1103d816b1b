"""Where `schema/`, `migrations/` and `docker/` lie: at a checkout's root, or in a wheel."""

from __future__ import annotations

from pathlib import Path

from semmap.database.error import DatabaseError

PACKAGE = Path(__file__).resolve().parents[1]
PLACES = (PACKAGE / "_data", PACKAGE.parent)
"""The folder that a wheel brings; a checkout's root."""


def schema_folder() -> Path:
    """The folder of the schema's SQL (``tables/``, ``functions/``, ``views/``, ``ontology/``)."""
    return _folder("schema", "tables")


def migrations_folder() -> Path:
    """The folder of the Alembic environment (``env.py``, ``versions/``)."""
    return _folder("migrations", "env.py")


def image_folder() -> Path:
    """The folder from which the database's image is built (``Dockerfile``, ``entrypoint``)."""
    return _folder("docker/postgis", "Dockerfile")


def _folder(name: str, mark: str) -> Path:
    for place in PLACES:
        if (place / name / mark).exists():
            return place / name
    raise DatabaseError(
        f"{name}/ is not there, neither in {PLACES[0]} nor in {PLACES[1]}: "
        "semmap is not completely installed; install it again"
    )
