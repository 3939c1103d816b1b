"""`semmap db`: the embedded cluster and the schema's revisions from the command line."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from semmap.cli.chosen import CliOptions
from semmap.cli.options import Json

if TYPE_CHECKING:
    from sqlalchemy import URL, Engine

db_command = typer.Typer(no_args_is_help=True, help="The database: start, stop, revisions, psql.")


def _choose(url: str | None) -> str | None:
    if url is not None:
        CliOptions.url = url
    return url


# `semmap --db` and SEMMAP_DB come before the command; `semmap db COMMAND --db` works, too.
Db = Annotated[
    str | None,
    Option(callback=_choose, help="Database URL; by default SEMMAP_DB or the embedded one."),
]


@contextmanager
def _as_it_is() -> Iterator[Engine]:
    """The chosen database, its schema not brought up to date."""
    from semmap.database.engine import open_engine

    engine = open_engine(CliOptions.url, migrate=False)
    try:
        yield engine
    finally:
        engine.dispose()


@db_command.command()
def start() -> None:
    """Start the embedded database; it is made at first use."""
    from semmap.database.embedded import Cluster
    from semmap.database.engine import open_engine

    cluster = Cluster()
    before, new = time.perf_counter(), not cluster.exists
    open_engine(cluster).dispose()
    print(
        f"{cluster.home}: {'made and ' if new else ''}ready "
        f"after {time.perf_counter() - before:.1f} s"
    )


@db_command.command()
def stop() -> None:
    """Stop the embedded database."""
    from semmap.database.embedded import Cluster

    cluster = Cluster()
    print(f"{cluster.home}: {'stopped' if cluster.stop() else 'was not running'}")


@db_command.command()
def status(db: Db = None) -> None:
    """Show which database is used, and the revision of its schema; starts nothing."""
    from semmap.database import revisions
    from semmap.database.embedded import Cluster
    from semmap.database.engine import database_url, open_engine

    url = CliOptions.url or os.environ.get("SEMMAP_DB")
    if url is None:
        cluster = Cluster()
        folder = cluster.running() if cluster.exists else None
        print(f"embedded database: {cluster.home}")
        if folder is None:
            print("not running" if cluster.exists else "not made yet")
            return
        chosen = cluster.url(folder)
    else:
        chosen = database_url(url)
        print(f"database: {chosen.render_as_string(hide_password=True)}")
    engine = open_engine(chosen, migrate=False)
    with engine.connect() as connection:
        server = connection.exec_driver_sql("SHOW server_version").scalar()
        postgis = connection.exec_driver_sql(
            "SELECT extversion FROM pg_extension WHERE extname = 'postgis'"
        ).scalar()
        checksums = connection.exec_driver_sql("SHOW data_checksums").scalar()
    have, newest = revisions.installed_on(engine), revisions.newest()
    engine.dispose()
    print(f"PostgreSQL {server}, PostGIS {postgis or 'not yet'}, data checksums {checksums}")
    print(
        f"schema at revision {have or 'none'}"
        + ("" if have == newest else f", the newest is {newest}: semmap db upgrade")
    )


@db_command.command()
def url(db: Db = None) -> None:
    """Print the database's URL, for psql, QGIS and other clients; the embedded one is started."""
    from semmap.database.engine import database_url

    print(_libpq(database_url(CliOptions.url)))


@db_command.command()
def upgrade(
    revision: str = Argument("head", help="A revision, or head."),
    db: Db = None,
) -> None:
    """Bring the schema up to a revision."""
    from semmap.database import migrate, revisions

    with _as_it_is() as engine:
        migrate.upgrade(engine, revision)
        print(f"schema at revision {revisions.installed_on(engine)}")


@db_command.command()
def downgrade(
    revision: str = Argument(help="A revision, -1, or base."),
    db: Db = None,
) -> None:
    """Take the schema down to a revision; no row is lost."""
    from semmap.database import migrate, revisions

    with _as_it_is() as engine:
        migrate.downgrade(engine, revision)
        print(f"schema at revision {revisions.installed_on(engine) or 'none'}")


@db_command.command()
def drop(
    yes: bool = Option(False, "--yes", help="Don't ask."),
    db: Db = None,
) -> None:
    """Delete the schema with all maps in it."""
    from semmap.database import migrate

    with _as_it_is() as engine:
        if not yes:
            where = engine.url.render_as_string(hide_password=True)
            typer.confirm(f"Delete all maps in {where}?", abort=True)
        migrate.drop(engine)
    print("dropped")


@db_command.command()
def cluster(
    folder: Path = Argument(help="A new folder for the files; its name is the cluster's."),
    nodes: int = Option(3, min=3, max=9, help="How many servers have the data."),
    port: int = Option(5432, min=1, max=65535, help="Port of the first server on this machine."),
    subnet: str | None = Option(
        None, help="Network of the servers, such as 10.20.30.0/24; by default a random one of 10."
    ),
    json_: Json = False,
) -> None:
    """Write a set-up with failover for Docker: servers with copies of the data, and a monitor."""
    from semmap.cli.output import print_json
    from semmap.database.failover import write_cluster

    written = write_cluster(folder, nodes=nodes, port=port, subnet=subnet)
    if json_:
        print_json(written._asdict())
        return
    print(
        f"{written.folder}: a monitor and {nodes} servers\n\n"
        f"start    {written.start}\n"
        f"use      export SEMMAP_DB='{written.url}'\n"
        f"look     {written.state}\n"
    )
    print("\n".join(f"- {promise}" for promise in written.promises))


@db_command.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def psql(context: typer.Context) -> None:
    """Open psql on the database; arguments that follow are passed to it."""
    from semmap.database.engine import open_engine
    from semmap.database.error import DatabaseError

    program = shutil.which("psql")
    if program is None:
        raise DatabaseError(
            "psql is not installed. Debian, Ubuntu: apt-get install postgresql-client"
        )
    engine = open_engine(CliOptions.url, migrate=False)
    chosen = engine.url
    engine.dispose()
    if chosen.password is not None:
        os.environ["PGPASSWORD"] = str(chosen.password)  # arguments are seen by all users
    os.environ.setdefault("PGOPTIONS", "-c search_path=semmap,public -c timezone=UTC")
    os.execv(program, [program, _libpq(chosen._replace(password=None)), *context.args])


def _libpq(url: URL) -> str:
    return url.set(drivername="postgresql").render_as_string(hide_password=False)
