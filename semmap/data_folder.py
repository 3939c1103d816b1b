"""The user's folder for the embedded database; it loads nothing that is slow."""

from __future__ import annotations

import os
from pathlib import Path


def default_home() -> Path:
    """Where the cluster lies: ``$SEMMAP_DATA``, else ``semmap`` in the user's data directory.

    Root's own folders are closed to the user that the server runs as, so root's cluster lies in
    ``/var/lib/semmap``.
    """
    if stated := os.environ.get("SEMMAP_DATA"):
        return Path(stated).expanduser().absolute()
    if os.environ.get("XDG_DATA_HOME", "").startswith("/"):
        return Path(os.environ["XDG_DATA_HOME"]) / "semmap"
    if os.geteuid() == 0:
        return Path("/var/lib/semmap")
    return Path.home() / ".local" / "share" / "semmap"
