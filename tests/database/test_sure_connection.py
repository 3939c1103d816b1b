"""The outcome of a transaction is known, through lost connections and standbys that are away."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from random import Random

import psycopg
import pytest
import sqlalchemy
from sqlalchemy import URL, text

import semmap
from semmap.database import Cluster, DatabaseError, open_engine, open_session
from semmap.database.sure_connection import NotWrittenError, SureConnection, UnsettledError
from tests.database.lossy_wire import Loss, LossyWire, lossy_wire

LOSSES: tuple[Loss, ...] = ("request", "answer")

ENDED = (
    "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity "
    "WHERE pid <> pg_backend_pid() AND datname = current_database()"
)

SLOW_COMMIT = """
CREATE TABLE slow (id integer);
CREATE FUNCTION wait() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN PERFORM pg_sleep(1); RETURN NULL; END$$;
CREATE CONSTRAINT TRIGGER slow_commit AFTER INSERT ON slow DEFERRABLE INITIALLY DEFERRED
    FOR EACH ROW EXECUTE FUNCTION wait()
"""


@pytest.fixture
def wire(database: str) -> Iterator[LossyWire]:
    with psycopg.connect(plain(database), autocommit=True) as direct:
        direct.execute("CREATE TABLE note (id integer)")
    with lossy_wire(sqlalchemy.make_url(database)) as made:
        yield made


def plain(url: str) -> str:
    return url.replace("+psycopg", "")


def with_another_server(url: str, name: str | None = None) -> URL:
    """The URL of a database, of two servers of which the first is not there."""
    here = sqlalchemy.make_url(url)
    port = here.query.get("port", 5432)
    servers = {"host": f"127.0.0.1,{here.query['host']}", "port": f"1,{port}"}
    return here.set(drivername="postgresql", database=name or here.database, query=servers)


def notes(url: str) -> list[int]:
    """What the table has, by a connection of psycopg's own that no wire is in."""
    with psycopg.connect(plain(url)) as direct:
        return [row[0] for row in direct.execute("SELECT id FROM semmap.note ORDER BY id")]


@pytest.fixture
def session(database: str, wire: LossyWire) -> Iterator[SureConnection]:
    with psycopg.connect(plain(database), autocommit=True) as direct:
        direct.execute("ALTER TABLE note SET SCHEMA semmap")
    with closing(open_session(wire.url(database))) as made:
        yield made


def test_a_transaction_whose_answer_is_lost_is_known_to_be_written(
    database: str, wire: LossyWire, session: SureConnection
) -> None:
    wire.lose = ["answer"]
    with session.transaction():
        session.execute("INSERT INTO note VALUES (1)")
    assert wire.lost == 1
    assert session.closed
    assert notes(database) == [1]


def test_a_transaction_whose_commit_is_lost_is_known_not_to_be_written(
    database: str, wire: LossyWire, session: SureConnection
) -> None:
    wire.lose = ["request"]
    with pytest.raises(NotWrittenError, match="nothing was written"), session.transaction():
        session.execute("INSERT INTO note VALUES (1)")
    assert wire.lost == 1
    assert notes(database) == []


@pytest.mark.parametrize("loss", LOSSES)
def test_so_it_is_with_commit(
    loss: Loss, database: str, wire: LossyWire, session: SureConnection
) -> None:
    session.autocommit = False
    session.execute("INSERT INTO note VALUES (1)")
    wire.lose = [loss]
    if loss == "request":
        with pytest.raises(NotWrittenError):
            session.commit()
    else:
        session.commit()
    assert notes(database) == [1] * (loss == "answer")


@pytest.mark.parametrize("loss", LOSSES)
def test_so_it_is_with_engines(
    loss: Loss, database: str, wire: LossyWire, session: SureConnection
) -> None:
    engine = open_engine(wire.url(database))
    wire.lose = [loss]
    refused = pytest.raises(sqlalchemy.exc.OperationalError, match="nothing was written")
    with refused if loss == "request" else nullcontext(), engine.begin() as connection:
        connection.execute(text("INSERT INTO note VALUES (1)"))
    with engine.begin() as connection:  # the pool has another connection
        connection.execute(text("INSERT INTO note VALUES (2)"))
    engine.dispose()
    assert notes(database) == ([1, 2] if loss == "answer" else [2])


def test_a_commit_that_is_still_on_its_way_is_waited_for(
    database: str, wire: LossyWire, session: SureConnection
) -> None:
    session.execute(SLOW_COMMIT)
    key: list[str] = []
    with psycopg.connect(plain(database)) as direct:
        direct.execute("INSERT INTO semmap.slow VALUES (1)")
        direct.execute("INSERT INTO semmap.note VALUES (1)")
        key += direct.execute(
            "SELECT semmap.note_write(k), k::text FROM gen_random_uuid() k"
        ).fetchone()[1:]
        late = threading.Thread(target=direct.commit)
        late.start()
        time.sleep(0.2)
        assert notes(database) == []
        row = session.execute("SELECT was_written(%s)", key).fetchone()
        assert row == (True,)
        late.join()
    assert notes(database) == [1]


