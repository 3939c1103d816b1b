"""The database in a container: image, entrypoint, schema, and how it is reached."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
import yaml
from sqlalchemy import URL, Engine

from semmap.database import DatabaseError, open_engine, revisions

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.docker


def test_the_image_meets_the_requirements_of_the_schema(docker_server: URL) -> None:
    engine = open_engine(docker_server)
    assert revisions.installed_on(engine) == revisions.newest()
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM entity").scalar() == 0
        asked = {"server_encoding": "UTF8", "TimeZone": "UTC"}
        for setting, value in asked.items():
            assert connection.exec_driver_sql(f"SHOW {setting}").scalar() == value
        collation = "SELECT datcollate FROM pg_database WHERE datname = current_database()"
        assert connection.exec_driver_sql(collation).scalar() == "C.UTF-8"
        extensions = "SELECT extname FROM pg_extension WHERE extname IN ('postgis', 'pgrouting')"
        assert len(connection.exec_driver_sql(extensions).all()) == 2
        assert connection.exec_driver_sql("SELECT current_user").scalar() == "admin"
        assert connection.exec_driver_sql("SELECT current_database()").scalar() == "map"
        assert connection.exec_driver_sql("SELECT inet_server_port()").scalar() == 5432
    engine.dispose()


def test_connect_migrates_a_fresh_database(docker_postgis: Engine) -> None:
    assert revisions.installed_on(docker_postgis) is None
    open_engine(docker_postgis.url).dispose()
    assert revisions.installed_on(docker_postgis) == revisions.newest()


def test_wrong_password_is_refused(docker_server: URL) -> None:
    with pytest.raises(DatabaseError, match="password authentication failed"):
        open_engine(docker_server.set(password="guess"))


def test_no_password_no_start(docker: str, docker_server: URL) -> None:
    done = subprocess.run(
        [docker, "run", "--rm", "semmap-postgis:test"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert "POSTGRES_PASSWORD" in done.stderr


def test_server_runs_as_postgres(docker: str, docker_server: URL) -> None:
    listed = subprocess.run(
        [docker, "ps", "--filter", "ancestor=semmap-postgis:test", "-q"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    for container in listed:
        owner = subprocess.run(
            [docker, "exec", container, "stat", "-c", "%U", "/proc/1"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        assert owner == "postgres"
    assert listed


def test_compose_publishes_on_loopback_only() -> None:
    service = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]["postgis"]
    assert service["ports"]
    assert all(port.startswith("127.0.0.1:") for port in service["ports"])
    assert (ROOT / service["build"]["context"] / "Dockerfile").is_file()
    assert os.access(ROOT / service["build"]["context"] / "entrypoint", os.X_OK)
