"""What a robot's login tries in order to stop others, or to state what cannot be."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import psycopg
import pytest
from psycopg import errors
from sqlalchemy import Engine

import semmap
from semmap.database import as_reader
from tests.waiting import wait_until

Login = psycopg.Connection[tuple[Any, ...]]
ROBOTS = [f"hostile{number}_{os.getpid()}" for number in range(3)]
SCENE = f"""
INSERT INTO map (name) VALUES ('m');
INSERT INTO entity (map_id, kind, name)
    SELECT m.id, v.kind, v.name FROM map m, (VALUES ('room', 'lab'), ('connector', 'door'),
        ('object', 'mug'), ('object', 'cup'), ('agent', '{ROBOTS[0]}')) v (kind, name);
INSERT INTO room (entity_id) SELECT id FROM entity WHERE name = 'lab';
INSERT INTO connector (entity_id, place_a, pose_a, pose_b)
    SELECT d.id, r.id, planar_pose(0, 0), planar_pose(0, 0) FROM entity d, entity r
    WHERE d.name = 'door' AND r.name = 'lab';
INSERT INTO placement (entity_id) SELECT id FROM entity WHERE kind <> 'connector';
"""
TURN = "SELECT pg_advisory_xact_lock(0, hashtext('semmap.placement'))"


@pytest.fixture(scope="module")
def login(module_engine: Engine) -> Iterator[Callable[[str | None], Login]]:
    """Opens a session of a robot's own login, or of the owner; all are closed at the end."""
    reader = as_reader(module_engine)
    if reader is None:
        pytest.skip("logs in on an embedded database")
    reader.dispose()
    with module_engine.begin() as connection:
        connection.exec_driver_sql(SCENE)
        for name in ROBOTS:
            connection.exec_driver_sql(f"CREATE ROLE {name} LOGIN IN ROLE semmap_robot")
        users = Path(connection.exec_driver_sql("SHOW ident_file").scalar_one())
        known = users.read_text()
        owner = known.splitlines()[0].split()[1]
        entries = [f"semmap {user} {name}\n" for name in ROBOTS for user in (owner, "root")]
        users.write_text(known + "".join(entries))
        connection.exec_driver_sql("SELECT pg_reload_conf()")
    url = module_engine.url.set(drivername="postgresql")
    opened: list[Login] = []

    def connect(name: str | None = None) -> Login:
        own = url if name is None else url.set(username=name)
        session = psycopg.connect(
            own.render_as_string(hide_password=False), options="-c search_path=semmap,public"
        )
        opened.append(session)
        return session

    def works() -> bool:
        try:
            connect(ROBOTS[0])
        except psycopg.OperationalError:
            return False
        return True

    wait_until(works)
    yield connect
    for session in opened:
        session.close()
    users.write_text(known)
    with module_engine.begin() as connection:
        connection.exec_driver_sql("SELECT pg_reload_conf()")
        connection.exec_driver_sql("DELETE FROM map")
        for name in ROBOTS:
            connection.exec_driver_sql(f"DROP ROLE {name}")


@pytest.fixture
def robot(login: Callable[[str | None], Login]) -> Iterator[Login]:
    session = login(ROBOTS[0])
    yield session
    session.close()


@pytest.fixture
def owner(login: Callable[[str | None], Login]) -> Iterator[Login]:
    session = login(None)
    session.autocommit = True
    yield session
    session.close()


def moves(session: Login, seconds: float) -> int:
    """How often a session moves the cup in that time."""
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        session.execute("SELECT move_to(entity_id('cup'), %s, 0, 0)", [count % 7])
        count += 1
    return count


def hold_turns(
    login: Callable[[str | None], Login], turn: str, seconds: float, stop: Event
) -> list[Any]:
    """Starts three robots that take the turn and hold it for so long, again and again."""

    def hold(name: str) -> None:
        while not stop.is_set():
            try:
                with login(name) as own:
                    while not stop.is_set():
                        own.execute(turn)
                        stop.wait(seconds)
                        own.rollback()
                        own.execute("SELECT pg_advisory_unlock_all()")
                        own.rollback()
            except psycopg.OperationalError:
                pass  # its session was ended

    pool = ThreadPoolExecutor(3)
    started = [pool.submit(hold, name) for name in ROBOTS]
    pool.shutdown(wait=False)
    return started


@pytest.mark.parametrize(
    ("turn", "seconds"),
    [
        (TURN, 1000.0),
        (TURN, 0.9),
        (TURN.replace("xact_", ""), 1000.0),
        ("SELECT move_to(entity_id('mug'), 500, 500, 0)", 1000.0),
    ],
)
def test_robots_that_hold_the_turn_do_not_stop_others(
    login: Callable[[str | None], Login], owner: Login, turn: str, seconds: float
) -> None:
    """Where others waited for the robots, these were one or two moves."""
    stop = Event()
    started = hold_turns(login, turn, seconds, stop)
    time.sleep(0.5)
    count = moves(owner, 5)
    stop.set()
    for each in started:
        each.result()
    assert count > 50


