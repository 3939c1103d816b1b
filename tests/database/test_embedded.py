"""The embedded cluster: made, started, shared, stopped."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import create_engine
from sqlalchemy.exc import OperationalError

from semmap.data_folder import default_home
from semmap.database import Cluster, DatabaseError
from tests.database.conftest import as_owner, become, python, query, said

ENSURE = """
import json, sys
from pathlib import Path
from sqlalchemy import create_engine
from semmap.database import Cluster
engine = create_engine(Cluster(Path(sys.argv[1])).ensure())
with engine.connect() as connection:
    print(json.dumps(str(connection.exec_driver_sql("SELECT pg_postmaster_start_time()").scalar())))
"""

URL_OR_ERROR = """
import json, sys
from pathlib import Path
from semmap.database import Cluster, DatabaseError
try:
    print(json.dumps(str(Cluster(Path(sys.argv[1])).ensure())))
except DatabaseError as error:
    print(json.dumps(f"error: {error}"))
"""

ASK = """
import json, sys
from sqlalchemy import create_engine
from sqlalchemy.exc import OperationalError
try:
    with create_engine(sys.argv[1]).connect() as connection:
        print(json.dumps(connection.exec_driver_sql(sys.argv[2]).scalar()))
except OperationalError as error:
    print(json.dumps(f"error: {error.orig}"))
