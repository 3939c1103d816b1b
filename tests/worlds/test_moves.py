"""Objects of real worlds moved at random: the inventory never contradicts the geometry."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

import semmap

WORLDS = {
    "small_house": "small_house/worlds/small_house.world",
    "hotel": "rmf/hotel/hotel.building.yaml",
    "clinic": "rmf/clinic/clinic.building.yaml",
}


@pytest.mark.parametrize("name", WORLDS)
def test_inventory_follows_random_moves(name: str, worlds: Path, database: str) -> None:
    dice = random.Random(4)
    with semmap.connect(database) as db:
        world = db.create_map(name)
        world.import_file(worlds / WORLDS[name])
        assert world.check() == []
        objects = [e for e in world.find("object") if e.pose is not None]
        places = [p for e in [*objects, *world.find("room")] if (p := e.pose) is not None]
        before = {e: e.holder for e in objects}
        for _ in range(60):
            moved, near = dice.choice(objects), dice.choice(places)
            moved.move_to(
                near.x, near.y, near.z + dice.choice((0, 0.4, 0.75, 3)), dice.uniform(-3, 3)
            )
        assert world.check() == []
        if name == "small_house":
            assert any(e.holder != holder for e, holder in before.items())
