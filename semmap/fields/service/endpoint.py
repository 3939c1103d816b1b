"""Where the services of a database listen: one Unix socket for each map, for its user alone.

This module and `client` load nothing that is slow, so that a command that asks a service is quick.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

from semmap.data_folder import default_home

if TYPE_CHECKING:
    import psycopg


def url_of(session: psycopg.Connection[Any]) -> str:
    """Return a URL, without login, of the database that a session is connected with."""
    info = session.info
    host = quote(info.host, safe="")
    return f"postgresql:///{quote(info.dbname, safe='')}?host={host}&port={info.port}"


def socket_folder(url: str | None) -> Path:
    """Return the folder of the sockets for a database, by its URL; it may not exist."""
    key = hashlib.sha256("\0".join(_identity(url)).encode()).hexdigest()[:12]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/") and len(runtime) < 40:
        return Path(runtime) / "semmap-fields" / key
    return Path(tempfile.gettempdir()) / f"semmap-fields-{os.getuid()}" / key


def socket_of(url: str | None, map_name: str) -> Path:
    """Return the socket for a map, in a folder that only this user can enter, or raise OSError."""
    folder = socket_folder(url)
    for each in (folder.parent, folder):
        each.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = each.lstat()
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        if not own or found.st_mode & 0o077:
            raise PermissionError(
                f"{each} is not a folder that only you can enter: remove it and call again"
            )
    return folder / f"{hashlib.sha256(map_name.encode()).hexdigest()[:16]}.sock"


def _identity(url: str | None) -> tuple[str, str, str]:
    """Return host, port and name of a database."""
    given = url or os.environ.get("SEMMAP_DB")
    if not given:
        return str(default_home() / "run"), "5432", "semmap"
    parts = urlsplit(given)
    options = parse_qs(parts.query)
    host = options.get("host", [parts.hostname or "localhost"])[0]
    port = options.get("port", [str(parts.port or 5432)])[0]
    return unquote(host), port, unquote(parts.path.lstrip("/"))
