import pytest
from sqlalchemy import text

from semmap.database import open_engine
from semmap.database.maps import pick_map, see_map
from semmap.query.change_feed import ChangeFeed


@pytest.fixture
def maps(make_database):
    """A database with two maps."""
    engine = open_engine(make_database())
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('older'), ('newer')"))
    yield engine
    engine.dispose()


def shown(connection):
    return connection.execute(text("SELECT name FROM map WHERE id = current_map()")).scalar()


def test_the_map_of_a_name_is_seen_in_one_transaction(maps):
    with maps.connect() as connection:
        assert see_map(connection, "older") == "older"
        assert shown(connection) == "older"
        connection.rollback()
        with pytest.raises(LookupError, match="there are several maps: older, newer"):
            see_map(connection, None)


def test_a_missing_map_is_reported(make_database):
    engine = open_engine(make_database())
    with engine.connect() as connection, pytest.raises(LookupError, match="semmap import FILE"):
        see_map(connection, None)
    engine.dispose()


def test_a_map_of_another_name_is_missed_by_it(maps):
    with maps.connect() as connection:
        see_map(connection, "nope")
        with pytest.raises(LookupError, match="there is no map nope; there are: older, newer"):
            pick_map(connection)


def test_a_snapshot_does_not_see_concurrent_commits(maps):
    count = text("SELECT count(*) FROM map")
    with ChangeFeed(maps, "older").snapshot() as seen:
        assert seen.connection.execute(count).scalar() == 2
        with maps.begin() as other:
            other.execute(text("INSERT INTO map (name) VALUES ('newest')"))
        assert seen.connection.execute(count).scalar() == 2
    with ChangeFeed(maps, "older").snapshot() as seen:
        assert seen.connection.execute(count).scalar() == 3
