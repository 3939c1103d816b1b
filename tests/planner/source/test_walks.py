"""The ways in places, written and read, and the states for which they hold."""

import numpy as np
import pytest
from sqlalchemy import text

from planner.robot_class import RobotClass
from planner.source.robot_class import class_state, keep_robot_class, read_robot_class
from planner.source.walks import (
    Walk,
    keep_walked_until,
    keep_walks,
    may_keep,
    place_digests,
    read_walks,
    walked_digests,
)
from semmap.query.change_feed import cursor

OFFICES = {"office4", "office2"}
"""Where desk4 stands, and what lies below: of a thing's storey nothing is taken for granted."""


@pytest.fixture
def ids(connection):
    """Of what the office has, by name."""
    rows = connection.execute(text("SELECT name, id FROM entity WHERE map_id = current_map()"))
    return dict(rows.all())


@pytest.fixture
def robot(connection):
    return keep_robot_class(connection, RobotClass("tester"))


def test_walks_are_read_as_they_were_kept_and_replaced_by_place(connection, ids, robot):
    lab, office = ids["lab1"], ids["office4"]
    first = [Walk(lab, *sorted((ids["door1"], ids["entrance"])), 3.25, 2.5)]
    second = [Walk(office, *sorted((ids["door6"], ids["door7"])), 1e-3, np.pi),
              Walk(office, *sorted((ids["door6"], ids["door8"])), 7.0, 0.0)]  # fmt: skip
    keep_walks(connection, robot, first, {lab: "a"})
    keep_walks(connection, robot, second, {office: "b"})
    assert sorted(map(tuple, read_walks(connection, robot))) == sorted([*first, *second])
    assert walked_digests(connection, robot) == {lab: "a", office: "b"}
    keep_walks(connection, robot, [], {office: "c"})
    assert [tuple(w) for w in read_walks(connection, robot)] == first
    assert walked_digests(connection, robot) == {lab: "a", office: "c"}


def test_no_walks_are_an_empty_array(connection, robot):
    walks = read_walks(connection, robot)
    assert walks.shape == (0,)
    assert walks.dtype.names == Walk._fields


@pytest.mark.parametrize(
    ("change", "changed"),
    [
        ("UPDATE placement SET pose[1] = pose[1] + 0.1 WHERE entity_id = {desk4}", OFFICES),
        ("UPDATE connector SET width = width + 0.1 WHERE entity_id = {door6}",
         {"office4", "corridor3"}),
        ("UPDATE connector SET state = 'locked' WHERE entity_id = {door6}", set()),
        ("UPDATE entity SET label = 'Office' WHERE id = {desk4}", set()),
        ("INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', 'porter');"
         "INSERT INTO placement (entity_id) SELECT id FROM entity WHERE name = 'porter';"
         "UPDATE placement SET holder_id = (SELECT id FROM entity WHERE name = 'porter') "
         "WHERE entity_id = {muffin1}", OFFICES),
    ],
    ids=["a desk moves", "a door is wider", "a door is locked", "a label", "a muffin is carried"],
)  # fmt: skip
def test_the_state_of_a_place_is_that_of_what_walks_depend_on(connection, ids, change, changed):
    before = place_digests(connection, 0.0)
    for statement in change.format_map(ids).split(";"):
        connection.execute(text(statement))
    after = place_digests(connection, 0.0)
    names = {i: n for n, i in ids.items()}
    assert {names[place] for place in before if before[place] != after[place]} == changed
    some = [ids["office4"], ids["lab1"]]
    assert place_digests(connection, 0.0, some) == {place: after[place] for place in some}


def test_what_is_near_a_place_counts_within_reach(connection, ids):
    def state(reach):
        return place_digests(connection, reach, [ids["corridor3"]])[ids["corridor3"]]

    near, far = state(0.0), state(2.0)
    connection.execute(
        text("UPDATE placement SET pose[3] = pose[3] + 0.01 WHERE entity_id = :desk"),
        {"desk": ids["desk4"]},
    )
    assert state(0.0) == near
    assert state(2.0) != far or state(4.0) != far


def test_what_changed_since_the_walks_comes_with_the_class(connection, ids, robot):
    assert read_robot_class(connection, "tester").unwalked is None
    keep_walked_until(connection, robot, cursor(connection))
    assert read_robot_class(connection, "tester").unwalked == frozenset()
    keep_walked_until(connection, robot, cursor(connection))  # anew, in place of the former


def test_walks_of_a_class_that_changed_are_not_kept(connection, robot):
    state = class_state(connection, robot)
    assert may_keep(connection, robot, state)
    assert not may_keep(connection, robot, "another")
    connection.execute(text("SET TRANSACTION READ ONLY"))
    assert not may_keep(connection, robot, state)
