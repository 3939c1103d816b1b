"""The Unix socket of the embedded server: where it lies, and whether someone answers there."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import socket
import stat
from pathlib import Path

from semmap.database.account import Account
from semmap.database.error import DatabaseError
from semmap.database.folder import open_folder
from semmap.temporary_folder import temporary_parent

PORT = 5432

PATH_LIMIT = 103
"""Bytes that the path of a Unix socket may have (107 on Linux, 103 on macOS)."""

PLAIN = re.compile(r"[\w./+@~-]+")
"""Paths that neither libpq nor PostgreSQL's lists of folders take for more than one."""


def make_socket_folder(home: Path, owner: Account) -> Path:
    """A folder for the socket that only the server's user (and root) can enter.

    It lies below the cluster's folder, or, where that path will not do for a socket, in the folder
    for temporary files. (Not in XDG_RUNTIME_DIR, which goes away when the user logs out.)
    DatabaseError where it is there already, but is not what it has to be.
    """
    folder = home / "run"
    if not _fits(folder):
        key = hashlib.sha256(os.fsencode(home)).hexdigest()[:12]
        folder = temporary_parent() / f"semmap-{owner.uid}-{key}"
        if not _fits(folder):
            folder = Path("/tmp") / folder.name
    with contextlib.suppress(FileExistsError), open_folder(folder.parent) as parent:
        parent.make_folder(folder.name, owner)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != owner.uid or found.st_mode & 0o077:
        raise DatabaseError(
            f"{folder}, where the database's socket has to lie, is not a folder that only "
            f"{owner.name} can enter; remove it and call again"
        )
    return folder


def answers(folder: Path) -> bool:
    """Whether a server listens on the socket in `folder`."""
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(_socket(folder)))
        except OSError:
            return False
    return True


def lock_file(folder: Path) -> Path:
    """The file in which the server that made the socket in `folder` states its number."""
    return folder / f".s.PGSQL.{PORT}.lock"


def _socket(folder: Path) -> Path:
    return folder / f".s.PGSQL.{PORT}"


def _fits(folder: Path) -> bool:
    path = str(_socket(folder))
    return len(os.fsencode(path)) <= PATH_LIMIT and PLAIN.fullmatch(path) is not None
