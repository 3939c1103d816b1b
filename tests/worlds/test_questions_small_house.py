"""The small house in the map, its rooms drawn over it, and what a newcomer asks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sqlalchemy import Engine

from semmap.ingest.importer import import_file
from tests.command_line import semmap

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"


@pytest.fixture(scope="module")
def house(module_engine: Engine, worlds: Path) -> str:
    """The URL of a database that holds the house."""
    world = worlds / "small_house" / "worlds" / "small_house.world"
    first = import_file(module_engine, world, map_name="house")
    assert first.added == 87
    second = import_file(module_engine, ROOMS, map_name="house")
    assert not second.skipped
    return module_engine.url.render_as_string(hide_password=False)


def ask(house: str, *words: str) -> list[dict[str, object]]:
    done = semmap(house, *words, "--json")
    assert done.exit_code == 0, done.output
    rows: list[dict[str, object]] = json.loads(done.stdout)
    return rows


def test_which_rooms_hold_chairs(house: str) -> None:
    chairs = ask(house, "ls", "chair")
    assert {c["holder"] for c in chairs} == {"kitchen", "bedroom", "balcony"}
    in_kitchen = {str(c["name"]) for c in chairs if c["holder"] == "kitchen"}
    assert in_kitchen == {f"ChairA_01_00{i}" for i in range(1, 5)}


def test_what_is_on_the_kitchen_table(house: str) -> None:
    rows = ask(
        house,
        "sql",
        "SELECT e.name, p.relation, p.confidence "
        "FROM placement p JOIN entity e ON e.id = p.entity_id "
        "WHERE p.holder_id = entity_id('KitchenTable_01_001')",
    )
    assert [(r["name"], r["relation"]) for r in rows] == [("Tableware_01_001", "on")]
    confidence = rows[0]["confidence"]
    assert isinstance(confidence, float)
    assert 0.5 < confidence < 1, "it hovers 16 mm above the top"


def test_how_to_get_from_the_bedroom_to_the_kitchen(house: str) -> None:
    done = semmap(house, "route", "bedroom", "kitchen", "--json")
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert [d["name"] for d in answer["doors"]] == ["bedroom-door", "kitchen-door"]


def test_nothing_changes_on_a_second_import(
    house: str, module_engine: Engine, worlds: Path
) -> None:
    world = worlds / "small_house" / "worlds" / "small_house.world"
    for path in (world, ROOMS):
        again = import_file(module_engine, path, map_name="house")
        assert (again.added, again.changed, again.removed, again.holders) == (0, 0, 0, 0)
