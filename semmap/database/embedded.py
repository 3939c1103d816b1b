"""The embedded cluster: a private PostgreSQL in the user's data folder, on a Unix socket only."""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from semmap.data_folder import default_home
from semmap.database import configuration
from semmap.database.account import Account, caller, server_account
from semmap.database.error import DatabaseError
from semmap.database.folder import Folder, check_home, open_folder, read_file
from semmap.database.leftovers import clear_leftovers, read_pid_file, remove_stale, servers_in
from semmap.database.patience import BUSY_SECONDS
from semmap.database.programs import Programs, find_programs
from semmap.database.rights import LIMIT_RIGHTS
from semmap.database.sockets import PORT, answers, lock_file, make_socket_folder
from semmap.terminal import print_waiting

if TYPE_CHECKING:
    from sqlalchemy import URL

DATABASE = "semmap"

INCLUDES = "include '../semmap.conf'\ninclude_if_exists '../local.conf'\n"
"""The end of ``postgresql.conf``: settings that each start writes, then those of the user."""


@dataclass(frozen=True)
class Cluster:
    """A cluster in the folder `home`; ``local.conf`` in it overrides the usual settings."""

    home: Path = field(default_factory=default_home)

    @property
    def data(self) -> Path:
        """PostgreSQL's data directory."""
        return self.home / "data"

    @property
    def log(self) -> Path:
        """The log of the server."""
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
            The cluster is another user's, or its folder is unsafe for root.
        """
        check_home(self.home)
        if not self.exists:
            return None
        try:
            file = read_pid_file(self.data)
        except PermissionError:
            server_account(self.data)  # says whose it is
            raise
        if file is None or file.state != "ready" or not answers(file.socket_folder):
            return None
        return file.socket_folder

    def ensure(self) -> URL:
        """As `start`, but the URL of the map's database."""
        return self.url(self.start())

    def start(self) -> Path:
        """Make and start the cluster where it is not running; the folder of its socket.

        Of several processes that come at once, one does it and the others wait.

        Raises
        ------
        DatabaseError
            PostgreSQL or PostGIS is missing, or the folder or the user cannot be used; the message
            says how to fix it.
        """
        folder = self.running()
        if folder is None:
            server_account(self.data)  # before anything is touched
            with self._locked() as home:
                folder = self.running()
                if folder is None:
                    if not self.exists:
                        self._create(home)
                    folder = self._start(home)
        return folder

    def url(self, socket_folder: Path) -> URL:
        """The URL of the map's database on a server that listens in `socket_folder`."""
        from sqlalchemy import URL  # takes longer to import than a command that reads may

        given = self.parameters(socket_folder)
        user, database = given.pop("user"), given.pop("dbname")
        return URL.create("postgresql+psycopg", username=user, database=database, query=given)

    def parameters(self, socket_folder: Path) -> dict[str, str]:
        """The same as `url`, as libpq's connection parameters."""
        return {
            "user": configuration.SUPERUSER,
            "dbname": DATABASE,
            "host": str(socket_folder),
            "port": str(PORT),
        }

    def stop(self) -> bool:
        """Stop the server and undo open transactions; whether it ran.

        Raises
        ------
        DatabaseError
            It does not stop, or is another user's.
        """
        check_home(self.home)
        if not self.exists:
            return False
        owner = server_account(self.data)
        with self._locked():
            if self.running() is None:
                return False
            self._stop(self._programs(), owner)
        return True

    @contextlib.contextmanager
    def _locked(self) -> Iterator[Folder]:
        """The cluster's folder; while it lasts, no other process makes, starts or stops it."""
        with contextlib.ExitStack() as stack:
            try:
                if not self.home.is_dir():
                    self._make_home()
                home = stack.enter_context(open_folder(self.home))
                lock = home.open_lock("lock")
            except OSError as error:
                raise DatabaseError(
                    f"the folder of the embedded database, {self.home}, cannot be used: {error}. "
                    "Set SEMMAP_DATA to another one, or name a database: SEMMAP_DB, --db"
                ) from error
            stack.callback(os.close, lock)
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield home

    def _make_home(self) -> None:
        """Make the folder, which all may enter: the data directory in it is closed."""
        self.home.parent.mkdir(parents=True, exist_ok=True)
        with open_folder(self.home.parent) as parent, contextlib.suppress(FileExistsError):
            parent.make_folder(self.home.name, caller(), 0o755)

    def _programs(self) -> Programs:
        """PostgreSQL in the version that the cluster was made with."""
        try:
            version = int(read_file(self.data / "PG_VERSION"))
        except (FileNotFoundError, ValueError):
            raise DatabaseError(
                f"{self.data} is not a PostgreSQL data directory: it has no version in PG_VERSION. "
                "Move it away, and a new one is made; or set SEMMAP_DATA to another folder"
            ) from None
        return find_programs(version)

    def _create(self, home: Folder) -> None:
        """Make the cluster aside and move it into its place, so that half of one is never there."""
        programs = find_programs()
        owner = server_account(self.data)
        self._check_entry(owner)
        for abandoned in home.names():
            if abandoned.startswith("new-"):
                home.remove_tree(abandoned)
        print_waiting(f"making the embedded database in {self.home}, once ...")
        new = f"new-{secrets.token_hex(4)}"
        home.make_folder(new, owner)
        try:
            self._initialise(self.home / new, programs, owner)
            home.rename(new, self.data.name)
        finally:
            home.remove_tree(new)

    def _initialise(self, new: Path, programs: Programs, owner: Account) -> None:
        made = owner.run(
            [
                programs["initdb"],
                "--pgdata",
                str(new),
                "--username",
                configuration.SUPERUSER,
                "--encoding=UTF8",
                "--locale=C.UTF-8",
                "--data-checksums",
                "--auth=peer",
                "--no-instructions",
            ],
            self.home,
        )
        # databases that are made later have the rights of template1, but not its TEMPORARY
        for database, statement in (
            ("template1", LIMIT_RIGHTS),
            ("postgres", f"CREATE DATABASE {DATABASE};"),
            (DATABASE, LIMIT_RIGHTS),
        ):
            if made.returncode == 0 and "ERROR:" not in made.stderr:
                made = owner.run(
                    [programs["postgres"], "--single", "-j", "-D", str(new), database],
                    self.home,
                    input=f"{statement.strip()}\n\n",
                )
        if made.returncode == 0 and "ERROR:" not in made.stderr:
            # by the owner: root would follow what that user puts in its own folder
            made = owner.run(["tee", "-a", str(new / "postgresql.conf")], self.home, input=INCLUDES)
        if made.returncode or "ERROR:" in made.stderr:
            raise DatabaseError(f"the embedded database cannot be made: {made.stderr.strip()}")

    def _start(self, home: Folder) -> Path:
        programs = self._programs()
        owner = server_account(self.data)
        self._check_entry(owner)
        while clear_leftovers(self.data):
            if (folder := self.running()) is not None:
                return folder
            self._stop(programs, owner)  # nobody reaches it: its socket is gone
        folder = make_socket_folder(self.home, owner)
        remove_stale(lock_file(folder))
        self._configure(home, programs, owner, folder)
        started = owner.run(
            [
                programs["pg_ctl"],
                "start",
                "-D",
                str(self.data),
                "-l",
                str(self.log),
                "-w",
                "-t",
                f"{BUSY_SECONDS:.0f}",
                "-s",
            ],
            self.home,
            configuration.ALLOCATOR,
        )
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
        file = read_pid_file(self.data)
        if done.returncode and file and file.pid in servers_in(self.data):  # else it just ended
            problem = f"the embedded database does not stop: {done.stderr.strip()}"
            raise DatabaseError(f"{problem}. It may still write: wait, and stop it again")

    def _configure(
        self, home: Folder, programs: Programs, owner: Account, socket_folder: Path
    ) -> None:
        """Write the settings for this machine as it now is."""
        settings = configuration.server_settings(programs, socket_folder, self.home)
        for name, text in {
            "semmap.conf": configuration.as_file(settings),
            "hba.conf": configuration.access_rules(),
            "ident.conf": configuration.user_map(owner.name),
        }.items():
            home.write(name, text)

    def write_user_map(self, logins: Sequence[str]) -> None:
        """Write ``ident.conf``, which says who logs in as whom; the server reads it when told."""
        owner = server_account(self.data)
        with self._locked() as home:
            home.write("ident.conf", configuration.user_map(owner.name, logins))

    def _check_entry(self, owner: Account) -> None:
        if not owner.can_enter(self.home):
            raise DatabaseError(
                f"PostgreSQL refuses to run as root, and {owner.name}, who runs it instead, cannot "
                f"enter {self.home}. Set SEMMAP_DATA to a folder that all may enter, such as "
                "/var/lib/semmap"
            )


def _tail(log: Path, lines: int = 5) -> str:
    try:
        return "\n".join(read_file(log, last=lines * 1000).splitlines()[-lines:])
    except (OSError, DatabaseError):
        return ""