def test_a_transaction_that_was_asked_for_cannot_be_written_any_more(
    database: str, session: SureConnection
) -> None:
    key = "6f1c7c38-7c1c-4d5c-9d0e-6a2f60a3c111"
    assert session.execute("SELECT was_written(%s)", [key]).fetchone() == (False,)
    with psycopg.connect(plain(database)) as late:
        late.execute("INSERT INTO semmap.note VALUES (1)")
        with pytest.raises(psycopg.errors.UniqueViolation):
            late.execute("SELECT semmap.note_write(%s)", [key])
    assert notes(database) == []
    assert session.execute("SELECT was_written(%s)", [key]).fetchone() == (False,)


def test_a_transaction_that_reads_leaves_no_key(database: str, session: SureConnection) -> None:
    before = session.execute("SELECT count(*) FROM written").fetchone()
    with session.transaction():
        session.execute("SELECT count(*) FROM note")
    assert session.execute("SELECT count(*) FROM written").fetchone() == before


def test_an_error_of_a_statement_is_as_ever(session: SureConnection) -> None:
    with pytest.raises(psycopg.errors.DivisionByZero), session.transaction():
        session.execute("SELECT 1 / 0")
    assert not session.closed


def test_a_method_of_the_map_is_done_once_through_losses(database: str, wire: LossyWire) -> None:
    """Each is tried again where nothing was written, and never where it was."""
    random = Random(3)
    with semmap.connect(wire.url(database)) as db:
        place = db.create_map("flat")
        hall = place.add_room("hall", [(0, 0), (40, 0), (40, 3), (0, 3)], floor=0, ceiling=3)
        for number in range(12):
            wire.lose = random.choices(LOSSES, k=random.randint(1, 2))
            made = place.add_object(f"box{number}", size=(0.1, 0.1, 0.1), pose=(number, 1, 0.05))
            wire.lose = random.choices(LOSSES, k=1)
            made.move_to(number, 2, 0.05)
            assert made.pose is not None
            assert made.pose.y == 2
        place["box3"].delete()
        assert hall.contents
    assert wire.lost >= 24
    with psycopg.connect(plain(database)) as direct:
        row = direct.execute(
            "SELECT count(*), count(DISTINCT name) FROM semmap.entity WHERE kind = 'object'"
        ).fetchone()
    assert row == (11, 11)


@pytest.mark.parametrize("loss", LOSSES)
def test_a_transaction_of_the_user_is_not_done_again(
    loss: Loss, database: str, wire: LossyWire
) -> None:
    with semmap.connect(wire.url(database)) as db:
        place = db.create_map("flat")
        wire.lose = [loss]
        refused = pytest.raises(DatabaseError, match="nothing was written")
        with refused if loss == "request" else nullcontext(), place.transaction():
            place.add_room("hall", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=3)
        assert ("hall" in place) == (loss == "answer")


def test_a_session_that_the_server_ended_is_opened_again(database: str) -> None:
    with semmap.connect(database) as db, psycopg.connect(plain(database), autocommit=True) as other:
        place = db.create_map("flat")
        place.add_room("hall", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=3)
        for ask in (
            lambda: place["hall"].name,
            lambda: place.find(name="h*")[0].name,
            lambda: place.sql("SELECT name FROM entry")[0][0],
            lambda: db.sql("SELECT name FROM entity")[0][0],
        ):
            other.execute(ENDED)
            assert ask() == "hall"
        other.execute(ENDED)
        with pytest.raises(psycopg.OperationalError):  # it may have been one that writes
            place.execute("SELECT name FROM entity")
        assert place.execute("SELECT name FROM entity") == [("hall",)]

        def change() -> None:
            with place.transaction():
                place.add_room("den", [(4, 0), (8, 0), (8, 3), (4, 3)], floor=0, ceiling=3)
                other.execute(ENDED)
                place["hall"].label = "den"

        with pytest.raises(DatabaseError, match="nothing was written"):
            change()
        assert len(place) == 1


def test_a_loss_that_is_passed_over_in_a_transaction_is_told_at_its_end(
    database: str, session: SureConnection
) -> None:
    def write() -> None:
        with session.transaction():
            session.execute("INSERT INTO note VALUES (1)")
            with psycopg.connect(plain(database), autocommit=True) as other:
                other.execute(ENDED)
            with suppress(psycopg.OperationalError):
                session.execute("INSERT INTO note VALUES (2)")

    with pytest.raises(NotWrittenError):
        write()
    assert notes(database) == []


@contextmanager
def begun(place: semmap.Map) -> Iterator[None]:
    """A transaction of which the map is told nothing."""
    place.execute("BEGIN")
    yield
    place.execute("COMMIT")


BEGUN = {
    "undone in the end": lambda place: place.connection.transaction(force_rollback=True),
    "by the user": begun,
}


