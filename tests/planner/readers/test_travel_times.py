"""The ways in places, written and read, and the states for which they hold."""

import numpy as np
import pytest
from sqlalchemy import text

from planner.readers.robot_class import read_robot_class, read_robot_class_digest, store_robot_class
from planner.readers.travel_times import (
    MeasuredTravel,
    compute_place_digests,
    may_store_travel_times,
    read_place_digests,
    read_travel_times,
    store_measured_until,
    store_travel_times,
)
from planner.robot_class import RobotClass
from tests.seen import cursor, seen_by

OFFICES = {"office4", "office2"}
"""Where desk4 stands, and what lies below: of a thing's storey nothing is taken for granted."""


@pytest.fixture
def ids(connection):
    """Of what the office has, by name."""
    rows = connection.execute(text("SELECT name, id FROM entity WHERE map_id = current_map()"))
    return dict(rows.all())


@pytest.fixture
def robot(connection):
    return store_robot_class(connection, RobotClass("tester"))


def test_walks_are_read_as_they_were_kept_and_replaced_by_place(connection, ids, robot):
    lab, office = ids["lab1"], ids["office4"]
    first = [MeasuredTravel(lab, *sorted((ids["door1"], ids["entrance"])), 3.25, 2.5)]  # type: ignore[call-arg]
    second = [
        MeasuredTravel(office, *sorted((ids["door6"], ids["door7"])), 1e-3, np.pi),  # type: ignore[call-arg]
        MeasuredTravel(office, *sorted((ids["door6"], ids["door8"])), 7.0, 0.0),  # type: ignore[call-arg]
    ]
    store_travel_times(seen_by(connection), robot, first, {lab: "a"})
    store_travel_times(seen_by(connection), robot, second, {office: "b"})
    assert sorted(map(tuple, read_travel_times(seen_by(connection), robot))) == sorted(
        [*first, *second]
    )
    assert read_place_digests(seen_by(connection), robot) == {lab: "a", office: "b"}
    store_travel_times(seen_by(connection), robot, [], {office: "c"})
    assert [tuple(w) for w in read_travel_times(seen_by(connection), robot)] == first
    assert read_place_digests(seen_by(connection), robot) == {lab: "a", office: "c"}


def test_no_walks_are_an_empty_array(connection, robot):
    walks = read_travel_times(seen_by(connection), robot)
    assert walks.shape == (0,)
    assert walks.dtype.names == MeasuredTravel._fields


@pytest.mark.parametrize(
    ("change", "changed"),
    [
        ("UPDATE placement SET pose[1] = pose[1] + 0.1 WHERE entity_id = {desk4}", OFFICES),
        (
            "UPDATE connector SET width = width + 0.1 WHERE entity_id = {door6}",
            {"office4", "corridor3"},
        ),
        ("UPDATE connector SET state = 'locked' WHERE entity_id = {door6}", set()),
        ("UPDATE entity SET label = 'Office' WHERE id = {desk4}", set()),
        (
            "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', 'porter');"
            "INSERT INTO placement (entity_id) SELECT id FROM entity WHERE name = 'porter';"
            "UPDATE placement SET holder_id = (SELECT id FROM entity WHERE name = 'porter') "
            "WHERE entity_id = {muffin1}",
            OFFICES,
        ),
    ],
    ids=["a desk moves", "a door is wider", "a door is locked", "a label", "a muffin is carried"],
)
def test_the_state_of_a_place_is_that_of_what_walks_depend_on(connection, ids, change, changed):
    before = compute_place_digests(seen_by(connection), 0.0)
    for statement in change.format_map(ids).split(";"):
        connection.execute(text(statement))
    after = compute_place_digests(seen_by(connection), 0.0)
    names = {i: n for n, i in ids.items()}
    assert {names[place] for place in before if before[place] != after[place]} == changed
    some = [ids["office4"], ids["lab1"]]
    assert compute_place_digests(seen_by(connection), 0.0, some) == {
        place: after[place] for place in some
    }


def test_what_is_near_a_place_counts_within_reach(connection, ids):
    def state(reach):
        return compute_place_digests(seen_by(connection), reach, [ids["corridor3"]])[
            ids["corridor3"]
        ]

    near, far = state(0.0), state(2.0)
    connection.execute(
        text("UPDATE placement SET pose[3] = pose[3] + 0.01 WHERE entity_id = :desk"),
        {"desk": ids["desk4"]},
    )
    assert state(0.0) == near
    assert state(2.0) != far or state(4.0) != far


def test_what_changed_since_the_walks_comes_with_the_class(connection, ids, robot):
    assert read_robot_class(seen_by(connection), "tester").unmeasured is None
    store_measured_until(seen_by(connection), robot, cursor(seen_by(connection)))
    assert read_robot_class(seen_by(connection), "tester").unmeasured == frozenset()
    store_measured_until(
        seen_by(connection), robot, cursor(seen_by(connection))
    )  # replaces the former cursor


def test_walks_of_a_class_that_changed_are_not_kept(connection, robot):
    state = read_robot_class_digest(seen_by(connection), robot)
    assert may_store_travel_times(seen_by(connection), robot, state)
    assert not may_store_travel_times(seen_by(connection), robot, "another")
    connection.execute(text("SET TRANSACTION READ ONLY"))
    assert not may_store_travel_times(seen_by(connection), robot, state)
