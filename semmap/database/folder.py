"""The cluster's folder, whose links are not followed: another user may have put them there."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from semmap.database.account import Account, user_name
from semmap.database.error import DatabaseError

HINT = "Set SEMMAP_DATA to another folder, or name a database: SEMMAP_DB, --db"


def check_home(home: Path) -> None:
    """See that root is not led elsewhere by the folder of a cluster; other users lead themselves.

    DatabaseError where this is root, and the folder is behind another user's symbolic link, can be
    written by its group or by others, or its data directory is another user's than the folder.
    """
    if os.geteuid() != 0 or not home.exists():
        return
    found = home.stat()
    for part in (home, *home.parents):
        link = part.lstat()
        foreign = link.st_uid or (found.st_uid if part == home else 0)
        if stat.S_ISLNK(link.st_mode) and foreign:
            raise DatabaseError(
                f"{part} is a symbolic link of {user_name(link.st_uid)} to {part.resolve()}, a "
                f"folder of {user_name(part.stat().st_uid)}; root follows only its own links to "
                f"its own folders. {HINT}"
            )
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise DatabaseError(
            f"{home} can be written by its group or by others, which is unsafe for root: "
            f"chmod go-w {home}. {HINT}"
        )
    with suppress(FileNotFoundError, NotADirectoryError):
        data = (home / "data").lstat()
        if data.st_uid != found.st_uid != 0 or (stat.S_ISLNK(data.st_mode) and data.st_uid):
            raise DatabaseError(
                f"{home} belongs to {user_name(found.st_uid)}, but {home / 'data'} is a folder or "
                f"link of {user_name(data.st_uid)}, which root does not follow. {HINT}"
            )


@contextmanager
def open_folder(path: Path) -> Iterator[Folder]:
    """A folder, held open."""
    number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield Folder(path, number)
    finally:
        os.close(number)


@dataclass(frozen=True)
class Folder:
    """An open folder, by its descriptor: what is made in it is there, whatever its path means."""

    path: Path
    number: int

    def write(self, name: str, text: str) -> None:
        """Replace a file that all may read; a link of that name is replaced, not followed."""
        new = f"{name}.new"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            with suppress(FileNotFoundError):  # left behind by one that was killed
                os.unlink(new, dir_fd=self.number)
            file = os.open(new, flags, 0o644, dir_fd=self.number)
            with os.fdopen(file, "w") as stream:
                os.fchmod(file, 0o644)
                stream.write(text)
            os.replace(new, name, src_dir_fd=self.number, dst_dir_fd=self.number)
        except OSError as error:
            raise DatabaseError(
                f"{self.path / name} cannot be written: {error.strerror}. Remove it and "
                f"{self.path / new}, and call again"
            ) from error

    def open_lock(self, name: str) -> int:
        """The descriptor of a file to lock, not of a link; made at need for the folder's owner."""
        flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        try:
            lock = os.open(name, flags | os.O_CREAT | os.O_EXCL, 0o600, dir_fd=self.number)
        except FileExistsError:
            try:
                return os.open(name, flags, dir_fd=self.number)
            except OSError as error:
                if error.errno == errno.ELOOP:
                    raise DatabaseError(
                        f"{self.path / name} is a symbolic link: remove it and call again"
                    ) from None
                raise
        owner = os.fstat(self.number)
        if os.geteuid() == 0:  # of a file that was just made: no other name leads to it
            os.fchown(lock, owner.st_uid, owner.st_gid)
        return lock

    def make_folder(self, name: str, owner: Account, mode: int = 0o700) -> None:
        """Make a folder of `owner`, which only that user can enter unless `mode` says otherwise."""
        os.mkdir(name, 0o700, dir_fd=self.number)
        made = os.open(
            name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=self.number
        )
        try:
            os.fchown(made, owner.uid, owner.gid)
            os.fchmod(made, mode)
        finally:
            os.close(made)

    def rename(self, name: str, to: str) -> None:
        """Give a file or folder another name."""
        os.rename(name, to, src_dir_fd=self.number, dst_dir_fd=self.number)

    def remove_tree(self, name: str) -> None:
        """Remove a folder with all in it; a link is not followed, and what cannot go stays."""
        shutil.rmtree(name, ignore_errors=True, dir_fd=self.number)

    def names(self) -> list[str]:
        """The names of all that is in it."""
        with os.scandir(self.number) as entries:
            return [entry.name for entry in entries]


def read_file(path: Path, last: int | None = None) -> str:
    """The text, or the last bytes, of a regular file; DatabaseError where it is none or a link."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise DatabaseError(f"{path} is a symbolic link: remove it and call again") from None
        raise
    try:
        found = os.fstat(file)
        if not stat.S_ISREG(found.st_mode):
            raise DatabaseError(f"{path} is not a regular file: remove it and call again")
        if last is not None:
            os.lseek(file, max(found.st_size - last, 0), os.SEEK_SET)
        with os.fdopen(file, errors="replace", closefd=False) as stream:
            return stream.read()
    finally:
        os.close(file)
