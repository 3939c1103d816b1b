"""Which objects of a map were detected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import nullcontext
from datetime import UTC, datetime

import pytest
from sqlalchemy import Connection

from semmap import Map
from semmap.belief.error import BeliefError
from semmap.belief.identify import FALSE_ALARM, NEW, Detection, identify
from semmap.belief.motion import MotionModel
from semmap.belief.store.beliefs import add_observations, read_belief
from semmap.database.maps import driver_of, see_map
from tests.seen import seen_by

ON_BENCH, ON_TABLE = (6.0, 1.0, 0.5), (1.5, 1.5, 0.8)
SELDOM = MotionModel(1e12)


@pytest.fixture
def connection(flat_map: Map) -> Iterator[Connection]:
    """Sees the flat, in which the mug was seen on the bench six times; all is undone."""
    with flat_map.database.engine.connect() as connection:
        see_map(connection, "flat")
        seen = {"object": "mug", "place": "bench", "seen": True, "at": datetime.now(UTC)}
        add_observations(driver_of(connection), [seen] * 6)
        yield connection
        connection.rollback()


def test_a_mug_where_it_was_seen_is_that_one(connection: Connection) -> None:
    (one,) = identify(seen_by(connection), [Detection("mug", ON_BENCH)])
    assert one.place == "bench"
    assert list(one.known) == ["mug"]
    assert one.known["mug"] > 0.95
    assert sum(one.may_be.values()) == pytest.approx(1)


def test_a_mug_elsewhere_is_new_unless_the_known_one_may_have_moved(
    connection: Connection,
) -> None:
    (one,) = identify(seen_by(connection), [Detection("mug", ON_TABLE)], motion=SELDOM)
    assert one.place == "table"
    assert one.new > 0.95
    (one,) = identify(seen_by(connection), [Detection("mug", ON_TABLE)], motion=MotionModel(1e-9))
    belief = read_belief(seen_by(connection), "mug")["table"]
    assert one.known["mug"] > 0.3 > belief


def test_two_mugs_are_two(connection: Connection) -> None:
    two = [Detection("mug", ON_TABLE), Detection("mug", ON_BENCH)]
    on_table, on_bench = identify(seen_by(connection), two)
    assert on_bench.known["mug"] > 0.95
    assert on_table.new > 0.95
    assert on_table.known.get("mug", 0) + on_bench.known["mug"] <= 1


@pytest.mark.parametrize(
    ("away", "sides", "message"),
    [
        (0.0, None, "detections 0 and 1 of one view are both of a mug at"),
        (0.03, (0.08, 0.08, 0.1), "send each object once"),
        (0.03, None, None),
        (0.09, (0.08, 0.08, 0.1), None),
    ],
)
def test_two_of_a_type_at_one_point_are_refused(
    connection: Connection,
    away: float,
    sides: tuple[float, float, float] | None,
    message: str | None,
) -> None:
    x, y, z = ON_TABLE
    two = [Detection("mug", ON_TABLE, sides), Detection("mug", (x + away, y, z), sides)]
    with nullcontext() if message is None else pytest.raises(BeliefError, match=message):
        assert len(identify(seen_by(connection), two)) == 2


def test_a_mug_of_another_size_is_new(connection: Connection) -> None:
    large, same = (
        identify(seen_by(connection), [Detection("mug", ON_BENCH, sides)])[0]
        for sides in ((0.3, 0.3, 0.3), (0.08, 0.08, 0.1))
    )
    assert large.known["mug"] < 0.01
    assert large.new > 0.97
    assert same.known["mug"] > 0.95


def test_types_are_those_of_the_t_box(connection: Connection) -> None:
    drinkware, book = identify(
        seen_by(connection), [Detection("drinkware", ON_BENCH), Detection("book", ON_BENCH)]
    )
    assert drinkware.known["mug"] > 0.95
    assert (book.place, book.known) == (None, {})
    assert book.may_be == {NEW: pytest.approx(45 / 46), FALSE_ALARM: pytest.approx(1 / 46)}


def test_a_point_in_the_frame_of_the_robot(connection: Connection) -> None:
    """The robot is at (7, 2): the bench is 1 m behind it and 1 m to its right."""
    (one,) = identify(seen_by(connection), [Detection("mug", (-1.0, -1.0, 0.5))], frame="robot")
    assert one.place == "bench"


@pytest.mark.parametrize(
    ("detection", "error", "text"),
    [
        (Detection("mugg", ON_BENCH), LookupError, "no type mugg; did you mean mug"),
        (Detection("mug", (99.0, 0.0, 0.0)), BeliefError, "where no place has room for it"),
        (Detection("mug", (math.nan, 0.0, 0.0)), BeliefError, "give x, y, z in metres"),
        (Detection("mug", ON_BENCH, (1.0, 0.0, 1.0)), BeliefError, "give metres above 0"),
    ],
)
def test_what_is_no_detection(
    connection: Connection, detection: Detection, error: type[Exception], text: str
) -> None:
    with pytest.raises(error, match=text):
        identify(seen_by(connection), [detection])


@pytest.mark.parametrize("rates", [{"hit": 0.1, "false_alarm": 0.2}, {"hit": 1.0}, {"new": 0.0}])
def test_rates_that_no_detector_has(connection: Connection, rates: dict[str, float]) -> None:
    with pytest.raises(BeliefError, match="give"):
        identify(seen_by(connection), [Detection("mug", ON_BENCH)], **rates)
