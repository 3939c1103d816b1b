"""semmap as it will be with one more revision than `migrations/` has."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from semmap.database import revisions
from semmap.database.files import migrations_folder, schema_folder

REVISION = """
from alembic import op

revision = "next"
down_revision = {newest!r}

def upgrade():
    for statement in {up!r}:
        op.execute(statement)

def downgrade():
    for statement in {down!r}:
        op.execute(statement)
"""


@contextmanager
def next_revision(up: Sequence[str] = (), down: Sequence[str] = ()) -> Iterator[str]:
    """Append a revision that executes `up` and `down`; gives its name, and takes it back."""
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        root = Path(folder)
        (root / "schema").symlink_to(schema_folder())
        versions = shutil.copytree(migrations_folder(), root / "migrations") / "versions"
        stated = REVISION.format(newest=revisions.newest(), up=[*up], down=[*down])
        (versions / "next.py").write_text(stated)
        patch.setattr("semmap.database.files.PLACES", (root / "none", root))
        yield "next"
