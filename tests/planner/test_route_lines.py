"""The line of a route on a floor plan ends where a robot can stand."""

from __future__ import annotations

import pytest
import shapely

import semmap
from planner.route_lines import route_lines


@pytest.mark.parametrize("floor", [False, True])
def test_a_way_to_a_type_of_things_ends_beside_the_table(database: str, floor: bool) -> None:
    with semmap.connect(database) as db:
        flat = db.create_map("flat")
        for x, name in ((0, "hall"), (5, "den")):
            flat.add_room(name, shapely.box(x, 0, x + 5, 4), floor=0, ceiling=2.5)
        flat.add_door("door", "hall", "den", ((5, 1.5), (5, 2.5)))
        flat.add_object("desk", type="desk", size=(1, 2, 0.7), pose=(9, 2, 0))
        flat.add_object("mug", type="mug", size=(0.1, 0.1, 0.1), pose=(9, 2, 0.7))
        if floor:
            flat.add_object("floor", type="floor", size=(5, 4, 0.01), pose=(7.5, 2, -0.01))
        route = flat.route("hall", "den")
        grids = {made.scene.storey: made for made in flat.grids()}
        ((line,),) = route_lines(route, route.topology, grids, "mug").values()
        away = flat["desk"].footprint.distance(shapely.Point(line[-1]))
        assert 0.2 < away < 0.5
