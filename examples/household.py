"""Weeks of use of any map: people move things by habit, and a robot looks for them on patrol.

    python examples/household.py house --weeks 4 --seed 1 --truth moves.jsonl
    semmap belief learn --hold-out 7 --draw calibration.png

Things of a type are alike in their habits: where they are put in the morning, by day and in the
evening, and how often. They are added to the map without a pose. The map gets what the robot saw
and did not see, and where it stood; the file gets the moves, which nobody told the map.
"""

from __future__ import annotations

import argparse
import json
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

import semmap

THINGS = ("mug", "mug", "mug", "book", "book", "remote", "bottle", "towel")
"""The types of the things of a household."""

TURNS = ((5.0, 9.0), (9.5, 13.0), (16.0, 19.0), (21.5, 24.0))
"""Hours between which a household gets up, begins its day and its evening, and goes to bed."""

ROUNDS = (6, 23)
"""Hours in which the robot goes round."""

AWAY = 0.05
"""The share of moves that take a thing out of the house."""

HIT, FALSE_ALARM = ((2.0, 0.85), (8.0, 0.5)), 0.004
"""How often a look from so near, metres, sees what is there; and what is not there."""

MOVES_A_DAY = (0.5, 6.0)
LOOKS_AN_HOUR = 2


class Move(NamedTuple):
    """A thing is put at a place, or away."""

    at: datetime
    thing: str
    place: str | None


class Look(NamedTuple):
    """A look for all things at a place, from so many metres; those that were seen."""

    at: datetime
    place: str
    distance: float
    seen: frozenset[str]


def live(
    random: Generator,
    things: Mapping[str, str],
    weights: Mapping[str, Mapping[str, float]],
    since: datetime,
    days: int,
) -> list[Move]:
    """The moves of things, by name and type, at places of these weights, oldest first.

    At night, nobody moves things.
    """
    turns = [float(random.uniform(*between)) for between in TURNS]
    parts = [*pairwise(turns)]
    habits: dict[str, tuple[list[dict[str, float]], float]] = {}
    moves = []
    for thing, kind in sorted(things.items()):
        places = list(weights[thing])
        if kind not in habits:
            rate = float(np.exp(random.uniform(*np.log(MOVES_A_DAY))))
            usual = np.array(list(weights[thing].values()))
            shares = random.dirichlet(3 * usual / usual.sum() + 0.02, len(parts))
            habits[kind] = [dict(zip(places, one, strict=True)) for one in shares], rate
        usual_shares, rate = habits[kind]
        own = [
            random.dirichlet([12 * share.get(place, 0.0) + 0.01 for place in places])
            for share in usual_shares
        ]
        moves.append(Move(since, thing, str(random.choice(places, p=own[-1]))))
        for day in range(days):
            for (start, end), shares in zip(parts, own, strict=True):
                for hour in np.sort(random.uniform(start, end, random.poisson(rate / len(parts)))):
                    at = since + timedelta(days=day, hours=float(hour))
                    place = str(random.choice(places, p=shares))
                    moves.append(Move(at, thing, None if random.random() < AWAY else place))
    return sorted(moves)


def patrol(
    random: Generator, moves: Sequence[Move], places: Sequence[str], since: datetime, days: int
) -> list[Look]:
    """The looks of a robot that goes round by day, at two places each hour."""
    tracks: dict[str, tuple[list[datetime], list[str | None]]] = {}
    for move in moves:
        times, stops = tracks.setdefault(move.thing, ([], []))
        times.append(move.at)
        stops.append(move.place)
    looks = []
    for hour in range(days * 24):
        if not ROUNDS[0] <= hour % 24 < ROUNDS[1]:
            continue
        for place in random.choice(places, LOOKS_AN_HOUR, replace=False):
            at = since + timedelta(hours=hour + float(random.uniform()))
            distance = float(random.uniform(0.5, HIT[-1][0]))
            hit = next(rate for furthest, rate in HIT if distance < furthest)
            seen = [
                thing
                for thing, (times, stops) in tracks.items()
                if random.random()
                < (hit if stops[bisect_right(times, at) - 1] == place else FALSE_ALARM)
            ]
            looks.append(Look(at, str(place), distance, frozenset(seen)))
    return sorted(looks)


