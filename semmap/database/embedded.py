"""The embedded cluster: a private PostgreSQL in the user's data folder, on a Unix socket only."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import signal
import socket
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import URL

from semmap.database import configuration
from semmap.database.account import Account, server_account
from semmap.database.error import DatabaseError
from semmap.database.programs import find_programs

__all__ = ["Cluster", "default_home"]

DATABASE = "semmap"
PORT = 5432
SOCKET_PATH_LIMIT = 103
"""Bytes that the path of a Unix socket may have (107 on Linux, 103 on macOS)."""

START_SECONDS = 60
ORPHAN_SECONDS = 1.0
"""What processes that outlived their server are given to end by themselves."""


def default_home() -> Path:
    """Where the cluster lies: ``$SEMMAP_DATA``, else ``semmap`` in the user's data directory.

    Root's own folders are closed to the user that the server runs as; its cluster lies in
    ``/var/lib/semmap``.
    """
    if stated := os.environ.get("SEMMAP_DATA"):
        return Path(stated).expanduser().absolute()
    if os.environ.get("XDG_DATA_HOME", "").startswith("/"):
        return Path(os.environ["XDG_DATA_HOME"]) / "semmap"
    if os.geteuid() == 0:
        return Path("/var/lib/semmap")
    return Path.home() / ".local" / "share" / "semmap"


@dataclass(frozen=True)
class Cluster:
    """A cluster in a folder.

    Attributes
    ----------
    home : the folder; ``data/`` in it is PostgreSQL's, ``server.log`` its words. Whoever
        wants other settings writes them to ``local.conf`` there.
    settings : settings of the server that override the usual ones when it is started
    """

    home: Path = field(default_factory=default_home)
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def data(self) -> Path:
        """PostgreSQL's data directory."""
        return self.home / "data"

    @property
    def log(self) -> Path:
        """What the server says of itself."""
        return self.data / "server.log"

    @property
    def exists(self) -> bool:
        """Whether the cluster has been made."""
        return (self.data / "PG_VERSION").exists()

    def running(self) -> Path | None:
        """The folder of the socket on which the server answers; None where it does not run."""
        try:
            lines = (self.data / "postmaster.pid").read_text().splitlines()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except PermissionError:
            server_account(self.data)  # says whose it is
            raise
        if len(lines) < 8 or lines[7].strip() != "ready":
            return None
        return Path(lines[4]) if _answers(Path(lines[4])) else None

    def ensure(self) -> URL:
        """The URL of the map's database; the cluster is made and started at need.

        Of several processes that come at once, one does it and the others wait.

        Raises
        ------
        DatabaseError
            PostgreSQL or PostGIS is missing, or the folder or the user will not do; with the mend.
        """
        folder = self.running()
        if folder is None:
            with self._locked():
                folder = self.running()
                if folder is None:
                    if not self.exists:
                        self._create()
                    folder = self._start()
        return self.url(folder)

    def url(self, socket_folder: Path) -> URL:
        """The URL of the map's database on a server that listens in `socket_folder`."""
        return URL.create(
            "postgresql+psycopg",
            username=configuration.SUPERUSER,
            database=DATABASE,
            query={"host": str(socket_folder), "port": str(PORT)},
        )

    def stop(self) -> bool:
        """Stop the server; open transactions are undone. Returns whether it ran.

        Raises
        ------
        DatabaseError
            It does not stop.
        """
        if not self.exists:
            return False
        with self._locked():
            if self.running() is None and not (self.data / "postmaster.pid").exists():
                return False
            programs = find_programs(self._version())
            owner = server_account(self.data)
            done = owner.run(
                [programs["pg_ctl"], "stop", "-D", str(self.data), "-m", "fast", "-w"], self.home
            )
            if done.returncode and self.running() is not None:
                raise DatabaseError(f"the server does not stop: {done.stderr.strip()}")
            return done.returncode == 0

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """While it lasts, no other process makes, starts or stops this cluster."""
        try:
            self.home.mkdir(parents=True, exist_ok=True)
            lock = os.open(self.home / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise DatabaseError(
                f"the folder of the embedded database, {self.home}, cannot be used: {error}. "
                "Set SEMMAP_DATA to another one, or name a database: SEMMAP_DB, --db"
            ) from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield
        finally:
            os.close(lock)

    def _version(self) -> int:
        return int((self.data / "PG_VERSION").read_text())

    def _create(self) -> None:
        """Make the cluster aside and move it into its place, so that half of one is never there."""
        programs = find_programs()
        owner = server_account(self.data)
        self._open_to(owner)
        new = self.home / "data.new"
        if new.exists():
            shutil.rmtree(new)
        new.mkdir(mode=0o700)
        os.chown(new, owner.uid, owner.gid)
        self._configure(new)
        made = owner.run(
            [
                programs["initdb"], "--pgdata", str(new), "--username", configuration.SUPERUSER,
                "--encoding=UTF8", "--locale=C.UTF-8", "--auth=peer", "--no-instructions",
            ],
            self.home,
        )  # fmt: skip
        if made.returncode:
            raise DatabaseError(f"the embedded database cannot be made: {made.stderr.strip()}")
        with (new / "postgresql.conf").open("a") as file:
            file.write("include '../semmap.conf'\ninclude_if_exists '../local.conf'\n")
        made = owner.run(
            [programs["postgres"], "--single", "-D", str(new), "postgres"],
            self.home,
            input=f"CREATE DATABASE {DATABASE}\n",
        )
        if made.returncode or "ERROR" in made.stderr or "FATAL" in made.stderr:
            raise DatabaseError(f"the embedded database cannot be made: {made.stderr.strip()}")
        new.rename(self.data)

    def _start(self) -> Path:
        programs = find_programs(self._version())
        owner = server_account(self.data)
        self._open_to(owner)
        self._clear(owner)
        folder = self._configure(self.data)
        started = owner.run(
            [
                programs["pg_ctl"], "start", "-D", str(self.data), "-l", str(self.log),
                "-w", "-t", str(START_SECONDS), "-s",
            ],
            self.home,
        )  # fmt: skip
        if started.returncode or self.running() is None:
            raise DatabaseError(
                f"the embedded database does not start: {started.stderr.strip()}\n"
                f"{_tail(self.log)}\n(all of it: {self.log})"
            )
        return folder

    def _open_to(self, owner: Account) -> None:
        """See that the server's user gets to the cluster's folder."""
        if owner.is_caller:
            return
        self.home.chmod(0o755)
        if not owner.can_enter(self.home):
            raise DatabaseError(
                f"PostgreSQL refuses to run as root, and {owner.name}, who runs it instead, cannot "
                f"enter {self.home}. Set SEMMAP_DATA to a folder that all may enter, such as "
                "/var/lib/semmap"
            )

    def _configure(self, data: Path) -> Path:
        """Write the server's settings for this machine as it now is; returns the socket's folder."""
        owner = server_account(data)
        folder = _socket_folder(self.home, owner)
        settings = configuration.server_settings(
            find_programs(self._version() if self.exists else None), folder, self.home
        )
        for name, text in {
            "semmap.conf": configuration.as_file({**settings, **self.settings}),
            "hba.conf": configuration.access_rules(),
            "ident.conf": configuration.user_map(owner.name),
        }.items():
            (self.home / name).write_text(text)
            (self.home / name).chmod(0o644)
        return folder

    def _clear(self, owner: Account) -> None:
        """Clear away what a server that was killed left: its orphans, and its number.

        The server itself removes a stale ``postmaster.pid``, unless a process of the same user has
        by now got the number that stands in it.
        """
        orphans_end = time.monotonic() + ORPHAN_SECONDS
        sent = False
        while orphans := _processes_in(self.data):
            if self.running() is not None:
                return
            if not sent and time.monotonic() > orphans_end:
                for pid in orphans:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGQUIT)
                sent = True
            if time.monotonic() > orphans_end + 10:
                raise DatabaseError(
                    f"processes {orphans} still use {self.data}, but no server answers there; "
                    f"{self.log} may say why. End them and call again"
                )
            time.sleep(0.05)
        if Path("/proc/self/cwd").exists():
            (self.data / "postmaster.pid").unlink(missing_ok=True)


