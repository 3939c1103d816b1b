"""The room of each entity of a map, by each way to ask for it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from urllib.parse import unquote

import semmap
from planner.readers.entity_lookup import find_entities

ROOMS = {
    "inventory": "entity e JOIN entity r ON r.id = room_of(e.id) AND r.id <> e.id",
    "is_in": "entity e JOIN world w ON w.entity_id = e.id JOIN world o ON o.map_id = w.map_id "
    "AND o.box && ST_Expand(w.box, 2) JOIN entity r ON r.id = o.entity_id "
    "AND r.kind = 'room' AND is_in(e.id, r.id)",
    "things_in": "entity r CROSS JOIN things_in(r.id) t JOIN entity e ON e.id = t "
    "AND r.kind = 'room'",
    "containers_of": "entity e CROSS JOIN containers_of(e.id) t JOIN entity r ON r.id = t "
    "AND r.kind = 'room'",
}
"""SQL of the pairs of an entity e and a room r."""

Said = dict[str, dict[str, set[str]]]
"""The rooms by entity and by way."""


def said_rooms(place: semmap.Map) -> Said:
    """What each way says of each entity that is no room; the planner of what it has a way to."""
    said: Said = {name: defaultdict(set) for name in _names(place, "kind <> 'room'")}

    def take(way: str, pairs: Iterable[tuple[str, str]]) -> None:
        for rooms in said.values():
            rooms[way] = set()
        for name, room in pairs:
            if name in said:
                said[name][way].add(room)

    for way, pairs in ROOMS.items():
        take(way, place.sql(f"SELECT e.name, r.name FROM {pairs} WHERE e.map_id = current_map()"))
    take("find", [(e.name, room.name) for room in place.rooms for e in place.find(in_=room.name)])
    take("SPARQL", _triples(place))
    for name in _names(place, "kind IN ('object', 'agent')"):
        with place.snapshot() as seen:
            (located,) = find_entities(seen, name)
        said[name]["planner"] = {located.place} - {None}
    return said


def disagreements(said: Said) -> list[str]:
    """A sentence for each entity of which the ways say different rooms, or more than one."""
    return [
        f"{name} is in {dict(rooms)}"
        for name, rooms in said.items()
        if any(one != rooms["inventory"] for one in rooms.values()) or len(rooms["inventory"]) > 1
    ]


def _names(place: semmap.Map, condition: str) -> list[str]:
    return [
        name
        for (name,) in place.sql(
            f"SELECT name FROM entity WHERE map_id = current_map() AND {condition}"
        )
    ]


def _triples(place: semmap.Map) -> Iterable[tuple[str, str]]:
    for row in place.sparql("SELECT ?e ?r { ?e semmap:in ?r . ?r a semmap:Room }").rows:
        name, room = (unquote(str(value).rpartition("#")[2]) for value in row)
        yield name, room