def add_things(house: semmap.Map, types: Sequence[str] = THINGS) -> dict[str, str]:
    """Add things of these types to a map, without a pose; their types by name."""
    added = {}
    for number, kind in enumerate(types, 1):
        added[house.add_object(f"{kind} of use {number}", type=kind).name] = kind
    return added


def weights_of(house: semmap.Map, things: Sequence[str]) -> dict[str, dict[str, float]]:
    """The places of each thing in furniture, and how much each offers; ValueError if none does."""
    found: dict[str, dict[str, float]] = {thing: {} for thing in things}
    rows = house.execute(
        "SELECT t.name, p.name, w.weight FROM entity t, LATERAL places_for(ARRAY[t.id]) w "
        "JOIN entity p ON p.id = w.place_id AND p.kind = 'object' "
        "WHERE t.map_id = current_map() AND t.name = ANY (%s) ORDER BY 1, 2",
        list(things),
    )
    for thing, place, weight in rows:
        found[thing][place] = weight
    homeless = [thing for thing, places in found.items() if not places]
    if homeless:
        raise ValueError(f"{homeless[0]}: no furniture has room for it: choose another map")
    return found


def store(
    house: semmap.Map,
    looks: Sequence[Look],
    weights: Mapping[str, Mapping[str, float]],
    robot: str,
) -> None:
    """Store looks for all things with room there, and where the robot stood: beside each place."""
    house.execute(
        "INSERT INTO placement_history (entity_id, pose, relation, during) "
        "SELECT entity_id(%s), ARRAY[ST_X(c) + l.distance, ST_Y(c), 0, 0, 0, 0, 1], 'in', "
        "tstzrange(l.at, l.at + interval '1 s') "
        "FROM unnest(%s::timestamptz[], %s::text[], %s::float8[]) l (at, place, distance) "
        "JOIN world w ON w.entity_id = entity_id(l.place), LATERAL ST_Centroid(w.footprint) c",
        *(robot, [e.at for e in looks], [e.place for e in looks], [e.distance for e in looks]),
    )
    rows = [
        (thing, e.place, e.at, thing in e.seen)
        for e in looks
        for thing, places in weights.items()
        if e.place in places
    ]
    house.execute(
        "INSERT INTO observation (entity_id, place_id, at, seen, observer_id) "
        "SELECT t.id, p.id, l.at, l.seen, entity_id(%s) "
        "FROM unnest(%s::text[], %s::text[], %s::timestamptz[], %s::boolean[]) "
        "l (thing, place, at, seen) JOIN entity t ON t.map_id = current_map() AND t.name = thing "
        "JOIN entity p ON p.map_id = current_map() AND p.name = l.place",
        *(robot, *([row[column] for row in rows] for column in range(4))),
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("map", help="the name of a map with furniture")
    parser.add_argument("--weeks", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--truth", type=Path, default=Path("moves.jsonl"))
    chosen = parser.parse_args()
    random, days = np.random.default_rng(chosen.seed), 7 * chosen.weeks
    midnight = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    since = midnight - timedelta(days=days)
    with semmap.connect() as db, db.map(chosen.map).transaction():
        house = db.map(chosen.map)
        things = add_things(house)
        robot = house.add_agent("robot on patrol", type="robot").name
        weights = weights_of(house, list(things))
        moves = live(random, things, weights, since, days)
        places = sorted({place for own in weights.values() for place in own})
        looks = patrol(random, moves, places, since, days)
        store(house, looks, weights, robot)
    rows = [json.dumps(move._asdict() | {"at": move.at.isoformat()}) for move in moves]
    chosen.truth.write_text("\n".join([*rows, ""]))
    print(f"{len(things)} things, {len(moves)} moves, {len(looks)} looks")


if __name__ == "__main__":
    main()
