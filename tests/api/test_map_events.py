"""Events of a map: one for each change of an entity; replayed, they give the state of the map."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from psycopg import Rollback

import semmap
from semmap.database import Cluster
from tests.database.conftest import made, own
from tests.database.test_crash import kill_server
from tests.waiting import wait_until

__all__ = ["made", "own"]

WRITERS, STEPS = 3, 25


def now(map: semmap.Map) -> str:
    return str(map.execute("SELECT change_cursor()")[0][0])


def since(map: semmap.Map, cursor: str) -> list[tuple[Any, ...]]:
    """What, name, holders and reason of the events after a cursor."""
    return [
        (event.what, event.name, event.from_holder, event.to_holder, event.reason)
        for event in map.changes(cursor)
    ]


def test_a_move_is_one_event_also_where_the_holder_follows(flat: semmap.Map) -> None:
    mug, cursor = flat["mug7"], now(flat)
    before = mug.pose
    mug.move_to(6, 1, 0.05)
    (event,) = flat.changes(cursor)
    assert (event.what, event.name, event.kind, event.id) == ("moved", "mug7", "object", mug.id)
    assert (event.from_holder, event.to_holder) == ("desk4", "hall")
    assert event.reason == "moved itself"
    assert event.from_pose == pytest.approx(before)
    assert event.to_pose[:3] == pytest.approx((6, 1, 0.05))
    assert event.at.tzinfo is not None
    assert list(flat.changes(event.cursor)) == []


def test_what_is_held_is_carried(flat: semmap.Map) -> None:
    cursor = now(flat)
    flat["desk4"].move_to(2.2, 1.4, 0)
    assert since(flat, cursor) == [
        ("moved", "desk4", "kitchen", "kitchen", "moved itself"),
        ("moved", "mug7", "desk4", "desk4", "carried by its holder"),
    ]
    carried = list(flat.changes(cursor))[1]
    step = np.subtract(carried.to_pose[:3], carried.from_pose[:3])
    np.testing.assert_allclose(step, (0.2, -0.1, 0), atol=1e-9)


def test_a_holder_that_is_derived_again_or_given_is_told(flat: semmap.Map) -> None:
    flat.add_region("zone", shapely.box(0, 0, 4, 3), ceiling=2)
    cursor = now(flat)
    flat.execute("SELECT put(entity_id('desk4'), entity_id('zone'))")
    given = ("moved", "desk4", "kitchen", "zone", "given another holder")
    assert [row for row in since(flat, cursor) if row[1] == "desk4"] == [given]
    flat["zone"].delete()
    cursor = now(flat)
    flat["kitchen"].delete()
    told = since(flat, cursor)
    assert ("removed", "kitchen", "ground", None, None) in told
    assert ("removed", "door1", None, None, None) in [(*row[:2], None, None, None) for row in told]
    (desk,) = [row for row in told if row[1] == "desk4"]
    assert desk[:4] == ("moved", "desk4", "kitchen", "ground")
    cursor = now(flat)
    flat.execute("SELECT put(entity_id('mug7'), entity_id('ground'))")
    back = ("moved", "mug7", "desk4", "desk4", "holder derived again")
    assert since(flat, cursor) == [back], "it stands on the desk"


def test_changes_say_what_was_and_what_is(flat: semmap.Map) -> None:
    cursor, mug, door = now(flat), flat["mug7"], flat.doors["door1"]
    mug.type = "bottle"
    mug.name = "flask"
    door.state = "closed"
    mug.properties = {"colour": "blue", "gone": None}
    mug.label = "Ann's"
    told = [(e.what, e.name, e.reason, dict(e.values)) for e in flat.changes(cursor)]
    properties = ({"colour": "red"}, {"colour": "blue", "gone": None})
    assert told == [
        ("changed", "flask", "retyped", {"type": ("mug", "bottle")}),
        ("changed", "flask", "renamed", {"name": ("mug7", "flask")}),
        ("state", "door1", "state set", {"state": ("open", "closed")}),
        ("changed", "flask", "properties set", {"properties": properties}),
        ("changed", "flask", "labelled", {"label": (None, "Ann's")}),
    ]


def test_what_is_added_or_removed_is_one_event(flat: semmap.Map) -> None:
    cursor = now(flat)
    cup = flat.add_object("cup", type="mug", size=(0.1, 0.1, 0.1), on="desk4")
    (added,) = [event for event in flat.changes(cursor) if event.name == "cup"]
    assert (added.what, added.from_pose, added.to_holder) == ("added", None, "desk4")
    assert added.to_pose == pytest.approx(cup.pose)
    cursor, pose = now(flat), cup.pose
    cup.delete()
    (removed,) = flat.changes(cursor)
    assert (removed.what, removed.name, removed.kind) == ("removed", "cup", "object")
    assert (removed.from_holder, removed.to_pose) == ("desk4", None)
    assert removed.from_pose == pytest.approx(pose)


def test_a_transaction_is_one_event_for_each_entity(flat: semmap.Map) -> None:
    cursor, mug = now(flat), flat["mug7"]
    start = mug.pose
    with flat.transaction():
        mug.move_to(6, 1, 0.05)
        mug.move_to(7, 2, 0.05)
        mug.label = "a"
        mug.label = "b"
        flat.add_object("brief", size=(0.1, 0.1, 0.1), pose=(1, 1, 0)).delete()
    events = list(flat.changes(cursor))
    assert [(event.what, event.name) for event in events] == [
        ("moved", "mug7"),
        ("changed", "mug7"),
    ]
    assert events[0].from_pose == pytest.approx(start)
    assert events[0].to_pose[:2] == pytest.approx((7, 2))
    assert events[1].values == {"label": (None, "b")}


def test_each_cursor_goes_on_after_its_event(flat: semmap.Map, database: str) -> None:
    """Also where one transaction began before another and was committed after it."""
    cursor = now(flat)
    with semmap.connect(database) as other:
        late = other.map("flat")
        with late.transaction():
            late["door1"].label = "late"
            for number in range(4):
                flat["hall"].label = f"label{number}"
        flat["kitchen"].label = "last"
    events = list(flat.changes(cursor))
    assert Counter(event.name for event in events) == {"hall": 4, "door1": 1, "kitchen": 1}
    for number, event in enumerate(events):
        rest = [(e.name, e.at) for e in flat.changes(event.cursor)]
        assert rest == [(e.name, e.at) for e in events[number + 1 :]]


def test_another_map_and_field_changes_do_not_disturb(db: semmap.Database, flat: Any) -> None:
    cursor = now(flat)
    db.create_map("other").add_room("elsewhere", shapely.box(0, 0, 1, 1))
    assert list(flat.changes(cursor)) == []
    for given in ("now", "1:2", "1:2:x"):
        with pytest.raises(ValueError, match="is not a cursor"):
            list(flat.changes(given))


# --- a subscription


class Replay:
    """The state of a map that follows from events: poses, holders, names, states by id."""

    def __init__(self, map: semmap.Map) -> None:
        self.state = state_of(map)
        self.moves: Counter[str] = Counter()
        self.broken: list[str] = []
        self.lock = threading.Lock()

    def __call__(self, event: semmap.MapEvent) -> None:
        with self.lock:
            self.take(event)

    def take(self, event: semmap.MapEvent) -> None:
        former = self.state.get(event.id)
        if event.what == "added":
            self.note(event, former is not None)
            self.state[event.id] = {"pose": event.to_pose, "holder": event.to_holder}
        elif event.what == "removed":
            self.note(event, former is None or not same(former["pose"], event.from_pose))
            self.state.pop(event.id, None)
        elif event.what == "moved" and former is not None:
            self.note(event, not same(former["pose"], event.from_pose))
            self.note(event, former["holder"] != event.from_holder)
            former |= {"pose": event.to_pose, "holder": event.to_holder}
            self.moves[event.name or ""] += event.reason == "moved itself"
        elif event.what in ("changed", "state") and former is not None:
            for key, (old, new) in event.values.items():
                self.note(event, former.get(key) != old)
                former[key] = new

    def note(self, event: semmap.MapEvent, wrong: bool) -> None:
        if wrong:
            self.broken.append(f"{event} after {self.state.get(event.id)}")


def same(one: Any, other: Any) -> bool:
    return (one is None and other is None) or bool(np.allclose(one, other, atol=1e-9))


def state_of(map: semmap.Map) -> dict[int | None, dict[str, Any]]:
    rows = map.execute(
        "SELECT e.id, w.pose, h.name, e.label, c.state FROM entity e "
        "LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id "
        "LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN connector c ON c.entity_id = e.id "
        "WHERE e.map_id = current_map()"
    )
    return {
        number: {"pose": pose, "holder": holder, "label": label, "state": state}
        for number, pose, holder, label, state in rows
    }


def assert_equal(replayed: dict[Any, Any], real: dict[Any, Any]) -> None:
    assert replayed.keys() == real.keys()
    for number, known in real.items():
        told = replayed[number]
        assert same(told["pose"], known["pose"])
        assert told["holder"] == known["holder"]
        assert (told.get("label"), told.get("state", known["state"])) == (
            known["label"],
            known["state"],
        )


def write(database: str, seed: int, moved: Counter[str], lock: threading.Lock) -> None:
    """Random changes: moves, of what holds others too, doors, labels, additions, deletions."""
    rng = random.Random(seed)
    with semmap.connect(database) as db:
        map, own_names = db.map("flat"), []
        for step in range(STEPS):
            choice = rng.randrange(8)
            if choice < 4:
                name = rng.choice(["mug7", "desk4", "tray", *own_names])
                map[name].move_to(
                    rng.uniform(0.9, 7), rng.uniform(0.5, 2.5), rng.choice([0.0, 0.75, 0.05])
                )
                with lock:
                    moved[name] += 1
            elif choice == 4:
                map.doors["door1"].state = rng.choice(["open", "closed", "locked"])
            elif choice == 5:
                map["hall"].label = rng.choice(["a", "b", None])
            elif choice == 6:
                name = f"box{seed}_{step}"
                map.add_object(name, size=(0.1, 0.1, 0.1), pose=(rng.uniform(1, 7), 1, 0))
                own_names.append(name)
            elif own_names:
                map[own_names.pop(rng.randrange(len(own_names)))].delete()
            if rng.random() < 0.2:
                with map.transaction():
                    map["mug7"].move_to(1, 1, 0)
                    raise Rollback


@pytest.mark.parametrize("seed", [1, 2])
def test_several_writers_are_followed_change_by_change(
    flat: semmap.Map, database: str, seed: int
) -> None:
    flat.add_object("tray", size=(0.4, 0.3, 0.02), on="desk4")
    replay, moved, lock = Replay(flat), Counter(), threading.Lock()
    cursor = now(flat)
    with flat.subscribe(replay) as subscription:
        writers = [
            threading.Thread(target=write, args=(database, 10 * seed + n, moved, lock))
            for n in range(WRITERS)
        ]
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
        flat["kitchen"].label = "end"
        wait_until(lambda: replay.state[flat["kitchen"].id]["label"] == "end")
    assert not subscription.running
    assert replay.broken == []
    assert_equal(replay.state, state_of(flat))
    assert {k: n for k, n in replay.moves.items() if n} == dict(moved)
    # read in one go, they are the same
    events = [e for e in flat.changes(cursor) if e.what == "moved" and e.reason == "moved itself"]
    assert Counter(e.name for e in events if e.name in flat) == Counter(
        {name: n for name, n in moved.items() if name in flat}
    )


@pytest.mark.parametrize("end", [kill_server, Cluster.stop])
def test_a_restart_of_the_server_neither_skips_nor_repeats(
    own: Cluster, end: Callable[[Cluster], Any]
) -> None:
    seen: list[str | None] = []
    own.ensure()
    with semmap.connect(own, migrate=True) as db:
        yard = db.create_map("flat")
        yard.add_agent("robot", pose=(0, 0, 0))
        subscription = yard.subscribe(lambda event: seen.append(event.values["label"][1]))
        try:
            for number in range(3):
                yard["robot"].label = f"before{number}"
            wait_until(lambda: len(seen) == 3)
            end(own)
            own.ensure()
            with semmap.connect(own) as again:
                for number in range(3):
                    again.map("flat")["robot"].label = f"after{number}"
                wait_until(lambda: len(seen) >= 6)
                time.sleep(0.3)
                subscription.stop()
                again.drop_map("flat")
        finally:
            subscription.stop()
    assert seen == [f"before{n}" for n in range(3)] + [f"after{n}" for n in range(3)]


def test_an_error_of_the_function_ends_the_subscription(flat: semmap.Map) -> None:
    def fail(event: semmap.MapEvent) -> None:
        raise ValueError(f"cannot take {event.name}")

    subscription = flat.subscribe(fail)
    cursor = subscription.cursor
    flat["mug7"].label = "x"
    wait_until(lambda: not subscription.running)
    with pytest.raises(ValueError, match="cannot take mug7"):
        subscription.stop()
    assert subscription.cursor == cursor
    seen: list[str | None] = []
    with flat.subscribe(lambda event: seen.append(event.name), since=cursor):
        wait_until(lambda: seen == ["mug7"])


def test_a_subscription_can_stop_itself(flat: semmap.Map) -> None:
    seen: list[semmap.MapEvent] = []

    def once(event: semmap.MapEvent) -> None:
        seen.append(event)
        subscription.stop()

    subscription = flat.subscribe(once)
    flat["mug7"].label = "x"
    flat["mug7"].label = "y"
    wait_until(lambda: not subscription.running)
    subscription.stop()
    assert len(seen) == 1
