"""The user that the embedded server runs as: oneself, and another where one is root."""

from __future__ import annotations

import os
import pwd
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from semmap.database.error import DatabaseError

SUBSTITUTES = ("postgres", "nobody")
"""Who runs the server for root, whom PostgreSQL refuses; the first that exists."""


@dataclass(frozen=True)
class Account:
    """A user of this machine, whom programs are run as."""

    name: str
    uid: int
    gid: int

    @property
    def is_caller(self) -> bool:
        """Whether this is who runs this process."""
        return self.uid == os.geteuid()

    def run(
        self,
        command: Sequence[str],
        cwd: Path,
        environment: Mapping[str, str] | None = None,
        **options: Any,
    ) -> subprocess.CompletedProcess[str]:
        """Run a program as this user; `environment` is used where ours lacks a name. In English."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PG", "LC_", "LANG"))}
        if not self.is_caller:
            options |= {"user": self.uid, "group": self.gid, "extra_groups": []}
        try:
            return subprocess.run(
                command,
                cwd=cwd,
                env={**(environment or {}), **kept, "LC_ALL": "C", "HOME": str(cwd)},
                capture_output=True,
                text=True,
                **options,
            )
        except OSError as error:
            raise DatabaseError(
                f"{command[0]} cannot be run as {self.name}: {error}. PostgreSQL refuses to run as "
                "root: call semmap as another user, or name a database: SEMMAP_DB, --db"
            ) from error

    def can_enter(self, folder: Path) -> bool:
        """Whether this user gets into that folder and the ones above it."""
        if self.is_caller:
            return os.access(folder, os.X_OK)
        return self.run(["test", "-x", str(folder)], cwd=Path("/")).returncode == 0


def server_account(data: Path) -> Account:
    """The user that runs the server on a data folder: its owner; the caller if there is none yet.

    For root, the owner of the parent folder, and where that is root too, ``postgres`` or
    ``nobody``. DatabaseError where the folder is another user's, or its user has no name on this
    machine.
    """
    caller = os.geteuid()
    if data.exists():
        owner = data.stat().st_uid
        if caller not in (0, owner):
            raise DatabaseError(
                f"{data} belongs to {user_name(owner)}. Set SEMMAP_DATA to a folder of your own, "
                "or name a database: SEMMAP_DB, --db"
            )
        return _account(owner)
    if caller != 0:
        return _account(caller)
    if data.parent.exists() and (owner := data.parent.stat().st_uid) != 0:
        return _account(owner)
    for name in SUBSTITUTES:
        try:
            return _account(pwd.getpwnam(name).pw_uid)
        except KeyError:
            continue
    raise DatabaseError(
        f"PostgreSQL refuses to run as root, and there is no user {' or '.join(SUBSTITUTES)}: "
        "useradd --system postgres"
    )


def caller() -> Account:
    """Who runs this process."""
    return Account(user_name(os.geteuid()), os.geteuid(), os.getegid())


def user_name(uid: int) -> str:
    """The name of a user; the number of one that has none."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _account(uid: int) -> Account:
    try:
        entry = pwd.getpwuid(uid)
    except KeyError:
        raise DatabaseError(
            f"the user {uid} has no name in /etc/passwd, which PostgreSQL needs. Add one, "
            "or name a database: SEMMAP_DB, --db"
        ) from None
    return Account(entry.pw_name, entry.pw_uid, entry.pw_gid)
