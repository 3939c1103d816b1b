"""A search says which likely places the robot cannot look at."""

from __future__ import annotations

import semmap
from semmap.geometry.mesh import box_mesh


def test_a_search_names_what_it_cannot_see(database: str) -> None:
    with semmap.connect(database) as db:
        flat = db.create_map("flat")
        for name, x in (("here", 0.0), ("there", 5.0)):
            outline = [(x, 0), (x + 5, 0), (x + 5, 4), (x, 4)]
            flat.add_room(name, outline, floor=0, ceiling=2.5)
            flat.add_object(f"table {name}", type="table", size=(1, 1, 0.7), pose=(x + 2.5, 2, 0))
        for number, (low, high) in enumerate(((0, 1.5), (2.5, 4))):
            wall = box_mesh((-0.05, low, 0), (0.05, high, 2.5))
            flat.add_object(f"wall {number}", type="wall", mesh=wall, pose=(5, 0, 0))
        door = flat.add_door("gate", "here", "there", ((5, 1.5), (5, 2.5)))
        flat.add_object("cup", type="cup", size=(0.1, 0.1, 0.1), on="table there")
        sought = flat.search("cup", start="here")
        assert "table there" not in sought.problem.unseen
        assert "No pose" not in sought.reason
        door.state = "locked"
        sought = flat.search("cup", start="here")
        assert "table there" in sought.problem.unseen
        assert "No pose that the robot reaches shows table there (" in sought.reason
        assert "table there" in sought.as_json()["unseen"]
        assert all(view.room == "here" for view in sought.tour)
