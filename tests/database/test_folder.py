"""Root is not led elsewhere by the folder of a cluster that another user can write."""

from __future__ import annotations

import os
import pwd
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from semmap.database import Cluster, DatabaseError
from semmap.database.folder import open_folder, read_file
from tests.database.conftest import become, python, query, said
from tests.database.test_embedded import ASK, URL_OR_ERROR

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="as root only")

SECRET = "a line of root's"


@pytest.fixture(scope="module")
def nobody() -> pwd.struct_passwd:
    return pwd.getpwnam("nobody")


@pytest.fixture
def theirs(folder: Path, nobody: pwd.struct_passwd) -> Path:
    """An empty folder of another user."""
    home = folder / "theirs"
    home.mkdir(mode=0o755)
    os.chown(home, nobody.pw_uid, nobody.pw_gid)
    return home


@pytest.fixture
def secret(folder: Path) -> Iterator[Path]:
    """A file that only root can read; it must stay as it is."""
    file = folder / "secret"
    file.write_text(SECRET)
    file.chmod(0o600)
    before = file.stat()
    yield file
    assert file.read_text() == SECRET
    assert file.stat().st_mode == before.st_mode
    assert file.stat().st_uid == 0


def link(path: Path, to: Path, owner: pwd.struct_passwd) -> None:
    """A symbolic link that another user made."""
    path.symlink_to(to)
    os.chown(path, owner.pw_uid, owner.pw_gid, follow_symlinks=False)


def test_no_file_of_the_cluster_leads_root_elsewhere(
    theirs: Path, secret: Path, nobody: pwd.struct_passwd
) -> None:
    names = ["semmap.conf", "hba.conf", "ident.conf"]
    for name in names:
        link(theirs / name, secret, nobody)
        link(theirs / f"{name}.new", secret, nobody)
    link(theirs / "new-1", secret.parent, nobody)
    assert query(Cluster(theirs), "SELECT 7") == 7
    assert all((theirs / name).is_file() and not (theirs / name).is_symlink() for name in names)
    # and the owner can go on
    Cluster(theirs).stop()
    prefix = become("nobody")
    url = said(python(URL_OR_ERROR, theirs, prefix=prefix))
    assert said(python(ASK, url, "SELECT 7", prefix=prefix)) == 7
    server = (theirs / "data/postmaster.pid").read_text().split()[0]
    assert Path(f"/proc/{server}").stat().st_uid == nobody.pw_uid


@pytest.mark.parametrize("there", [True, False])
def test_linked_lock(
    theirs: Path, folder: Path, nobody: pwd.struct_passwd, secret: Path, there: bool
) -> None:
    link(theirs / "lock", secret if there else folder / "new", nobody)
    with pytest.raises(DatabaseError, match="lock is a symbolic link: remove it"):
        Cluster(theirs).ensure()
    assert not (folder / "new").exists()


@pytest.mark.parametrize("name", ["run", "data"])
def test_linked_folder(theirs: Path, folder: Path, nobody: pwd.struct_passwd, name: str) -> None:
    target = folder / "target"
    target.mkdir(mode=0o700)
    link(theirs / name, target, nobody)
    with pytest.raises(DatabaseError, match=f"{theirs / name}, where|{theirs / name} is a folder"):
        Cluster(theirs).ensure()
    assert target.stat().st_uid == 0
    assert not list(target.iterdir())
    (theirs / name).unlink()


def test_data_of_a_third_user(theirs: Path) -> None:
    (theirs / "data").mkdir()
    os.chown(theirs / "data", 1, 1)
    with pytest.raises(DatabaseError, match=r"belongs to nobody, but .* of daemon"):
        Cluster(theirs).ensure()
    (theirs / "data").rmdir()


@pytest.mark.parametrize("target_of", ["root", "nobody"])
@pytest.mark.parametrize("link_of", ["root", "nobody"])
def test_home_behind_a_link(folder: Path, link_of: str, target_of: str) -> None:
    target, home = folder / "target", folder / "home"
    target.mkdir(mode=0o755)
    user = pwd.getpwnam(target_of)
    os.chown(target, user.pw_uid, user.pw_gid)
    link(home, target, pwd.getpwnam(link_of))
    if link_of == target_of == "root":
        assert query(Cluster(home), "SELECT 7") == 7
        return
    with pytest.raises(DatabaseError, match=rf"{home} is a symbolic link of {link_of} to {target}"):
        Cluster(home).ensure()
    assert not list(target.iterdir())


def test_home_below_a_link(folder: Path, nobody: pwd.struct_passwd) -> None:
    (folder / "target").mkdir(mode=0o755)
    link(folder / "way", folder / "target", nobody)
    (folder / "target/home").mkdir(mode=0o755)
    with pytest.raises(DatabaseError, match=f"{folder / 'way'} is a symbolic link of nobody"):
        Cluster(folder / "way/home").ensure()


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o1777])
def test_home_that_others_can_write(folder: Path, mode: int) -> None:
    home = folder / "home"
    home.mkdir()
    home.chmod(mode)
    for use in (Cluster(home).ensure, Cluster(home).stop, Cluster(home).running):
        with pytest.raises(DatabaseError, match=f"chmod go-w {home}"):
            use()
    assert not list(home.iterdir())


def test_what_only_root_can_read_is_not_shown(
    theirs: Path, secret: Path, nobody: pwd.struct_passwd
) -> None:
    cluster = Cluster(theirs)
    link(theirs / "local.conf", secret, nobody)
    assert query(cluster, "SELECT 7") == 7  # the server reads it as its own user, or not at all
    cluster.stop()
    (theirs / "local.conf").unlink()
    (theirs / "local.conf").write_text("shared_buffers = nonsense\n")
    cluster.log.unlink()
    link(cluster.log, secret, nobody)
    with pytest.raises(DatabaseError, match="does not start") as caught:
        cluster.ensure()
    assert SECRET not in str(caught.value)


def test_number_in_a_pipe_or_behind_a_link(
    theirs: Path, secret: Path, nobody: pwd.struct_passwd
) -> None:
    file = theirs / "data/postmaster.pid"
    file.parent.mkdir(mode=0o700)
    os.chown(file.parent, nobody.pw_uid, nobody.pw_gid)
    link(file, secret, nobody)
    with pytest.raises(DatabaseError, match="is a symbolic link"):
        Cluster(theirs).running()
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(DatabaseError, match="is not a regular file"):
        Cluster(theirs).running()
    file.unlink()


def test_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    (tmp_path / "conf").write_text("before")
    with open_folder(tmp_path) as folder:
        with (tmp_path / "conf").open() as reader:
            folder.write("conf", "after")
            assert reader.read() == "before"
        (tmp_path / "taken").mkdir()
        with pytest.raises(DatabaseError, match=r"taken cannot be written: .* Remove it"):
            folder.write("taken", "")
    assert (tmp_path / "conf").read_text() == "after"
    assert stat.S_IMODE((tmp_path / "conf").stat().st_mode) == 0o644


def test_end_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("one\ntwo\n")
    assert read_file(tmp_path / "log") == "one\ntwo\n"
    assert read_file(tmp_path / "log", last=4) == "two\n"
    assert read_file(tmp_path / "log", last=100) == "one\ntwo\n"
