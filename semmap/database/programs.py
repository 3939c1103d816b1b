"""PostgreSQL's own programs on this machine: where they are, in which version, with what."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from semmap.database.error import DatabaseError
from semmap.database.requirements import POSTGRESQL

NEEDED = ("initdb", "postgres", "pg_ctl")

FOLDERS = (
    "/usr/lib/postgresql/*/bin",  # Debian, Ubuntu
    "/usr/pgsql-*/bin",  # PostgreSQL's packages for Red Hat
    "/usr/lib64/pgsql/bin",
    "/opt/homebrew/opt/postgresql@*/bin",
    "/usr/local/opt/postgresql@*/bin",
)
"""Where distributions put the server's programs, which are rarely on the PATH."""


@dataclass(frozen=True)
class Programs:
    """One installed PostgreSQL: its folder and major version, and whether with PostGIS and lz4."""

    folder: Path
    version: int
    postgis: bool
    lz4: bool

    def __getitem__(self, name: str) -> str:
        return str(self.folder / name)


def find_programs(version: int | None = None, folders: Iterable[Path] | None = None) -> Programs:
    """The newest installed PostgreSQL that has PostGIS, or that of an existing cluster's version.

    Folders are by default ``$SEMMAP_POSTGRESQL``, else `pg_config`'s, the distributions' usual ones
    and the PATH. DatabaseError with the packages to install where there is none.
    """
    places = _folders() if folders is None else folders
    installed = [_look(folder) for folder in dict.fromkeys(place.resolve() for place in places)]
    found = [programs for programs in installed if programs is not None]
    fitting = [p for p in found if (p.version == version if version else p.version >= POSTGRESQL)]
    if not fitting:
        raise DatabaseError(_missing(version, found))
    best = max(fitting, key=lambda p: (p.postgis, p.version))
    if not best.postgis:
        raise DatabaseError(
            f"PostgreSQL {best.version} is installed, but its PostGIS is not. Debian, Ubuntu: "
            f"apt-get install postgresql-{best.version}-postgis-3. "
            "Or name a database that has it: SEMMAP_DB, --db"
        )
    return best


def _missing(version: int | None, found: list[Programs]) -> str:
    packages = f"postgresql-{version or 'NN'} postgresql-{version or 'NN'}-postgis-3"
    has = ", ".join(sorted({str(p.version) for p in found}))
    if version:
        wanted = f"the cluster was made with PostgreSQL {version}, which is not installed any more"
        way = f"Debian, Ubuntu: apt-get install {packages}"
    else:
        wanted = f"PostgreSQL {POSTGRESQL} or newer is not installed"
        way = f"Debian, Ubuntu: apt-get install postgresql {packages.split()[1]} (NN: its version)"
    return (
        f"{wanted}{f' (there is {has})' if has else ''}. {way}. "
        "Or say where its programs are: SEMMAP_POSTGRESQL=/folder/bin; or name a database: "
        "SEMMAP_DB, --db"
    )


def _folders() -> Iterator[Path]:
    if stated := os.environ.get("SEMMAP_POSTGRESQL"):
        yield Path(stated)
        return
    if pg_config := shutil.which("pg_config"):
        yield Path(_output(pg_config, "--bindir"))
    for pattern in FOLDERS:
        yield from sorted(Path("/").glob(pattern[1:]))
    if initdb := shutil.which("initdb"):
        yield Path(initdb).resolve().parent


def _look(folder: Path) -> Programs | None:
    if not all(os.access(folder / name, os.X_OK) for name in NEEDED):
        return None
    match = re.search(r"\) (\d+)", _output(folder / "postgres", "--version"))
    if match is None:
        return None
    version = int(match[1])
    share, lz4 = Path(f"/usr/share/postgresql/{version}"), False
    if (folder / "pg_config").exists():
        said, _, built = _output(folder / "pg_config", "--sharedir", "--configure").partition("\n")
        share, lz4 = Path(said), "--with-lz4" in built
    return Programs(folder, version, (share / "extension/postgis.control").exists(), lz4)


def _output(program: str | Path, *arguments: str) -> str:
    return subprocess.run([program, *arguments], capture_output=True, text=True).stdout.strip()
