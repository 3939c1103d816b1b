"""Support surfaces of ten pieces of furniture, labelled by hand; and no spurious ones."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
import shapely
from sqlalchemy import Engine, text
from typer.testing import Result

from semmap.database.maps import see_map
from semmap.geometry.surfaces import support_surfaces
from semmap.ingest.sdf.world_file import read_sdf
from tests.command_line import semmap
from tests.ingest.regions.test_extraction import HAIRLINE

# Read off where vertical lines through the pieces meet them, metres above the floor.
LABELLED = {
    "KitchenTable_01_001": (0.801,),
    "CoffeeTable_01_001": (0.363,),
    "ReadingDesk_01_001": (0.743,),
    "BalconyTable_01_001": (0.400,),
    "NightStand_01_001": (0.687,),
    "TVCabinet_01_001": (0.491,),
    "KitchenCabinet_01_001": (0.904,),
    "ShoeRack_01_001": (0.077, 0.375, 0.688, 1.003),
    "Refrigerator_01_001": (1.930,),
    "Wardrobe_01_001": (2.144,),
}
# What else is level, above 0.2 m2 and bears things: boards, seats, sills, beds, what one walks on.
ALSO = {
    "NightStand_01_001",
    "NightStand_01_002",
    "TVCabinet_01_001",
    "KitchenCabinet_01_001",
    "Bed_01_001",
    "SofaC_01_001",
    "CookingBench_01_001",
    "Rangehood_01_001",
    "Carpet_01_001",
    "Carpet_01_002",
    "FloorB_01_001",
    "FitnessEquipment_01_001",
    "HouseWallB_01_001",
    "RoomWall_01_001",
}


@pytest.fixture(scope="module")
def surfaces(worlds: Path) -> dict[str, list[float]]:
    """World heights of the surfaces above 0.2 m2, by entity."""
    house = read_sdf(worlds / "small_house" / "worlds" / "small_house.world")
    found: dict[int, list[float]] = {}
    heights = {}
    for entry in house.entries:
        assert entry.pose is not None
        for shape in entry.shapes:
            if shape.mesh is None or abs(entry.pose.qx) + abs(entry.pose.qy) > 1e-3:
                continue
            if id(shape.mesh) not in found:
                found[id(shape.mesh)] = [
                    s.height for s in support_surfaces(shape.mesh) if s.area > 0.2
                ]
            heights[entry.name] = [entry.pose.z + h for h in found[id(shape.mesh)]]
    return heights


@pytest.mark.parametrize("name", LABELLED)
def test_labelled_heights(surfaces: dict[str, list[float]], name: str) -> None:
    for height in LABELLED[name]:
        assert min(abs(height - h) for h in surfaces[name]) < 0.01


def test_nothing_spurious(surfaces: dict[str, list[float]]) -> None:
    spurious = {
        (name, round(height, 3))
        for name, heights in surfaces.items()
        for height in heights
        if name not in ALSO and all(abs(height - h) >= 0.01 for h in LABELLED.get(name, ()))
    }
    assert spurious == set()


def test_slivers_of_surfaces_do_not_end_the_search_of_the_house(house: Engine) -> None:
    """The coffee table gets an outline that is all but a line, and one with a hairline neck."""
    url = house.url.render_as_string(hide_password=False)
    words = ("regions", "find", "surfaces", "--type", "table", "--map", "house", "--json")
    before = found(semmap(url, *words))
    assert {"CoffeeTable_01_001", "KitchenTable_01_001"} <= {*before}
    with house.begin() as connection:
        see_map(connection, "house")
        for number, corners in enumerate(([(0, 0), (1, 0), (1, 1e-6)], HAIRLINE)):
            outline = shapely.to_wkb(shapely.Polygon(corners))
            connection.execute(_MORE, {"number": 1000 + number, "outline": outline})
    after = found(semmap(url, *words))
    assert after.pop("CoffeeTable_01_001") == before.pop("CoffeeTable_01_001") + 1
    assert after == before


def found(said: Result) -> dict[str, int]:
    """How many surfaces `semmap regions find` printed for each object."""
    assert said.exit_code == 0, said.output
    assert "left out" not in said.output
    return Counter(row["of"] for row in json.loads(said.stdout))


_MORE = text("""
INSERT INTO support_surface (model_id, number, height, outline, faces)
SELECT model_id, :number, 0.2, ST_GeomFromWKB(:outline, 0), '{0}'
FROM entity_model WHERE entity_id = entity_id('CoffeeTable_01_001')
""")