@pytest.mark.parametrize("begin", BEGUN)
def test_what_the_map_does_in_a_transaction_of_others_is_not_done_again(
    database: str, begin: str
) -> None:
    with semmap.connect(database) as db:
        place = db.create_map("flat")
        place.add_room("hall", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=3)

        def change() -> None:
            with BEGUN[begin](place):
                place.add_object("first", size=(0.1, 0.1, 0.1), pose=(1, 1, 0.05))
                with psycopg.connect(plain(database), autocommit=True) as other:
                    other.execute(ENDED)
                place.add_object("second", size=(0.1, 0.1, 0.1), pose=(2, 1, 0.05))

        with pytest.raises((psycopg.OperationalError, DatabaseError)):
            change()
        assert [each.name for each in place] == ["hall"]


def test_a_login_that_stores_no_keys_is_left_in_doubt_and_told_so(
    database: str, wire: LossyWire, session: SureConnection
) -> None:
    session.execute("GRANT INSERT ON note TO semmap_reader")
    session.execute("SET ROLE semmap_reader")
    wire.lose = ["answer"]
    with pytest.raises(UnsettledError, match="may not store its key"), session.transaction():
        session.execute("INSERT INTO note VALUES (1)")
    assert notes(database) == [1]


def test_a_commit_that_takes_long_is_left_alone_where_another_server_can_take_over(
    database: str, session: SureConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.execute(SLOW_COMMIT)
    monkeypatch.setattr("semmap.database.sure_connection.COMMIT_SECONDS", 0.3)
    with closing(open_session(with_another_server(database))) as several:
        with several.transaction():
            several.execute("INSERT INTO slow VALUES (1)")
            several.execute("INSERT INTO note VALUES (1)")
        assert several.closed  # it was not waited for
    assert notes(database) == [1]


def test_a_commit_that_no_standby_has_is_not_called_done(folder: Path) -> None:
    """PostgreSQL itself calls it done where the wait was cancelled: that is what is guarded."""
    cluster = Cluster(folder / "primary")
    url = cluster.ensure().set(drivername="postgresql").render_as_string(hide_password=False)
    try:
        open_engine(url).dispose()
        with psycopg.connect(url, autocommit=True) as admin:
            admin.execute("CREATE TABLE semmap.note (id integer)")
            admin.execute("ALTER SYSTEM SET synchronous_standby_names = 'nobody'")
            admin.execute("SELECT pg_reload_conf()")
            time.sleep(0.3)
        with psycopg.connect(url) as careless:
            careless.execute("INSERT INTO semmap.note VALUES (1)")
            threading.Timer(0.3, careless.cancel).start()
            careless.commit()  # no error
        session = open_session(url)

        def let_go() -> None:
            time.sleep(1.5)
            with psycopg.connect(url, autocommit=True) as admin:
                admin.execute("ALTER SYSTEM RESET synchronous_standby_names")
                admin.execute("SELECT pg_reload_conf()")

        helper = threading.Thread(target=let_go)
        helper.start()
        threading.Timer(0.3, session.cancel).start()
        began = time.monotonic()
        with session.transaction():
            session.execute("INSERT INTO semmap.note VALUES (2)")
        assert time.monotonic() - began > 1
        helper.join()
        assert notes(url) == [1, 2]
    finally:
        cluster.stop()


def test_where_nobody_can_be_asked_the_error_tells_the_key(
    database: str, wire: LossyWire, session: SureConnection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semmap.database.sure_connection.BUSY_SECONDS", 0.5)
    wire.lose = ["answer"]

    def write() -> None:
        with session.transaction():
            session.execute("INSERT INTO note VALUES (1)")
            wire.close()

    with pytest.raises(UnsettledError) as told:
        write()
    key = str(told.value).split("'")[1]
    with psycopg.connect(plain(database), autocommit=True) as direct:
        assert direct.execute("SELECT semmap.was_written(%s)", [key]).fetchone() == (True,)


def test_several_servers_of_which_one_refuses_the_login_are_not_waited_for(database: str) -> None:
    url = with_another_server(database, name="nowhere")
    began = time.monotonic()
    with pytest.raises(DatabaseError, match="does not exist"):
        open_session(url)
    assert time.monotonic() - began < 10


def test_a_url_of_several_servers_means_the_one_that_takes_writes(
    database: str, wire: LossyWire, session: SureConnection
) -> None:
    url = wire.url(database).replace("@127.0.0.1:", "@127.0.0.1:1,127.0.0.1:")
    with closing(open_session(url)) as other:
        assert other.info.dbname == sqlalchemy.make_url(database).database
        assert "host=127.0.0.1,127.0.0.1 port=1," in other.conninfo
    session.close()
    engine = open_engine(url)
    wire.lose = ["answer"]
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO semmap.note VALUES (1)"))
    with engine.connect() as connection:
        assert connection.execute(text("SELECT count(*) FROM semmap.note")).scalar() == 1
    engine.dispose()