"""


MAKE = """
import sys
from pathlib import Path
from semmap.database import Cluster, open_engine
cluster = Cluster(Path(sys.argv[1]))
open_engine(cluster).dispose()
cluster.stop()
"""


def test_only_a_terminal_is_told_what_takes_long(folder: Path) -> None:
    told: list[list[str]] = []
    for n, (read, write) in enumerate((os.openpty(), os.pipe())):
        subprocess.run([sys.executable, "-c", MAKE, folder / str(n)], stderr=write, check=True)
        os.write(write, b"the end\n")
        with os.fdopen(read) as stream:
            told.append([line.strip() for line in iter(stream.readline, "the end\n")])
        os.close(write)
    (making, schema), nothing = told
    assert making == f"making the embedded database in {folder}/0, once ..."
    assert schema.startswith("bringing the schema from nothing to ")
    assert nothing == []


def test_settings_of_a_cluster_as_made(own: Cluster) -> None:
    (own.home / "local.conf").unlink()
    for setting, value in {
        "listen_addresses": "",
        "fsync": "on",
        "synchronous_commit": "on",
        "full_page_writes": "on",
        "data_checksums": "on",
        "server_encoding": "UTF8",
        "TimeZone": "UTC",
        "jit": "off",
        "max_wal_size": "4GB",
    }.items():
        assert query(own, f"SHOW {setting}") == value, setting
    collation = "SELECT datcollate FROM pg_database WHERE datname = current_database()"
    assert query(own, collation) == "C.UTF-8"
    assert query(own, "SELECT count(*) FROM pg_file_settings WHERE error IS NOT NULL") == 0
    assert query(own, "SELECT inet_server_addr()") is None


def test_local_settings_override(own: Cluster) -> None:
    (own.home / "local.conf").write_text("work_mem = 7MB\n")
    assert query(own, "SHOW work_mem") == "7MB"


def test_small_shared_memory(own: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("semmap.database.configuration.ROOMY_SHM", 1 << 62)
    assert query(own, "SHOW dynamic_shared_memory_type") == "mmap"


def test_the_server_keeps_freed_memory_by_default(
    own: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    def environment() -> list[str]:
        own.ensure()
        server = (own.data / "postmaster.pid").read_text().split()[0]
        # by its own user: root may not read it in a container
        read = ["cat", f"/proc/{server}/environ"]
        shown = subprocess.run(read, capture_output=True, text=True, check=True, **as_owner(own))
        return shown.stdout.split("\0")

    assert "MALLOC_TRIM_THRESHOLD_=33554432" in environment()
    own.stop()
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "1000000")
    assert "MALLOC_TRIM_THRESHOLD_=1000000" in environment()


def test_stop_and_start_keep_committed_data(own: Cluster) -> None:
    query(own, "CREATE TABLE kept AS SELECT 7 AS value")
    url = own.ensure()
    assert own.stop()
    assert own.running() is None
    assert not own.stop()
    with pytest.raises(OperationalError):
        create_engine(url).connect()
    assert query(own, "SELECT value FROM kept") == 7


def test_stop_without_a_server(folder: Path) -> None:
    assert not Cluster(folder / "none").stop()
    assert not (folder / "none").exists()


def test_processes_that_make_one_at_once_share_it(folder: Path) -> None:
    starters = [python(ENSURE, folder / "new") for _ in range(3)]
    assert len({said(starter) for starter in starters}) == 1


def test_processes_that_start_one_at_once_share_it(own: Cluster) -> None:
    starters = [python(ENSURE, own.home) for _ in range(2)]
    assert len({said(starter) for starter in starters}) == 1


@pytest.mark.parametrize("name", ["a" * 90, "with space, comma and 'quote'", "größe", "per%cent"])
def test_folders_of_any_name(move_to: Callable[[str], Cluster], name: str) -> None:
    cluster = move_to(name)
    assert query(cluster, "SELECT 7") == 7
    socket_folder = cluster.running()
    assert socket_folder is not None
    assert socket_folder.stat().st_mode & 0o777 == 0o700


def test_foreign_socket_folder_is_refused(move_to: Callable[[str], Cluster]) -> None:
    cluster = move_to("a" * 90)
    cluster.ensure()
    socket_folder = cluster.running()
    assert socket_folder is not None
    cluster.stop()
    socket_folder.chmod(0o755)
    with pytest.raises(DatabaseError, match=f"{socket_folder}.*remove it"):
        cluster.ensure()
    socket_folder.rmdir()
    assert query(cluster, "SELECT 7") == 7


def test_a_server_that_cannot_start_reports_the_cause(own: Cluster) -> None:
    (own.home / "local.conf").write_text("shared_buffers = nonsense\n")
    with pytest.raises(DatabaseError, match='invalid value for parameter "shared_buffers"'):
        own.ensure()


def test_folder_that_is_a_file(folder: Path) -> None:
    (folder / "file").write_text("")
    with pytest.raises(DatabaseError, match="Set SEMMAP_DATA to another one"):
        Cluster(folder / "file").ensure()


def test_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_DATA", "/somewhere")
    monkeypatch.setenv("XDG_DATA_HOME", "/data")
    assert default_home() == Path("/somewhere")
    monkeypatch.delenv("SEMMAP_DATA")
    assert default_home() == Path("/data/semmap")
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert default_home() == Path("/var/lib/semmap")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setenv("HOME", "/home/someone")
    assert default_home() == Path("/home/someone/.local/share/semmap")


@pytest.mark.skipif(os.geteuid() != 0, reason="as root only")
def test_root_runs_the_server_as_another(own: Cluster) -> None:
    own.ensure()
    pid = int((own.data / "postmaster.pid").read_text().split()[0])
    assert Path(f"/proc/{pid}").stat().st_uid == own.data.stat().st_uid != 0


@pytest.mark.skipif(os.geteuid() != 0, reason="as root only")
def test_root_gets_an_error_that_names_the_blocked_folder(folder: Path) -> None:
    closed = folder / "closed"
    closed.mkdir(mode=0o700)
    with pytest.raises(DatabaseError, match=r"cannot enter .*/var/lib/semmap"):
        Cluster(closed / "home").ensure()
    assert closed.stat().st_mode & 0o777 == 0o700


def test_each_user_has_its_own_cluster(folder: Path) -> None:
    prefix = become("nobody")
    home = folder / "theirs"
    home.mkdir()
    os.chown(home, 65534, 65534)
    url = said(python(URL_OR_ERROR, home, prefix=prefix))
    assert url.startswith("postgresql+psycopg://semmap@/semmap?host=")
    assert said(python(ASK, url, "SELECT current_user::text", prefix=prefix)) == "semmap"
    # root comes in, and its server would be the owner's; any other user does not
    assert query(Cluster(home), "SELECT 7") == 7
    assert "ermission denied" in said(python(ASK, url, "SELECT 7", prefix=become("games")))
    (home / "run").chmod(0o755)
    assert "ermission denied" in said(python(ASK, url, "SELECT 7", prefix=become("games")))
    (home / "run/.s.PGSQL.5432").chmod(0o777)
    assert "Peer authentication failed" in said(
        python(ASK, url, "SELECT 7", prefix=become("games"))
    )


def test_cluster_of_another_user(own: Cluster) -> None:
    prefix = become("nobody")
    own.ensure()
    said_to_them = said(python(URL_OR_ERROR, own.home, prefix=prefix))
    assert "belongs to" in said_to_them
    assert "SEMMAP_DATA" in said_to_them
