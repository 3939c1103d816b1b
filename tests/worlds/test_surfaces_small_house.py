"""Support surfaces of ten pieces of furniture, labelled by hand; and no spurious ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from semmap.geometry.surfaces import support_surfaces
from semmap.ingest.sdf import read_sdf

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
