"""What derives from a map, in forty lines: `forty_lines.py WORLD ROOMS URDF` runs them."""

from __future__ import annotations

import sys
from pathlib import Path
from queue import SimpleQueue

import semmap


def run(world: str, rooms: str, urdf: str, posture: dict[str, float], out: str = "out") -> dict:
    """Import a world and its rooms; find, move, subscribe, drive, plan, look for, grasp and ask."""
    events: SimpleQueue[semmap.MapEvent] = SimpleQueue()
    with semmap.connect() as db:
        house = db.create_map("forty")
        house.import_file(world)
        house.import_file(rooms)
        table = house.find("table", in_="kitchen")[0]
        with house.subscribe(events.put):
            mug = house.add_object("mug1", type="mug", size=(0.06, 0.06, 0.1), on=table.name)
            mug.move_to(table.footprint.bounds[0] + 0.15, *mug.pose[1:3])  # within an arm's reach
            seen = [events.get(timeout=10) for _ in range(2)]
        db.add_robot("robot", urdf, posture=posture, reach=(0.2, 1.2))
        house.grid().write(out)
        costmap = house.costmap("robot", rooms=["kitchen"])
        route = house.route("bedroom", "mug1", robot="robot")
        plan = house.plan("on(mug1, CoffeeTable_01_001)", start="bedroom", robot="robot")
        rows = house.sparql("SELECT ?x { ?x semmap:heldBy :KitchenTable_01_001 }")
        return {
            "events": [event.what for event in seen],
            "cost": costmap.explain(*table.pose[:2])[0].entities,
            "rooms": route.places,
            "actions": [str(action) for action in plan.actions],
            "where": max(house.where("mug1").items(), key=lambda item: item[1])[0],
            "grasps": len(house.grasps("mug1").rows),
            "on the table": [*rows],
        }


if __name__ == "__main__":
    print(run(*sys.argv[1:4], posture={}, out=str(Path("out"))))
