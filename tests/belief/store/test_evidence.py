"""Beliefs of the database against the sum over all paths: stated, derived and observed facts."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from semmap import Map
from semmap.belief.store.beliefs import add_observations, read_belief, where
from tests.oracles.evidence import Fact, where_by_paths
from tests.seen import seen_by

NOW = datetime.now(UTC)
KITCHEN = ("counter", "fridge", "kitchen", "table")
HIT, FALSE_ALARM, STATED, DAY = 0.9, 1e-6, 0.95, 86_400.0
"""The numbers of a map that states none."""

SPOTS = {
    "table": (0, 0, 0.75),
    "counter": (0, 0, 0.9),
    "bench": (0, 0, 0.45),
    "fridge": (0, 0, 0.5),
    "kitchen": (2, 0.2, 0),
    "hall": (2, 1, 0),
}
"""Where the coke is in the frame of each place, metres."""


def put(
    flat: Map, holder: str | None, spot: tuple[float, ...], since: datetime, until: datetime | None
) -> None:
    """Say where the coke was from a time until another, or still is."""
    pose = "{" + ",".join(map(str, (*spot, 0, 0, 0, 1))) + "}"
    if until is None:
        flat.execute(
            "INSERT INTO placement (entity_id, holder_id, pose, since) "
            "VALUES (entity_id('coke'), entity_id(%s), %s, %s)",
            *(holder, pose, since),
        )
    else:
        flat.execute(
            "INSERT INTO placement_history (entity_id, holder_id, pose, relation, during) "
            "VALUES (entity_id('coke'), entity_id(%s), %s, 'in', tstzrange(%s, %s))",
            *(holder, pose, since, until),
        )


def columns(flat: Map) -> tuple[dict[str, float], dict[str, float]]:
    """The prior and the belief about the coke now."""
    rows = where(seen_by(flat.connection), "coke")
    prior, found = ({row["place"]: row[key] for row in rows} for key in ("prior", "probability"))
    return prior, found


@pytest.mark.parametrize("seed", range(12))
def test_beliefs_are_the_sum_over_all_paths(flat: Map, seed: int) -> None:
    source = random.Random(seed)
    mobility = source.choice([0.0, 0.3, 1.0, 3.0])
    flat["coke"].properties = {"mobility": mobility}
    moves = source.choice([None, 3600.0])
    ages = sorted(source.choice([1.0, 1e3, 1e5, 1e6]) * source.random() for _ in range(9))
    facts, stays, rows = [], [], []
    for age in reversed(ages):
        at = NOW - timedelta(seconds=age)
        age = (NOW - at).total_seconds()  # in whole microseconds
        place = source.choice([*SPOTS])
        if source.random() < 0.4:
            stays.append((place, at))
            facts.append(Fact(-age, (place,)))
            continue
        row: dict[str, Any] = {"object": "coke", "place": place, "at": at}
        row["seen"] = source.random() < 0.6
        row["inside"] = place == "kitchen" and source.random() < 0.5
        row["visible"] = 1.0 if row["seen"] else source.uniform(0.1, 1)
        hit, alarm = HIT, FALSE_ALARM
        if source.random() < 0.5:
            hit, alarm = source.uniform(0.5, 0.9), source.uniform(0.01, 0.4)
            row |= {"hit": hit, "false_alarm": alarm}
        rows.append(row)
        rates = [row["visible"] * rate for rate in (hit, alarm)]
        there, elsewhere = rates if row["seen"] else [1 - rate for rate in rates]
        facts.append(Fact(-age, KITCHEN if row["inside"] else (place,), there, elsewhere))
    for (place, at), (_, until) in zip(stays, [*stays[1:], (None, None)], strict=True):
        put(flat, place, SPOTS[place], at, until)
    prior = {row["place"]: row["prior"] for row in where(seen_by(flat.connection), "coke", NOW)}
    for row in source.sample(rows, len(rows)):  # in any order
        add_observations(flat.connection, [row])
    # The last stay at one place, of several that follow each other, is what counts.
    said = [fact for fact in facts if fact.there is None]
    after = [*said[1:], None]
    last = [a for a, b in zip(said, after, strict=True) if b is None or a.places != b.places]
    facts = [fact for fact in facts if fact.there is not None or fact in last]
    rate = max(mobility, 1e-30)
    expected = where_by_paths(prior, facts, 0.0, (moves or DAY) / rate, STATED)
    found = read_belief(seen_by(flat.connection), "coke", NOW, moves)
    assert found == pytest.approx(expected, abs=1e-9)


def test_what_was_put_into_a_storey_is_where_its_pose_is(flat: Map) -> None:
    flat.add_storey("ground", elevation=-1, height=3.7)  # on whose floor no room is
    flat.execute("SELECT put(entity_id('kitchen'), entity_id('ground'))")
    put(flat, None, (1, 1, 1.2), datetime.now(UTC), None)
    flat.execute("SELECT set_config('semmap.deriving', 'on', true)")
    flat.execute("SELECT put(entity_id('coke'), entity_id('ground'))")
    prior, found = columns(flat)
    facts = [Fact(0.0, ("kitchen",))]  # where it was just before, and now
    assert found == pytest.approx(where_by_paths(prior, facts, 0.0, DAY, STATED), abs=1e-3)


@pytest.mark.parametrize(
    ("spot", "place"),
    [((2, 0.2, 0), "kitchen"), ((1.5, 1.5, 0.76), "table"), ((1, 1, 9), "elsewhere")],
)
def test_a_pose_alone_tells_the_place(
    flat: Map, spot: tuple[float, float, float], place: str
) -> None:
    put(flat, None, spot, datetime.now(UTC), None)
    flat.execute("SELECT set_config('semmap.deriving', 'on', true)")
    flat.execute("SELECT put(entity_id('coke'), NULL)")
    prior, found = columns(flat)
    expected = where_by_paths(prior, [Fact(0.0, (place,))], 0.0, DAY, STATED)
    assert found == pytest.approx(expected, abs=1e-3)
