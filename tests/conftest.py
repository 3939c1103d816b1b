"""What all tests share: a cluster of their own, fresh databases in it, the real worlds.

``SEMMAP_TEST_DB`` names another server to test on (its user must be allowed to make databases),
``SEMMAP_WORLDS`` the folder of real worlds. ``HYPOTHESIS_PROFILE=explore`` looks for examples that
no run has had, and has more cases (`tests/effort.py`); by default each run has the same, so that a
change fails by what it changes, and a third as many.
"""

from __future__ import annotations

import ctypes
import gc
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
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

from semmap.database import Cluster, open_engine
from semmap.ingest.importer import import_file
from tests.cluster_folder import cluster_folder, remove_abandoned
from tests.consistency import contradictions

hypothesis.settings.register_profile("same", derandomize=True, deadline=None, max_examples=30)
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
    "worlds/test_arms_small_house.py",
    "planner/search/test_search_missions.py",
    "worlds/test_arm_plans_small_house.py",
    "api/test_map_drawing.py",
    "ros/test_missions.py",
    "planner/test_side_arm.py",
    "worlds/test_missions_worlds.py",
    "export/test_world_round_trips.py",
    "buildings/test_buildings.py",
    "buildings/test_kept_buildings.py",
    "fuzz/test_cases.py",
    "worlds/test_planner.py",
    "cli/demo/test_run.py",
    "ingest/test_bad_input.py",
    "export/test_round_trips.py",
    "worlds/test_demo.py",
    "api/test_stacks.py",
    "worlds/test_manipulation_worlds.py",
    "examples/test_tutorial.py",
    "manipulation/test_openings.py",
    "worlds/test_moves.py",
    "knowledge/test_one_meaning.py",
    "schema/test_hostile_robot.py",
    "export/test_rmf_building.py",
    "worlds/test_found_rooms.py",
    "manipulation/test_surface_grasps.py",
    "cli/test_drawing.py",
    "manipulation/test_automata.py",
    "examples/test_readme.py",
    "worlds/test_one_room.py",
    "worlds/test_duplex.py",
    "planner/cli/test_missions.py",
    "manipulation/test_part_trial.py",
    "api/test_plans_in_physics.py",
    "worlds/test_search_small_house.py",
    "knowledge/test_r2rml.py",
    "examples/test_wheel.py",
    "buildings/test_found_rooms.py",
    "database/test_crash.py",
    "worlds/test_mirror_restarts.py",
    "worlds/test_costmaps.py",
    "draw/qgis/test_project.py",
    "planner/mission/test_kills.py",
    "schema/test_relations.py",
    "examples/test_forty_lines.py",
    "database/test_embedded.py",
)
"""The files that take longest, the longest first, so that the tests of others fill the end of a
parallel run."""


def pytest_configure() -> None:
    """Workers and commands load OpenBLAS without threads, as `semmap` does: all cores are busy.

    A cache of Gazebo Fuel on this machine would give models their meshes.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["GZ_FUEL_CACHE_PATH"] = os.devnull


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than cores: tests of crashes and patience wait for most of their time."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the slow files."""
    ranks = {ROOT / "tests" / name: rank for rank, name in enumerate(SLOW)}
    items.sort(key=lambda item: ranks.get(item.path, len(SLOW)))


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over modules and tests: it took a tenth of a run."""
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


SERVER = """
fsync = off
full_page_writes = off
synchronous_commit = off
shared_buffers = 128MB
dynamic_shared_memory_type = mmap
autovacuum = off
"""
"""Nothing of the test server outlives a crash of the machine. Autovacuum would visit each of the
hundreds of databases once a minute. Shared memory is in the server's folder and goes with it."""


@pytest.fixture(scope="session", autouse=True)
def home() -> Iterator[Path]:
    """A folder for the cluster of this test run; the user's own is out of reach."""
    # pytest's own temporary folders are closed to the user that runs the server for root
    parents = [Path("/tmp"), *([MEMORY] if MEMORY.is_dir() else [])]
    for parent in parents:
        remove_abandoned(parent)
    roomy = shutil.disk_usage(parents[-1]).free > MEMORY_FOR_TESTS
    with cluster_folder(parents[-1] if roomy else parents[0]) as folder:
        (folder / "local.conf").write_text(SERVER)
        before = dict(os.environ)
        os.environ.pop("SEMMAP_DB", None)
        os.environ["SEMMAP_DATA"] = str(folder)
        yield folder
        os.environ.clear()
        os.environ.update(before)