def _socket_folder(home: Path, owner: Account) -> Path:
    """A folder for the socket that only the server's user (and root) can enter.

    Below the cluster's folder, or, where that path is too long for a socket, in the user's
    runtime directory or the one for temporary files.
    """
    folder = home / "run"
    if len(os.fsencode(_socket(folder))) > SOCKET_PATH_LIMIT:
        key = hashlib.sha256(os.fsencode(home)).hexdigest()[:12]
        runtime = os.environ.get("XDG_RUNTIME_DIR", "")
        base = Path(runtime) if runtime and owner.is_caller else Path(tempfile.gettempdir())
        folder = base / f"semmap-{owner.uid}-{key}"
        if len(os.fsencode(_socket(folder))) > SOCKET_PATH_LIMIT:
            folder = Path("/tmp") / folder.name
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
        os.chown(folder, owner.uid, owner.gid)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != owner.uid or found.st_mode & 0o077:
        raise DatabaseError(
            f"{folder}, where the database's socket has to lie, is not a folder that only "
            f"{owner.name} can enter; remove it and call again"
        )
    return folder


def _socket(folder: Path) -> Path:
    return folder / f".s.PGSQL.{PORT}"


def _answers(socket_folder: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(_socket(socket_folder)))
        except OSError:
            return False
    return True


def _processes_in(folder: Path) -> list[int]:
    """The processes whose working directory is `folder`, as a server's is its data directory."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if (entry / "cwd").readlink() == folder.resolve():
                found.append(int(entry.name))
    return found


def _tail(log: Path, lines: int = 5) -> str:
    try:
        return "\n".join(log.read_text(errors="replace").splitlines()[-lines:])
    except OSError:
        return ""
