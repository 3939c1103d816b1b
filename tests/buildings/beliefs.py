"""The judge of beliefs: where things probably are, in a building whose truth is known."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager

import semmap
from tests.buildings.building import Building, Item, room_of

ELSEWHERE = "elsewhere"

ASKED = 6
"""How many things are asked about."""

SURE = 0.9
"""The least belief in a place that the map or somebody has just told."""

NOTHING = 0.002
"""The highest belief in a place where nothing can be."""


class _Undone(Exception):
    pass


@contextmanager
def undone(place: semmap.Map) -> Iterator[None]:
    """Whatever the block changes in the map is undone."""
    try:
        with place.transaction():
            yield
            raise _Undone
    except _Undone:
        pass


def judge_beliefs(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Things are believed where they are told and seen to be, and nothing is where it cannot be."""
    chance = random.Random(f"beliefs of {building.seed}")
    items = [item for item in building.items if item.what == "thing"]
    small = [item for item in items if item.on is not None]
    asked = {item.name: item for item in chance.sample(items, min(len(items), ASKED))}
    asked |= {item.name: item for item in chance.sample(small, min(len(small), 3))}
    wrong = []
    for item in asked.values():
        found = place.where(item.name)
        wrong += _judge_one(building, item, dict(found))
        wrong += [
            f"{item.name} may be in {row['place']} from the first ({row['prior']:.4f})"
            for row in found.rows
            if row["place"] in _impossible(building, item) and row["prior"] > NOTHING
        ]
    questions = len(asked)
    tables = {item.on for item in small}
    for item in chance.sample(small, min(len(small), 2)):
        others = sorted(tables - {item.on, item.name})
        if others:
            questions += 2
            wrong += _judge_seen(building, place, item, chance.choice(others))
    types = place.sql(
        "SELECT type, array_agg(name) FROM entity WHERE kind = 'object' AND map_id = current_map() "
        "AND name = ANY (%s) GROUP BY type HAVING type <> 'object' AND count(*) < 8 ORDER BY type",
        [item.name for item in items],
    )
    for type_, _ in types[:1]:
        questions += 1
        wrong += _judge_type(place, type_)
    return questions, wrong


def _judge_one(building: Building, item: Item, belief: dict[str, float]) -> Iterator[str]:
    known = {r.name for r in building.rooms} | {i.name for i in building.items} | {ELSEWHERE}
    if abs(sum(belief.values()) - 1) > 1e-9:
        yield f"the belief about {item.name} sums to {sum(belief.values())}"
    if set(belief) - known:
        yield f"{item.name} may be in {set(belief) - known}, which do not exist"
    here = {item.on} if item.on else room_of(building, item)
    share = sum(belief.get(name, 0.0) for name in here if name)
    if share < SURE:
        best = max(belief, key=lambda name: belief[name])
        yield f"{item.name} is in {here}, believed with {share:.3f}, in {best} {belief[best]:.3f}"
    for name in _impossible(building, item) & set(belief):
        if belief[name] > NOTHING:
            yield f"{item.name} may be in {name} ({belief[name]:.4f}), where nothing can be"


def _impossible(building: Building, item: Item) -> set[str]:
    """Where a thing cannot be: in lifts, on what hangs or bears nothing, on what it bears."""
    here = {item.on} if item.on else room_of(building, item)
    floors = [z for _, z, _ in building.storeys]
    hanging = {
        other.name
        for other in building.items
        if other.what != "thing"
        or (other.on is None and min(abs(other.low - z) for z in floors) > 1)
    }
    lifts = {room.name for room in building.rooms if room.elevator}
    bears = {other.name for other in building.items if other.on == item.name}
    return ((hanging | bears) | lifts | {item.name}) - here


def _judge_seen(building: Building, place: semmap.Map, item: Item, table: str) -> Iterator[str]:
    """A thing that is seen on another table is there, in the map too where it is seen exactly."""
    (top,) = (other for other in building.items if other.name == table)
    with undone(place):
        place.observe(item.name, table)
        found = place.where(item.name)
        if found.best != table or found[table] < SURE:
            yield f"{item.name} was seen on {table}, and is believed on {dict(found)}"
        place.observe(item.name, table, seen=False)
        if place.where(item.name)[table] >= found[table]:
            yield f"{item.name} was missed on {table}, and is believed there as before"
    with undone(place):
        middle = (*top.centre, top.high + (item.high - item.low) / 2)
        place.observe_point(item.name, middle)
        found = place.where(item.name)
        holder = place[item.name].holder
        if found.best != table or found[table] < SURE or holder is None or holder.name != table:
            yield f"{item.name} was seen at the middle of {table}, and is held by {holder}"


def _judge_type(place: semmap.Map, type_: str) -> Iterator[str]:
    """The belief about a type is the mean of those about its things."""
    names = [
        row[0]
        for row in place.sql(
            "SELECT e.name FROM entity e JOIN type_closure c ON c.sub = e.type "
            "WHERE c.super = %s AND e.kind = 'object' AND e.map_id = current_map()",
            type_,
        )
    ]
    whole, each = place.where(type_), [place.where(name) for name in names]
    for name in whole:
        mean = sum(one.get(name, 0.0) for one in each) / len(each)
        if abs(whole[name] - mean) > 1e-4:
            yield f"any {type_} is in {name} with {whole[name]:.5f}, its things with {mean:.5f}"
    if abs(sum(whole.values()) - 1) > 1e-9:
        yield f"the belief about any {type_} sums to {sum(whole.values())}"
