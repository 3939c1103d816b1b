"""Which PostgreSQL of a machine is used, and what is said where it lacks one."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.database import Cluster, DatabaseError
from semmap.database.programs import find_programs


def install(folder: Path, version: int, postgis: bool) -> Path:
    """A folder that looks like one that a distribution's package makes."""
    programs = folder / str(version) / "bin"
    programs.mkdir(parents=True)
    share = folder / str(version) / "share"
    (share / "extension").mkdir(parents=True)
    if postgis:
        (share / "extension/postgis.control").write_text("")
    for name, says in {
        "postgres": f"postgres (PostgreSQL) {version}.3 (Debian {version}.3-1)",
        "initdb": "",
        "pg_ctl": "",
        "pg_config": str(share),
    }.items():
        (programs / name).write_text(f"#!/bin/sh\necho '{says}'\n")
        (programs / name).chmod(0o755)
    return programs


def test_this_machine_has_one() -> None:
    programs = find_programs()
    assert programs.version >= 14
    assert programs.postgis
    assert Path(programs["initdb"]).is_file()


def test_newest_with_postgis(tmp_path: Path) -> None:
    folders = [
        install(tmp_path, 14, True),
        install(tmp_path, 15, True),
        install(tmp_path, 16, False),
        install(tmp_path, 9, True),
    ]
    assert find_programs(folders=folders).version == 15
    assert find_programs(14, folders).folder == folders[0]


def test_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SEMMAP_POSTGRESQL", str(folder / "nothing"))
    with pytest.raises(
        DatabaseError, match="apt-get install postgresql postgresql-NN-postgis-3"
    ) as e:
        Cluster(folder / "home").ensure()
    assert "SEMMAP_DB" in str(e.value)


def test_too_old(tmp_path: Path) -> None:
    with pytest.raises(DatabaseError, match=r"14 or newer is not installed \(there is 13\)"):
        find_programs(folders=[install(tmp_path, 13, True)])


def test_without_postgis(tmp_path: Path) -> None:
    with pytest.raises(DatabaseError, match="apt-get install postgresql-16-postgis-3"):
        find_programs(folders=[install(tmp_path, 16, False)])


def test_version_of_a_cluster_is_gone(tmp_path: Path) -> None:
    with pytest.raises(
        DatabaseError, match=r"made with PostgreSQL 14.*apt-get install postgresql-14 "
    ):
        find_programs(14, [install(tmp_path, 16, True)])
