"""The picture of a topology as large as an airport's."""

from __future__ import annotations

import time
from pathlib import Path

import shapely

from planner.exchange.picture import topology_plan
from planner.topology import Place, PlaceConnector, Topology
from semmap.draw.view import RoomView, StoreyView
from semmap.geometry.pose import Pose

SHOPS, WIDTH = 95, 6.0


def airport() -> tuple[Topology, StoreyView]:
    """A hall with 190 shops, half of them on each side."""
    hall = RoomView("hall", shapely.box(0, -10, SHOPS * WIDTH, 10), 0.0, 3.0)
    rooms, doors = [hall], {}
    for number in range(SHOPS):
        x = number * WIDTH
        for side, low, high in ((1, 10.2, 22.0), (-1, -22.0, -10.2)):
            name = f"shop {number}{'n' if side > 0 else 's'}"
            rooms.append(RoomView(name, shapely.box(x, low, x + WIDTH - 0.2, high), 0.0, 3.0))
            poses = (Pose.planar(x + 3, side * 9.4, 0), Pose.planar(x + 3, side * 10.8, 0))
            doors[f"{name} door"] = PlaceConnector(f"{name} door", ("hall", name), poses)
    places = {room.name: Place(room.name, storey="L1") for room in rooms}
    return Topology(places, doors), StoreyView("L1", rooms=rooms)


def test_an_airport_is_drawn_within_five_seconds(tmp_path: Path) -> None:
    topology, storey = airport()
    start = time.process_time()
    topology_plan(topology, storey, tmp_path / "plan.png")
    assert time.process_time() - start < 5.0
