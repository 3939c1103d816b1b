"""What a server that was killed leaves behind: orphaned processes, and a file with its number."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path

from semmap.database.account import server_account
from semmap.database.error import DatabaseError

__all__ = ["clear_leftovers"]

GRACE = 0.5
"""Seconds in which orphans may end by themselves, as idle ones do at once."""

PATIENCE = 60.0
"""Seconds for a server that is starting, recovering or stopping to be done."""


def clear_leftovers(data: Path) -> bool:
    """Make way for a new server on a data directory on which none answers.

    Orphans of a killed server are told to quit, which loses nothing that was committed. A server
    that is starting, recovering or stopping is waited for. PostgreSQL itself replaces a stale
    ``postmaster.pid``, except where another process has by now got the number in it: then it is
    removed.

    Returns
    -------
    whether a server lives there after all: one that was only waited for, or lost its socket

    Raises
    ------
    DatabaseError
        Processes hold on to the directory.
    """
    begin = time.monotonic()
    told = False
    while users := _processes_in(data):
        waited = time.monotonic() - begin
        number, state = _postmaster(data)
        if number in users:
            if state == "ready":
                return True
        elif waited > GRACE and not told:
            for pid in users:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGQUIT)
            told = True
        if waited > PATIENCE:
            raise DatabaseError(
                f"the processes {users} hold on to {data}, but no server answers there; "
                f"{data / 'server.log'} may say why. End them and call again"
            )
        time.sleep(0.02)
    number, _ = _postmaster(data)
    if number is not None and Path(f"/proc/{number}").exists():
        (data / "postmaster.pid").unlink(missing_ok=True)
    return False


def _postmaster(data: Path) -> tuple[int | None, str]:
    """Number and state of the server, as ``postmaster.pid`` has it."""
    try:
        lines = (data / "postmaster.pid").read_text().splitlines()
        return int(lines[0]), lines[7].strip() if len(lines) > 7 else ""
    except (FileNotFoundError, ValueError, IndexError):
        return None, ""


def _processes_in(folder: Path) -> list[int]:
    """The processes whose working directory is `folder`, as a server's is its data directory.

    The folder's owner is asked: without the capability to trace, as in a container, even root does
    not see where another's process works.
    """
    if not folder.exists():
        return []
    listing = server_account(folder).run(
        ["find", "/proc", "-maxdepth", "2", "-path", "/proc/[0-9]*/cwd", "-printf", "%h\\t%l\\0"],
        cwd=Path("/"),
    )
    entries = (line.partition("\t") for line in listing.stdout.split("\0"))
    resolved = str(folder.resolve())
    return [int(Path(entry).name) for entry, _, target in entries if target == resolved]
