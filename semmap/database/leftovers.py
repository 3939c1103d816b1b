"""What a server that was killed leaves behind: orphaned processes, and its ``postmaster.pid``."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path
from typing import NamedTuple

from semmap.database.account import server_account
from semmap.database.error import DatabaseError
from semmap.database.folder import read_file
from semmap.database.patience import BUSY_SECONDS
from semmap.database.sockets import answers

NAME = "postmaster.pid"

GRACE = 0.5
"""Seconds in which orphans may end by themselves, as idle ones do at once."""

STUBBORN = 5.0
"""Seconds after which orphans are killed, as PostgreSQL itself does after a crash."""

SERVER_PROGRAMS = ("postgres", "postmaster")


class PidFile(NamedTuple):
    """What a server writes of itself; its state is starting, ready, standby, stopping, or empty."""

    pid: int
    socket_folder: Path
    state: str


def read_pid_file(data: Path) -> PidFile | None:
    """What ``postmaster.pid`` in a data directory says; None if there is none to be read."""
    try:
        lines = read_file(data / NAME).splitlines()
        return PidFile(int(lines[0]), Path(lines[4]), lines[7].strip() if len(lines) > 7 else "")
    except (FileNotFoundError, ValueError, IndexError):
        return None


def clear_leftovers(data: Path) -> bool:
    """Make way for a new server on a data directory on which none answers.

    Orphans of a killed server are ended, which loses nothing that was committed. A server that is
    starting, recovering or stopping is waited for. Then ``postmaster.pid`` is removed. True where a
    server lives there after all: one that was only waited for, or lost its socket. DatabaseError
    where processes still use the directory after `BUSY_SECONDS`.
    """
    begin = time.monotonic()
    signals = [(STUBBORN, signal.SIGKILL), (GRACE, signal.SIGQUIT)]
    while servers := servers_in(data):
        waited = time.monotonic() - begin
        file = read_pid_file(data)
        if file is not None and file.pid in servers:
            # A killed one is still seen for a moment, ready as it was.
            if file.state == "ready" and (waited > GRACE or answers(file.socket_folder)):
                return True
        elif signals and waited > signals[-1][0]:
            _, kind = signals.pop()
            for pid in servers:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, kind)
        if waited > BUSY_SECONDS:
            raise DatabaseError(
                f"the processes {servers} use {data}, but no server answers there after "
                f"{BUSY_SECONDS:g} s. It may still be recovering, then call again later; "
                f"{data / 'server.log'} says more"
            )
        time.sleep(0.02)
    remove_stale(data / NAME)
    return False


def remove_stale(lock_file: Path) -> None:
    """Remove a file in which a server that is gone states its number, as the user that it ran as.

    PostgreSQL replaces it by itself, but not if another process of the user has got the number
    since, if the killed server is still a zombie, or if the file is empty.
    """
    if Path("/proc/self").exists():  # elsewhere no process is seen: PostgreSQL decides alone
        server_account(lock_file.parent).run(["rm", "-f", str(lock_file)], cwd=Path("/"))


def servers_in(data: Path) -> list[int]:
    """The PostgreSQL processes that work in a data directory; a zombie does not.

    The directory's owner is asked: without the capability to trace, as in a container, even root
    does not see where another user's process works.
    """
    if not data.exists():
        return []
    owner, processes = server_account(data), Path("/proc")
    running = [p for p in processes.glob("[0-9]*") if _program(p) in SERVER_PROGRAMS]
    if not running:
        return []
    links = [str(process / "cwd") for process in running]
    listing = owner.run(["find", *links, "-maxdepth", "0", "-printf", "%h\\t%l\\0"], cwd=Path("/"))
    entries = (line.partition("\t") for line in listing.stdout.split("\0"))
    resolved = str(data.resolve())
    return [int(Path(entry).name) for entry, _, target in entries if target == resolved]


def _program(process: Path) -> str:
    try:
        return (process / "comm").read_text().strip()
    except OSError:  # it has ended
        return ""