HELD = {
    "a row": "SELECT FROM placement WHERE entity_id = entity_id('cup') FOR UPDATE",
    "a table": "LOCK TABLE entity_model",
}
MOVE = "SELECT move_to(entity_id('cup'), random(), 5, 0)"


@pytest.mark.parametrize("held", HELD)
def test_an_idle_robot_that_keeps_others_waiting_is_ended(
    login: Callable[[str | None], Login], robot: Login, owner: Login, held: str
) -> None:
    reader = login(ROBOTS[1])
    reader.execute("SELECT count(*) FROM placement")  # nobody waits for it
    reader.execute("SELECT pg_advisory_xact_lock(7)")
    robot.execute("SET idle_in_transaction_session_timeout = 0")
    robot.execute(HELD[held])
    begin = time.monotonic()
    with pytest.raises(errors.LockNotAvailable):
        owner.execute(MOVE)
    robot.execute("SELECT 1")
    time.sleep(10.1)
    owner.execute(MOVE)
    assert time.monotonic() - begin < 25
    with pytest.raises(psycopg.OperationalError, match="administrator command"):
        robot.execute("SELECT 1")
    reader.execute("SELECT 1")
    reader.close()


def test_the_api_tries_again_where_a_robot_is_in_the_way(
    module_engine: Engine, login: Callable[[str | None], Login], robot: Login
) -> None:
    robot.execute(HELD["a row"])
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as db:
        db.map("m")["cup"].move_to(3, 3, 0)
        pose = db.map("m")["cup"].pose
        assert pose is not None
        assert (pose.x, pose.y) == (3, 3)


def test_a_robot_does_not_keep_importers_waiting(robot: Login, owner: Login) -> None:
    turn = "SELECT pg_advisory_xact_lock(hashtext('semmap.import'))"
    robot.execute(turn)
    time.sleep(10.1)
    owner.execute("SELECT queue_writer()")
    owner.execute("SET lock_timeout = '1s'")
    owner.execute(turn)


@pytest.mark.skipif("SEMMAP_SOAK" not in os.environ, reason="a minute: make soak")
def test_a_robot_that_is_never_idle_is_ended(robot: Login, owner: Login) -> None:
    robot.execute(HELD["a row"])
    begin = time.monotonic()
    while time.monotonic() < begin + 61:
        robot.execute("SELECT 1")
        time.sleep(0.5)
    owner.execute("SET lock_timeout = '1s'")
    owner.execute(MOVE)
    with pytest.raises(psycopg.OperationalError, match="administrator command"):
        robot.execute("SELECT 1")


@pytest.mark.parametrize(
    "call", ["hold_still(lab, NULL)", "move_to(lab, 1, 1, 0)", "put(lab, NULL)"]
)
def test_rights_come_before_the_turn(robot: Login, owner: Login, call: str) -> None:
    with owner.transaction():
        owner.execute(TURN)
        begin = time.monotonic()
        with pytest.raises(errors.InsufficientPrivilege):
            robot.execute(f"SELECT {call} FROM entity_id('lab') lab")
        assert time.monotonic() - begin < 0.5


REFUSED = {
    "a pose beyond the map": "SELECT move_to(entity_id('mug'), 99999, 0, 0)",
    "a placement beyond the map": (
        "UPDATE placement SET pose = planar_pose(0, -10001) WHERE entity_id = entity_id('mug')"
    ),
    "large properties": (
        "UPDATE entity SET properties = jsonb_build_object('x', repeat('x', 65536)) "
        "WHERE name = 'mug'"
    ),
    "a large label": "UPDATE entity SET label = repeat('x', 65537) WHERE name = 'mug'",
    "an object with large properties": (
        "INSERT INTO entity (map_id, kind, name, properties) "
        "SELECT id, 'object', 'x', jsonb_build_object('x', repeat('x', 65536)) FROM map"
    ),
    "a link with large properties": (
        "INSERT INTO link SELECT entity_id('mug'), 'near', entity_id('cup'), "
        "jsonb_build_object('x', repeat('x', 65536))"
    ),
    "a passage of a year": (
        "INSERT INTO execution (behaviour, entity_id, seconds, succeeded) "
        "VALUES ('pass_door', entity_id('door'), 3e7, true)"
    ),
    "a ride to nowhere": (
        "INSERT INTO execution (behaviour, entity_id, seconds, height, succeeded) "
        "VALUES ('ride', entity_id('door'), 1, 'NaN', true)"
    ),
    "a door seen before 1970": "UPDATE connector SET state = 'open', seen_at = '1969-01-01'",
    "a mission of the future": "{mission}; UPDATE mission SET heartbeat = '2999-01-01'",
    "a mission ended before 1970": (
        "{mission}; UPDATE mission SET state = 'done', ended_at = '1969-01-01'"
    ),
    "a step of the future": (
        "{mission}; INSERT INTO mission_step (mission_id, number, action, arguments, command, "
        "state, started_at) SELECT id, 1, 'x', '{{}}', '{{}}', 'started', '2999-01-01' FROM mission"
    ),
    "a step that ends before it starts": (
        "{mission}; INSERT INTO mission_step (mission_id, number, action, arguments, command, "
        "state, started_at, ended_at) SELECT id, 1, 'x', '{{}}', '{{}}', 'done', "
        "now() - interval '1 minute', now() - interval '2 minutes' FROM mission"
    ),
    "a task before 1970": (
        "INSERT INTO task (map_id, robot_id, kind, entity_id, outcome, created_at) "
        f"SELECT id, entity_id('{ROBOTS[0]}'), 'put', entity_id('mug'), 'to run', '1969-01-01' "
        "FROM map"
    ),
    "a fact of the future": (
        "INSERT INTO statement (map_id, subject, predicate, object, tag, since) "
        "SELECT id, 'urn:a', 'urn:b', 'c', 'I', '2999-01-01' FROM map"
    ),
    "a long text": "SELECT term_ids(ARRAY[repeat('a', 65537)], ARRAY['I'])",
}
MISSION = (
    "INSERT INTO mission (map_id, robot_id, goal) "
    f"SELECT id, entity_id('{ROBOTS[0]}'), 'on(mug, cup)' FROM map"
)


