"""The files that `semmap db cluster` writes; `tests/failover` starts them."""

from __future__ import annotations

import json
import stat
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path

import psycopg
import pytest
import yaml
from typer.testing import CliRunner

from semmap import cli
from semmap.database import DatabaseError
from semmap.database.failover import write_cluster
from semmap.database.files import image_folder


@pytest.mark.parametrize("nodes", [3, 5])
def test_each_server_has_a_port_of_this_machine_and_an_address(tmp_path: Path, nodes: int) -> None:
    written = write_cluster(tmp_path / "house", nodes, port=6000, subnet="10.9.8.0/24")
    compose = yaml.safe_load((tmp_path / "house/compose.yaml").read_text())
    services = compose["services"]
    assert [*services] == ["monitor", *(f"node{i + 1}" for i in range(nodes))]
    ports = [port for each in services.values() for port in each.get("ports", [])]
    assert ports == [f"127.0.0.1:{6000 + i}:5432" for i in range(nodes)]
    addresses = {name: each["networks"]["nodes"]["ipv4_address"] for name, each in services.items()}
    assert len({*addresses.values()}) == nodes + 1
    assert all(IPv4Address(one) in IPv4Network("10.9.8.0/24") for one in addresses.values())
    for each in services.values():
        assert each["extra_hosts"] == [f"{name}.nodes:{ip}" for name, ip in addresses.items()]
    volumes = [volume.split(":")[0] for each in services.values() for volume in each["volumes"]]
    assert sorted(volumes) == sorted(compose["volumes"])
    assert compose["networks"]["nodes"]["internal"] is True
    assert "clients" not in services["monitor"]["networks"]
    used = psycopg.conninfo.conninfo_to_dict(written.url)
    assert used["port"] == ",".join(str(6000 + i) for i in range(nodes))
    assert used["target_session_attrs"] == "read-write"


def test_passwords_are_random_and_for_the_owner_alone(tmp_path: Path) -> None:
    files = [tmp_path / name / ".env" for name in ("one", "two")]
    urls = [write_cluster(file.parent).url for file in files]
    lines = [line for file in files for line in file.read_text().splitlines()]
    assert len({line.split("=")[1] for line in lines}) == 4
    for file, url in zip(files, urls, strict=True):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        password = psycopg.conninfo.conninfo_to_dict(url)["password"]
        assert f"POSTGRES_PASSWORD={password}\n" in file.read_text()
        assert str(password) not in (file.parent / "compose.yaml").read_text()


def test_the_image_can_be_built_from_the_folder(tmp_path: Path) -> None:
    write_cluster(tmp_path / "house")
    copied = tmp_path / "house/postgis"
    for file in image_folder().iterdir():
        assert (copied / file.name).read_bytes() == file.read_bytes()
        is_program = bool((copied / file.name).stat().st_mode & stat.S_IXOTH)
        assert is_program == (file.name != "Dockerfile")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"nodes": 2}, "fewer than 3"),
        ({"port": 65534}, "ports up to 65536"),
        ({"subnet": "10.1.2.3/24"}, "host bits"),
        ({"subnet": "10.1.2.0/29"}, "8 addresses are too few"),
        ({"subnet": "house"}, "10.20.30.0/24"),
    ],
)
def test_what_cannot_be_used_writes_nothing(
    tmp_path: Path, arguments: dict[str, object], reason: str
) -> None:
    with pytest.raises(DatabaseError, match=reason):
        write_cluster(tmp_path / "house", **arguments)
    assert not (tmp_path / "house").exists()


def test_a_folder_with_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("kept")
    with pytest.raises(DatabaseError, match="not an empty folder"):
        write_cluster(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


def test_the_command_says_how_to_start_it_and_what_is_promised(tmp_path: Path) -> None:
    printed = CliRunner().invoke(cli.app, ["db", "cluster", str(tmp_path / "a"), "--port", "6000"])
    assert "up -d --build --wait" in printed.stdout
    assert "127.0.0.1:6000,127.0.0.1:6001,127.0.0.1:6002/semmap" in printed.stdout
    assert "must not cancel a commit" in printed.stdout
    as_json = CliRunner().invoke(cli.app, ["db", "cluster", str(tmp_path / "b"), "--json"])
    found = json.loads(as_json.stdout)
    assert [*found] == ["folder", "start", "state", "url", "promises"]
    assert found["folder"] == str(tmp_path / "b")
