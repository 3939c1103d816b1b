"""The clock of the server jumps: history, changes and claims stay right."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import semmap
from planner.mission.store.missions import MissionStore
from semmap.database import Cluster
from tests.database.conftest import OWN_SERVER, ROOT
from tests.soak.clock import ABSENT, LIBRARY, movable_clock
from tests.soak.invariants import NEVER

pytestmark = pytest.mark.skipif(LIBRARY is None, reason=ABSENT)

SetClock = Callable[[str], None]
AGENTS = "robot", "other"


@pytest.fixture
def server(folder: Path) -> Iterator[tuple[semmap.Map, SetClock]]:
    """A map with two agents and a box, on a server whose clock can be set."""
    with movable_clock(folder) as set_clock:
        cluster = Cluster(folder / "home")
        cluster.home.mkdir()
        (cluster.home / "local.conf").write_text(OWN_SERVER)
        url = cluster.ensure().render_as_string(hide_password=False)
    with semmap.connect(url, migrate=True) as db:
        db.import_file(ROOT / "examples/office/office_rooms.geojson", map="office")
        found = db.map("office")
        for name in AGENTS:
            found.execute(
                "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', %s)", name
            )
        found.add_object("box", size=(0.2, 0.2, 0.2), pose=(1.0, 1.0, 0.0))
        yield found, set_clock


def ask(found: semmap.Map, statement: str, *values: Any) -> Any:
    return found.execute(statement, *values)[0][0]


def pose_now(found: semmap.Map, entity: int) -> Any:
    """The pose at a moment that is past when it is queried."""
    return ask(found, "SELECT (pose_at(%s, %s))[1]", entity, ask(found, "SELECT now()"))


@pytest.mark.parametrize("wrong", ["+1d", "+20y"])
def test_history_is_right_after_the_clock_was_ahead(
    server: tuple[semmap.Map, SetClock], wrong: str
) -> None:
    found, set_clock = server
    found.execute("UPDATE retention SET keep_for = '100 years'")
    box, cursor = found["box"], ask(found, "SELECT change_cursor()")
    for offset in ("+0", wrong, "+0"):
        set_clock(offset)
        for x in (2.0, 3.0, 4.0):
            box.move_to(x, 1.0, 0.1)
            box.map.execute("UPDATE entity SET label = %s WHERE id = %s", f"at {x}", box.id)
            assert pose_now(found, box.id) == x
    for rule, query in NEVER.items():
        assert not found.execute(query), rule
    assert [v.pose.x for v in box.history()][-3:] == [2.0, 3.0, 4.0]
    assert all(v.end is None or v.begin < v.end for v in box.history())
    assert len({event.cursor for event in found.changes(cursor)}) >= 18
    assert [each for each in found.check() if each.severity == "error"] == []


def test_a_deleted_entity_is_not_in_the_history_of_later_moments(
    server: tuple[semmap.Map, SetClock],
) -> None:
    found, set_clock = server
    box = found["box"]
    number = box.id
    set_clock("+1d")
    box.move_to(2.0, 1.0, 0.1)
    set_clock("+0")
    box.delete()
    assert pose_now(found, number) is None


def test_changes_of_a_clock_ahead_do_not_stop_the_retention(
    server: tuple[semmap.Map, SetClock],
) -> None:
    found, set_clock = server
    set_clock("+20y")
    for x in range(8):
        found["box"].move_to(float(x), 1.0, 0.1)
    set_clock("+0")
    before = ask(found, "SELECT count(*) FROM change WHERE at < now()")
    found.execute("DELETE FROM change WHERE at < now()")
    found["box"].move_to(1.0, 2.0, 0.1)
    found.execute("UPDATE retention SET keep_for = '1 us' WHERE kind = 'change'")
    assert before > 0
    assert ask(found, "SELECT prune_changes(5)") > 0


@pytest.mark.parametrize("jump", ["+1d", "-2h"])
def test_a_live_robot_keeps_its_claim(server: tuple[semmap.Map, SetClock], jump: str) -> None:
    found, set_clock = server
    with MissionStore(found, "one") as one, MissionStore(found, "two") as two:
        first, second = one.add("robot", "x"), two.add("other", "x")
        one.take(first)
        two.take(second)
        assert one.claim(first, ["door1"], 20.0) is None
        set_clock(jump)
        assert two.claim(second, ["door1"], 20.0) == "door1"
        assert one.beat(first, 20.0).claims == {"door1"}
        assert two.claim(second, ["door1"], 20.0) == "door1"


def test_the_claim_of_a_dead_robot_is_free_after_the_clock_was_ahead(
    server: tuple[semmap.Map, SetClock],
) -> None:
    found, set_clock = server
    with MissionStore(found, "two") as two:
        second = two.add("other", "x")
        two.take(second)
        with MissionStore(found, "one") as one:
            first = one.add("robot", "x")
            one.take(first)
            set_clock("+20y")
            assert one.claim(first, ["door1"], 20.0) is None
        set_clock("+0")
        assert two.claim(second, ["door1"], 20.0) is None