@pytest.fixture(scope="session")
def cluster(home: Path) -> URL:
    """The server that tests run on: that of ``SEMMAP_TEST_DB``, else an embedded cluster."""
    stated = os.environ.get("SEMMAP_TEST_DB")
    if stated:
        return make_url(stated).set(drivername="postgresql+psycopg")
    return Cluster(home).ensure()


def administrator(server: URL) -> Callable[[str], None]:
    """Runs statements that no transaction may hold, such as CREATE DATABASE."""
    engine = create_engine(server, isolation_level="AUTOCOMMIT", poolclass=NullPool)

    def run(statement: str) -> None:
        with engine.connect() as connection:  # a new one: the server may have been restarted
            connection.exec_driver_sql(statement)

    return run


@pytest.fixture(scope="session")
def databases() -> dict[str, str]:
    """The databases of tests that are there, each with the test that needed it first."""
    return {}


@pytest.fixture(scope="session")
def of_module() -> dict[str, Callable[[], None]]:
    """The databases that go with the module whose tests made them, each with what drops it."""
    return {}


@pytest.fixture(autouse=True, scope="module")
def drop_those_of_module(of_module: dict[str, Callable[[], None]]) -> Iterator[None]:
    """Without it, all tests together need three times the room on the disk; and memory grows."""
    yield
    for drop in [*of_module.values()]:
        drop()
    gc.collect()
    with suppress(AttributeError):  # of glibc
        ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture(scope="session")
def make_database(
    cluster: URL,
    databases: dict[str, str],
    of_module: dict[str, Callable[[], None]],
    drop_database: Callable[[URL], None],
) -> Iterator[MakeDatabase]:
    """Fresh databases for fixtures of any scope; they are dropped when the module ends.

    With `keep`, they are there until all tests end. Stored holders and poses must be those derived
    on each, whatever the tests did.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    prefix = f"semmap_test_{worker}_{os.getpid()}"
    template = f"{prefix}_template"
    numbers = count(1)
    run = administrator(cluster)
    run(f"CREATE DATABASE {template}")
    databases[template] = "the empty schema"
    open_engine(cluster.set(database=template)).dispose()

    def make(of: URL | None = None, *, keep: bool = False) -> URL:
        name = f"{prefix}_{next(numbers)}"
        copied = template if of is None else of.database
        # Copying files takes a third of the time of writing them to the log.
        run(f"CREATE DATABASE {name} TEMPLATE {copied} STRATEGY FILE_COPY")
        databases[name] = os.environ["PYTEST_CURRENT_TEST"]
        url = cluster.set(database=name)
        if not keep:
            of_module[name] = partial(drop_database, url)
        return url

    yield make
    found = {
        test: rows
        for name, test in databases.items()
        if (rows := contradictions(cluster.set(database=name)))
    }
    if "SEMMAP_TEST_DB" in os.environ:  # the folder of an embedded cluster goes as a whole
        for name in databases:
            run(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
    assert not found


@pytest.fixture(scope="session")
def drop_database(
    cluster: URL, databases: dict[str, str], of_module: dict[str, Callable[[], None]]
) -> Callable[[URL], None]:
    """Drops a database when its tests have ended, so that its files need never be written.

    Its stored holders and poses must be those derived, whatever its tests did.
    """
    run = administrator(cluster)

    def drop(url: URL) -> None:
        of_module.pop(str(url.database), None)
        found = contradictions(url)
        run(f"DROP DATABASE {url.database} WITH (FORCE)")
        del databases[str(url.database)]
        assert not found

    return drop


@pytest.fixture(scope="session")
def imported(make_database: MakeDatabase, drop_database: Callable[[URL], None]) -> Import:
    """Fresh databases that hold files: each sequence of files is imported once, then copied."""
    made: dict[tuple[tuple[Path, str], ...], URL] = {}

    def holding(files: tuple[tuple[Path, str], ...]) -> URL | None:
        if files and files not in made:
            *others, (path, map_name) = files
            url = make_database(holding(tuple(others)), keep=True)
            engine = open_engine(url)
            import_file(engine, path, map_name=map_name)
            engine.dispose()
            made[files] = url
        return made.get(files)

    @contextmanager
    def engine_on(*files: tuple[Path, str]) -> Iterator[Engine]:
        engine = open_engine(make_database(holding(files), keep=True))
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
    engine = open_engine(database)
    yield engine
    engine.dispose()


@pytest.fixture(scope="module")
def module_engine(
    make_database: MakeDatabase, drop_database: Callable[[URL], None]
) -> Iterator[Engine]:
    """An engine on a migrated database that the tests of a module share."""
    engine = open_engine(make_database())
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
    run = administrator(docker_server)
    run(f"CREATE DATABASE {name}")
    engine = open_engine(docker_server.set(database=name), migrate=False)
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
