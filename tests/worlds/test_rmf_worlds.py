"""The hotel and the clinic of Open-RMF: counts, doors, lifts, and lanes as witnesses."""

import itertools

import numpy as np
import pytest
import shapely
from shapely import LineString, Point

from semmap.ingest.rmf import read_rmf
from semmap.ingest.world import OUTSIDE

COUNTS = {
    "hotel": {"storey": 3, "elevator": 2, "doors": 19, "walls": 254, "lanes": 122, "places": 17},
    "clinic": {"storey": 2, "elevator": 4, "doors": 132, "walls": 619, "lanes": 169, "places": 30},
}
"""As the collection's own page states them."""

SELF_JOINING = {"hotel": 0, "clinic": 5}
"""Doors in a wall that stands free in one room, so that both sides are the same room."""


@pytest.fixture(scope="module", params=COUNTS)
def building(request, worlds):
    path = worlds / "rmf" / request.param / f"{request.param}.building.yaml"
    return Building(request.param, read_rmf(path))


class Building:
    def __init__(self, name, world):
        self.name, self.world = name, world
        self.entries = {e.name: e for e in world.entries}

    def of(self, kind, type_=None):
        return [e for e in self.world.entries if e.kind == kind and type_ in (None, e.type)]

    def pose(self, name):
        e = self.entries[name]
        return self.pose(e.holder) @ e.pose if e.holder else e.pose

    def outline(self, name):
        pose = self.pose(name)
        (shape,) = self.entries[name].shapes
        return shapely.transform(
            shape.outline, lambda xy: pose.apply(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]
        )

    def storey(self, name):
        e = self.entries[name]
        return self.storey(e.holder) if e.holder and e.kind != "storey" else name


def test_counts_agree_with_the_collection(building):
    expected = COUNTS[building.name]
    storeys = building.of("storey")
    assert len(storeys) == expected["storey"]
    assert len(building.of("elevator")) == expected["elevator"]
    for key in ("doors", "walls", "lanes"):
        assert sum(s.properties[key] for s in storeys) == expected[key]
    assert sum(s.properties["named_places"] for s in storeys) == expected["places"]
    doors = building.of("connector", "door") + building.of("object", "door")
    assert len([d for d in doors if "motion_axis" in d.properties]) == expected["doors"]
    assert len([p for p in building.of("region") if p.label]) == expected["places"]
    assert sum(w.properties["walls"] for w in building.of("object", "wall")) == expected["walls"]
    assert building.world.skipped == []


def test_doors_join_two_rooms_or_a_room_and_outside(building):
    joined = building.of("connector", "door")
    assert len(joined) == COUNTS[building.name]["doors"]
    outward = [d.name for d in joined if OUTSIDE in d.detail.places]
    assert outward == (["L1_door3"] if building.name == "hotel" else [])
    assert building.of("object", "door") == []
    inside = [door for door in joined if len({*door.detail.places}) == 1]
    assert len(inside) == SELF_JOINING[building.name]
    for door in joined:
        assert building.entries[door.detail.places[0]].kind == "room"


def test_each_lift_opens_onto_the_same_side_of_each_level_that_it_serves(building):
    for lift in building.of("elevator"):
        cabins = [r for r in building.of("room") if r.detail.elevator == lift.name]
        assert [c.holder for c in cabins] == lift.properties["levels"]
        for cabin in cabins:
            (door,) = [
                c
                for c in building.of("connector", "elevator_door")
                if cabin.name in c.detail.places
            ]
            lobby = building.entries[door.detail.places[0]]
            assert (lobby.holder, lobby.detail.elevator) == (cabin.holder, None)
            offset = building.pose(lift.name).inverse() @ building.pose(cabin.name)
            assert np.hypot(offset.x, offset.y) < 1e-6


def test_robots_stand_in_the_places_that_a_connector_joins(building):
    for connector in building.of("connector"):
        frame = building.pose(connector.name)
        for place, pose in zip(connector.detail.places, connector.detail.poses, strict=True):
            if place != OUTSIDE:
                standing = frame @ pose
                point = Point(standing.x, standing.y)
                assert building.outline(place).contains(point), connector.name


def test_rooms_of_a_storey_do_not_overlap(building):
    for storey in building.of("storey"):
        rooms = [building.outline(r.name) for r in building.of("room") if r.holder == storey.name]
        assert sum(r.area for r in rooms) == pytest.approx(shapely.union_all(rooms).area, abs=0.01)
        assert all(r.is_valid and r.area >= 0.5 for r in rooms)


def test_levels_lie_above_each_other(building):
    """The shafts' outer walls were drawn on each level anew; outlines agree within 0.3 m."""
    grounds = [building.outline(s.name).convex_hull for s in building.of("storey")]
    for ground in grounds[1:]:
        apart = [
            side.distance(Point(c))
            for side in [grounds[0].exterior]
            for c in ground.exterior.coords
        ]
        assert np.median(apart) < 0.3


def lanes(building):
    for link in building.world.links:
        a, b = building.pose(link.subject), building.pose(link.object)
        yield link, LineString([(a.x, a.y), (b.x, b.y)])


def test_no_lane_runs_through_a_wall(building):
    walls = {w.holder: building.outline(w.name) for w in building.of("object", "wall")}
    for storey in walls:
        shapely.prepare(walls[storey])
    for link, lane in lanes(building):
        assert not walls[building.storey(link.subject)].intersects(lane), link


def test_lanes_change_rooms_only_through_connectors(building):
    """Lanes were drawn where robots can drive: each room on the way is next to the last."""
    next_to = {frozenset(c.detail.places) for c in building.of("connector")}
    outlines = {r.name: building.outline(r.name) for r in building.of("room")}
    crossings = 0
    for link, lane in lanes(building):
        storey = building.storey(link.subject)
        on_the_way = []
        for t in np.linspace(0, 1, 200):
            point = lane.interpolate(t, normalized=True)
            rooms = [
                n for n, o in outlines.items() if building.storey(n) == storey and o.contains(point)
            ]
            on_the_way += [n for n in rooms if on_the_way[-1:] != [n]]
        for pair in itertools.pairwise(on_the_way):
            assert frozenset(pair) in next_to, link
            crossings += 1
    assert crossings > 10


def test_every_named_place_can_be_reached(building):
    import networkx as nx

    graph = nx.Graph(c.detail.places for c in building.of("connector"))
    for room in building.of("room"):
        if room.detail.elevator:
            graph.add_edge(room.name, room.detail.elevator)
    places = {p.holder for p in building.of("region") if p.label}
    reached = nx.node_connected_component(graph, next(iter(places)))
    assert places <= reached


def test_the_hotel_has_the_rooms_that_its_names_say(worlds):
    hotel = Building("hotel", read_rmf(worlds / "rmf" / "hotel" / "hotel.building.yaml"))
    types = {r.name: r.type for r in hotel.of("room")}
    assert types["kitchen"] == "kitchen"
    assert {"lobby", "restaurant", "shop", "L2_master_suite", "L3_master_suite"} <= set(types)
    kitchen = hotel.outline("kitchen").area
    assert kitchen == pytest.approx(3.6 * 4, rel=0.05)
    assert set(hotel.entries["L1_door4"].detail.places) == {"restaurant", "kitchen"}
