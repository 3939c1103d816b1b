"""The file ``postmaster.pid``: a server's process ID, its socket and its state."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from semmap.database.folder import read_file

NAME = "postmaster.pid"


class PidFile(NamedTuple):
    """What a server writes about itself: its process ID, the folder of its socket, its state.

    The state is ``starting``, ``ready``, ``standby`` or ``stopping``; empty before it is written.
    """

    pid: int
    socket_folder: Path
    state: str


def read_pid_file(data: Path) -> PidFile | None:
    """The content of ``postmaster.pid`` in a data directory; None if there is none to be read.

    PermissionError where the directory is closed to this process, DatabaseError where it is a link.
    """
    try:
        lines = read_file(data / NAME).splitlines()
        return PidFile(int(lines[0]), Path(lines[4]), lines[7].strip() if len(lines) > 7 else "")
    except (FileNotFoundError, ValueError, IndexError):
        return None
