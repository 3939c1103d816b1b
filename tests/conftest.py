"""What all tests share: a cluster of their own, fresh databases in it, the real worlds.

``SEMMAP_TEST_DB`` names another server to test on (its user must be allowed to make databases),
``SEMMAP_WORLDS`` the folder of real worlds. ``HYPOTHESIS_PROFILE=explore`` looks for examples that
no run has had; by default each run has the same, so that a change fails by what it changes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import count
from pathlib import Path
from typing import Any
from uuid import uuid4

import hypothesis
import pytest
from sqlalchemy import URL, Engine, create_engine, make_url
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session
from sqlalchemy.pool import NullPool

from semmap.database import Cluster, connect
from semmap.ingest.importer import import_file

hypothesis.settings.register_profile("same", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

ROOT = Path(__file__).parents[1]
PASSWORD = "p@ss/w:rd"  # with what a URL has to quote

MakeDatabase = Callable[..., URL]
"""Makes a fresh database and says its URL: with an empty, migrated schema, or a copy of another,
to which nobody is connected."""

Import = Callable[..., AbstractContextManager[Engine]]
"""Gives an engine on a fresh database that holds files, each a path and the map that takes it."""

MEMORY = Path("/dev/shm")
"""Files in memory, where the system has them: hundreds of databases are 300 files each."""

MEMORY_FOR_TESTS = 6 << 30
"""Bytes that must be free there for a test server in it."""


SLOW = (
    "schema/test_planning.py",
    "planner/mission/test_kills.py",
    "navgrid/test_slabs.py",
    "model/test_isolation.py",
    "worlds/",
    "examples/",
    "fields/store/",
    "planner/mission/",
    "fuzz/",
    "planner/demo/",
    "planner/tasks/test_pddl.py",
)
"""What takes long, the longest first: the tests of other files fill the end of a parallel run."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the slow files."""

    def rank(item: pytest.Item) -> int:
        path = item.path.relative_to(ROOT / "tests").as_posix()
        return next((i for i, slow in enumerate(SLOW) if path.startswith(slow)), len(SLOW))

    items.sort(key=rank)


SERVER = """
fsync = off
full_page_writes = off
synchronous_commit = off
shared_buffers = 128MB
autovacuum = off
"""
"""Nothing of the test server outlives a crash of the machine. Autovacuum would visit each of the
hundreds of databases once a minute."""


@pytest.fixture(scope="session", autouse=True)
def home() -> Iterator[Path]:
    """A folder for the cluster of this test run; the user's own is out of reach."""
    # pytest's own temporary folders are closed to the user that runs the server for root
    roomy = MEMORY.is_dir() and shutil.disk_usage(MEMORY).free > MEMORY_FOR_TESTS
    folder = Path(tempfile.mkdtemp(prefix="semmap-test-", dir=MEMORY if roomy else "/tmp"))
    folder.chmod(0o755)
    (folder / "local.conf").write_text(SERVER)
    before = dict(os.environ)
    os.environ.pop("SEMMAP_DB", None)
    os.environ["SEMMAP_DATA"] = str(folder)
    yield folder
    Cluster(folder).stop()
    os.environ.clear()
    os.environ.update(before)
    # Hundreds of thousands of files: they go while other workers still test.
    subprocess.run(["sh", "-c", 'rm -rf "$0" &', folder], check=True)


@pytest.fixture(scope="session")
def cluster(home: Path) -> URL:
    """The server that tests run on: that of ``SEMMAP_TEST_DB``, else an embedded cluster."""
    stated = os.environ.get("SEMMAP_TEST_DB")
    if stated:
        return make_url(stated).set(drivername="postgresql+psycopg")
    return Cluster(home).ensure()


