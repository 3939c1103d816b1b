"""The embedded cluster: a private PostgreSQL in the user's data folder, on a Unix socket only."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import URL

from semmap.database import configuration
from semmap.database.account import Account, server_account
from semmap.database.error import DatabaseError
from semmap.database.leftovers import clear_leftovers
from semmap.database.programs import Programs, find_programs
from semmap.database.sockets import PORT, answers, make_socket_folder

__all__ = ["Cluster", "default_home"]

DATABASE = "semmap"
START_SECONDS = 60


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


@dataclass(frozen=True)
class Cluster:
    """A cluster in a folder.

    Attributes
    ----------
    home : the folder. ``data/`` in it is PostgreSQL's; settings in a ``local.conf`` beside it
        override the usual ones.
    """

    home: Path = field(default_factory=default_home)

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
        return self.data.is_dir()

    def running(self) -> Path | None:
        """The folder of the socket on which the server answers; None where it does not run.

        Raises
        ------
        DatabaseError
            The cluster is another user's.
        """
        if not self.exists:
            return None
        try:
            lines = (self.data / "postmaster.pid").read_text().splitlines()
        except FileNotFoundError:
            return None
        except PermissionError:
            server_account(self.data)  # says whose it is
            raise
        if len(lines) < 8 or lines[7].strip() != "ready":
            return None
        folder = Path(lines[4])
        return folder if answers(folder) else None

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
            server_account(self.data)  # before anything is touched
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
            It does not stop, or is another user's.
        """
        if not self.exists:
            return False
        owner = server_account(self.data)
        with self._locked():
            if self.running() is None:
                return False
            self._stop(self._programs(), owner)
        return True

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """While it lasts, no other process makes, starts or stops this cluster."""
        try:
            if not self.home.is_dir():
                self.home.mkdir(parents=True, exist_ok=True)
                self.home.chmod(0o755)  # the data directory in it is closed
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

    def _programs(self) -> Programs:
        """PostgreSQL in the version that the cluster was made with."""
        return find_programs(int((self.data / "PG_VERSION").read_text()))

    def _create(self) -> None:
        """Make the cluster aside and move it into its place, so that half of one is never there."""
        programs = find_programs()
        owner = server_account(self.data)
        self._check_entry(owner)
        for abandoned in self.home.glob("new-*"):
            shutil.rmtree(abandoned, ignore_errors=True)
        new = Path(tempfile.mkdtemp(prefix="new-", dir=self.home))
        os.chown(new, owner.uid, owner.gid)
        try:
            self._initialise(new, programs, owner)
            new.rename(self.data)
        finally:
            shutil.rmtree(new, ignore_errors=True)

    def _initialise(self, new: Path, programs: Programs, owner: Account) -> None:
        made = owner.run(
            [
                programs["initdb"], "--pgdata", str(new), "--username", configuration.SUPERUSER,
                "--encoding=UTF8", "--locale=C.UTF-8", "--auth=peer", "--no-instructions",
            ],
            self.home,
        )  # fmt: skip
        if made.returncode == 0:
            made = owner.run(
                [programs["postgres"], "--single", "-D", str(new), "postgres"],
                self.home,
                input=f"CREATE DATABASE {DATABASE}\n",
            )
        if made.returncode or "ERROR:" in made.stderr:
            raise DatabaseError(f"the embedded database cannot be made: {made.stderr.strip()}")
        with (new / "postgresql.conf").open("a") as file:
            file.write("include '../semmap.conf'\ninclude_if_exists '../local.conf'\n")

    def _start(self) -> Path:
        programs = self._programs()
        owner = server_account(self.data)
        self._check_entry(owner)
        if clear_leftovers(self.data):
            if (folder := self.running()) is not None:
                return folder
            self._stop(programs, owner)  # nobody reaches it: its socket is gone
        folder = make_socket_folder(self.home, owner)
        self._configure(programs, owner, folder)
        started = owner.run(
            [
                programs["pg_ctl"], "start", "-D", str(self.data), "-l", str(self.log),
                "-w", "-t", str(START_SECONDS), "-s",
            ],
            self.home,
            configuration.ALLOCATOR,
        )  # fmt: skip
        if started.returncode or self.running() is None:
            raise DatabaseError(
                f"the embedded database does not start: {started.stderr.strip()}\n"
                f"{_tail(self.log)}\n(all of it: {self.log})"
            )
        return folder

    def _stop(self, programs: Programs, owner: Account) -> None:
        done = owner.run(
            [programs["pg_ctl"], "stop", "-D", str(self.data), "-m", "fast", "-w"], self.home
        )
        if done.returncode:
            raise DatabaseError(f"the embedded database does not stop: {done.stderr.strip()}")

    def _configure(self, programs: Programs, owner: Account, socket_folder: Path) -> None:
        """Write the settings for this machine as it now is."""
        settings = configuration.server_settings(programs, socket_folder, self.home)
        for name, text in {
            "semmap.conf": configuration.as_file(settings),
            "hba.conf": configuration.access_rules(),
            "ident.conf": configuration.user_map(owner.name),
        }.items():
            (self.home / name).write_text(text)
            (self.home / name).chmod(0o644)

    def _check_entry(self, owner: Account) -> None:
        if not owner.can_enter(self.home):
            raise DatabaseError(
                f"PostgreSQL refuses to run as root, and {owner.name}, who runs it instead, cannot "
                f"enter {self.home}. Set SEMMAP_DATA to a folder that all may enter, such as "
                "/var/lib/semmap"
            )


def _tail(log: Path, lines: int = 5) -> str:
    try:
        return "\n".join(log.read_text(errors="replace").splitlines()[-lines:])
    except OSError:
        return ""