@pytest.mark.parametrize("attack", REFUSED)
def test_limits_on_what_a_robot_states(robot: Login, attack: str) -> None:
    *before, last = REFUSED[attack].format(mission=MISSION).split("; ")
    for statement in before:
        robot.execute(statement)
    with pytest.raises(errors.CheckViolation, match="a robot states"):
        robot.execute(last)


def test_an_admin_states_what_a_robot_may_not(owner: Login) -> None:
    for statement in REFUSED.values():
        with owner.transaction(force_rollback=True):
            owner.execute("SET LOCAL ROLE semmap_admin")
            for part in statement.format(mission=MISSION).split("; "):
                owner.execute(part)


FORGED = {
    "before the move": "SET semmap.deriving = 'on'; SELECT move_to(entity_id('mug'), 1, 1, 0)",
    "in the move": (
        "UPDATE placement SET pose = planar_pose(2, 2) WHERE entity_id = entity_id('mug') "
        "AND set_config('semmap.deriving', 'on', false) = 'on'"
    ),
    "beneath a trigger": (
        "CREATE TEMPORARY TABLE mine (id bigint); "
        "CREATE FUNCTION pg_temp.move() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        "PERFORM set_config('semmap.deriving', 'on', false), "
        "semmap.move_to(semmap.entity_id('mug'), 3, 3, 0) $SEMI$ RETURN NULL $SEMI$ END $$; "
        "CREATE TRIGGER move AFTER INSERT ON mine EXECUTE FUNCTION pg_temp.move(); "
        "INSERT INTO mine VALUES (1)"
    ),
}


@pytest.mark.parametrize("how", FORGED)
def test_a_robot_does_not_pass_its_moves_off_as_derived(robot: Login, how: str) -> None:
    for statement in FORGED[how].split("; "):
        robot.execute(statement.replace("$SEMI$", ";"))
    reasons = robot.execute(
        "SELECT DISTINCT reason FROM placement_history WHERE entity_id = entity_id('mug')"
    ).fetchall()
    assert reasons == [(None,)]


def test_a_robot_does_not_hide_a_change(robot: Login) -> None:
    robot.execute("SET semmap.dropping = 'on'")
    robot.execute("INSERT INTO link SELECT entity_id('mug'), 'near', entity_id('cup')")
    told = robot.execute(
        "SELECT what FROM change WHERE xid = pg_current_xact_id()::text::bigint"
    ).fetchall()
    assert told == [("linked",)]


STATE = (
    "INSERT INTO statement (map_id, subject, predicate, object, tag, until) "
    "SELECT id, 'urn:a', %s, 'c', 'I', %s::timestamptz FROM map"
)


@pytest.mark.parametrize(
    "change",
    [
        "DELETE FROM statement",
        "UPDATE statement SET until = now()",
        "UPDATE statement SET object = 'd'",
        "UPDATE statement SET stated_by = current_user",
    ],
)
def test_a_robot_takes_back_its_own_statements_alone(
    login: Callable[[str | None], Login], robot: Login, owner: Login, change: str
) -> None:
    other = login(ROBOTS[1])
    for session, predicate in ((owner, "urn:owner"), (other, "urn:other"), (robot, "urn:own")):
        session.execute(STATE, [predicate, None])
    other.commit()
    robot.execute("UPDATE statement SET stated_by = 'nobody' WHERE predicate = 'urn:own'")
    robot.commit()
    other.close()
    for predicate in ("urn:owner", "urn:other"):
        with pytest.raises(errors.InsufficientPrivilege, match="stated it"):
            robot.execute(f"{change} WHERE predicate = %s", [predicate])
        robot.rollback()
    assert robot.execute(f"{change} WHERE predicate = 'urn:own'").rowcount == 1
    robot.rollback()
    assert owner.execute("DELETE FROM statement").rowcount == 3


def test_a_robot_deletes_statements_that_have_ended(robot: Login, owner: Login) -> None:
    owner.execute(STATE, ["urn:owner", "2020-01-01"])
    assert robot.execute("DELETE FROM statement").rowcount == 1
    robot.commit()