@contextmanager
def administrator(server: URL) -> Iterator[Callable[[str], None]]:
    """Runs statements that no transaction may hold, such as CREATE DATABASE."""
    engine = create_engine(server, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        yield lambda statement: connection.exec_driver_sql(statement) and None
    engine.dispose()


@pytest.fixture(scope="session")
def make_database(cluster: URL) -> Iterator[MakeDatabase]:
    """Fresh databases for fixtures of any scope; they are dropped when the tests end."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    prefix = f"semmap_test_{worker}_{os.getpid()}"
    template = f"{prefix}_template"
    made = [template]
    numbers = count(1)
    with administrator(cluster) as run:
        run(f"CREATE DATABASE {template}")
        connect(cluster.set(database=template)).dispose()

        def make(of: URL | None = None) -> URL:
            name = f"{prefix}_{next(numbers)}"
            copied = template if of is None else of.database
            # Copying files takes a third of the time of writing them to the log.
            run(f"CREATE DATABASE {name} TEMPLATE {copied} STRATEGY FILE_COPY")
            made.append(name)
            return cluster.set(database=name)

        yield make
        if "SEMMAP_TEST_DB" in os.environ:  # the folder of an embedded cluster goes as a whole
            for name in made:
                run(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")


@pytest.fixture(scope="session")
def drop_database(cluster: URL) -> Iterator[Callable[[URL], None]]:
    """Drops a database when its tests have ended, so that its files need never be written."""
    with administrator(cluster) as run:
        yield lambda url: run(f"DROP DATABASE IF EXISTS {url.database} WITH (FORCE)")


@pytest.fixture(scope="session")
def imported(make_database: MakeDatabase, drop_database: Callable[[URL], None]) -> Import:
    """Fresh databases that hold files: each sequence of files is imported once, then copied."""
    made: dict[tuple[tuple[Path, str], ...], URL] = {}

    def holding(files: tuple[tuple[Path, str], ...]) -> URL | None:
        if files and files not in made:
            *others, (path, map_name) = files
            url = make_database(holding(tuple(others)))
            engine = connect(url)
            import_file(engine, path, map_name=map_name)
            engine.dispose()
            made[files] = url
        return made.get(files)

    @contextmanager
    def engine_on(*files: tuple[Path, str]) -> Iterator[Engine]:
        engine = connect(make_database(holding(files)))
        yield engine
        engine.dispose()
        drop_database(engine.url)

    return engine_on


@pytest.fixture
def database(make_database: MakeDatabase, drop_database: Callable[[URL], None]) -> Iterator[str]:
    """The URL of a fresh, migrated database for one test."""
    url = make_database()
    yield url.render_as_string(hide_password=False)
    drop_database(url)


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    """An engine on a fresh, migrated database for one test."""
    engine = connect(database)
    yield engine
    engine.dispose()


@pytest.fixture(scope="module")
def module_engine(
    make_database: MakeDatabase, drop_database: Callable[[URL], None]
) -> Iterator[Engine]:
    """An engine on a migrated database that the tests of a module share."""
    engine = connect(make_database())
    yield engine
    engine.dispose()
    drop_database(engine.url)


@pytest.fixture(scope="module")
def office_world(imported: Import) -> Iterator[Engine]:
    """An engine on a database with the office, which the tests of a module share."""
    names = ("office_rooms.geojson", "office.sdf")
    with imported(*((ROOT / "examples/office" / name, "office") for name in names)) as engine:
        yield engine


@pytest.fixture
def session(engine: Engine) -> Iterator[Session]:
    """An ORM session on a fresh, migrated database."""
    with Session(engine) as session:
        yield session


@pytest.fixture(scope="session")
def docker() -> str:
    """The `docker` program, where an engine answers it."""
    program = shutil.which("docker")
    if program is None:
        pytest.skip("docker is not installed")
    if subprocess.run([program, "info"], capture_output=True).returncode:
        pytest.skip("no Docker engine answers `docker info`")
    return program


@pytest.fixture(scope="session")
def docker_container(docker: str) -> Iterator[Any]:
    """A container of `docker/postgis`, started."""
    image = "semmap-postgis:test"
    built = subprocess.run(
        [docker, "build", "--network", "host", "-q", "-t", image, str(ROOT / "docker/postgis")],
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    os.environ["TESTCONTAINERS_RYUK_DISABLED"] = "true"
    from testcontainers.core.container import DockerContainer

    container = DockerContainer(image).with_envs(
        POSTGRES_USER="admin", POSTGRES_PASSWORD=PASSWORD, POSTGRES_DB="map"
    )
    container.ports["5432/tcp"] = ("127.0.0.1", None)  # any free port, on this machine only
    with container:
        yield container


@pytest.fixture(scope="session")
def docker_server(docker_container: Any) -> URL:
    """The URL of the server in a container; its user is superuser."""
    port = int(docker_container.get_exposed_port(5432))
    url = URL.create("postgresql+psycopg", "admin", PASSWORD, "127.0.0.1", port, "map")
    wait_for(url)
    return url


@pytest.fixture
def docker_postgis(docker_server: URL) -> Iterator[Engine]:
    """An engine on a fresh database in a container, which no revision has been run on."""
    name = f"fresh_{uuid4().hex}"
    with administrator(docker_server) as run:
        run(f"CREATE DATABASE {name}")
        engine = connect(docker_server.set(database=name), migrate=False)
        yield engine
        engine.dispose()
        run(f"DROP DATABASE {name} WITH (FORCE)")


def wait_for(server: URL, seconds: float = 60) -> None:
    """Wait until a server that is being started takes connections."""
    deadline = time.monotonic() + seconds
    engine = create_engine(server, poolclass=NullPool)
    while True:
        try:
            engine.connect().close()
            return
        except OperationalError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


@pytest.fixture(scope="session")
def worlds() -> Path:
    """The folder of real worlds; tests on them are skipped where it is absent."""
    folder = Path(os.environ.get("SEMMAP_WORLDS", ROOT.parent / "shared" / "worlds"))
    if not folder.is_dir():
        pytest.skip(f"the real worlds are not there: SEMMAP_WORLDS={folder}")
    return folder
