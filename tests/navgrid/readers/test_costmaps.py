"""Costmaps of the office, read from the database: whole, in part, at a moment, after changes."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import pytest
import shapely
from sqlalchemy import Connection, Engine, text

from navgrid.costmap import Costmap
from navgrid.grid import scene_grid
from navgrid.readers.costmaps import read_costmaps
from semmap.ingest.regions.extraction import draw_region
from semmap.query.change_feed import changed_since
from semmap.query.storey_reader import read_entities, read_scene
from tests.navgrid.scenes import ARM, BASE
from tests.seen import cursor, seen_by


@pytest.fixture(scope="module")
def office(office_world: Engine) -> Engine:
    """A database that holds the office."""
    return office_world


@pytest.fixture
def connection(office: Engine) -> Iterator[Connection]:
    with office.connect() as connection:
        yield connection
        connection.rollback()


def test_each_storey_has_a_costmap_unless_one_is_named(connection: Connection) -> None:
    both = read_costmaps(seen_by(connection), [BASE], resolution=0.2)
    assert [costmap.scene.storey for costmap in both] == ["floor-1st", "floor-3rd"]
    (third,) = read_costmaps(seen_by(connection), [BASE], storey="floor-3rd", resolution=0.2)
    np.testing.assert_array_equal(third.master, both[1].master)
    (lab,) = read_costmaps(seen_by(connection), [BASE], rooms=["lab2"], resolution=0.2)
    assert lab.scene.storey == "floor-3rd"
    assert lab.master.size < third.master.size / 2


def test_a_part_has_the_costs_of_the_whole(connection: Connection) -> None:
    (whole,) = read_costmaps(seen_by(connection), [BASE, ARM], storey="floor-3rd")
    bounds = (5.0, 1.0, 9.0, 3.0)
    (part,) = read_costmaps(seen_by(connection), [BASE, ARM], storey="floor-3rd", bounds=bounds)
    assert len(part.scene.entities) < len(whole.scene.entities)
    for x, y in np.random.default_rng(1).uniform((5, 1), (9, 3), (300, 2)):
        assert part.master[part.grid.cell(x, y)] == whole.master[whole.grid.cell(x, y)]


def test_only_the_given_rooms_are_known(connection: Connection) -> None:
    scene = read_scene(seen_by(connection), "floor-3rd", rooms=["corridor3", "office4"], margin=1.0)
    rooms = {area.name for area in scene.floors if not area.name.startswith(("door", "edoor"))}
    assert rooms == {"corridor3", "office4"}
    costmap = Costmap(scene, [BASE], scene_grid(scene, 0.05, None, 1.0))
    assert costmap.master[costmap.grid.cell(9, 2)] != 255
    assert costmap.master[costmap.grid.cell(3.6, 6.6)] == 255, "the foyer"


def test_a_region_is_an_obstacle_while_it_is_valid(connection: Connection) -> None:
    noon = datetime(2026, 5, 4, 12, tzinfo=UTC)
    home = connection.execute(text("SELECT current_map()")).scalar_one()
    lab = connection.execute(text("SELECT entity_id('lab2')")).scalar_one()
    outline = shapely.box(15, 6, 16, 7)

    def draw(begin: datetime | None, end: datetime) -> None:
        draw_region(
            connection, home, "wet", outline, type="keepout_zone", holder=lab, valid=(begin, end)
        )

    draw(None, noon)
    for hour, there in ((11, True), (12, False), (13, False)):
        scene = read_scene(seen_by(connection), "floor-3rd", moment=noon.replace(hour=hour))
        assert ("wet" in {entity.name for entity in scene.entities}) == there
        costmap = Costmap(scene, [BASE], scene_grid(scene, 0.1))
        assert (costmap.master[costmap.grid.cell(15.5, 6.5)] == 254) == there
    with pytest.raises(ValueError, match="before it begins"):
        draw(noon, noon.replace(hour=9))


def test_an_update_after_changes_in_the_database_equals_a_new_costmap(office: Engine) -> None:
    """Desks are moved with their contents, doors locked, types and floors changed."""
    changes = (
        "SELECT move_to(entity_id('desk4'), 9.0, 2.4, 7.0, 0.4)",
        "UPDATE connector SET state = 'locked' WHERE entity_id = entity_id('door7')",
        'UPDATE entity SET properties = properties || \'{"workplace": "human"}\' '
        "WHERE id = entity_id('desk7')",
        "DELETE FROM entity WHERE id = entity_id('sofa3')",
        "SELECT move_to(entity_id('slab-3rd'), 0.0, 0.0, 0.0, 0.0)",
    )
    with office.connect() as connection:
        scene = read_scene(seen_by(connection), "floor-3rd")
        grid = scene_grid(scene, 0.05)
        costmap = Costmap(scene, [BASE, ARM], grid)
        since = cursor(seen_by(connection))
        connection.rollback()
        for change in changes:
            before = costmap.master.copy()
            with office.begin() as other:
                other.execute(text(change))
            ids, since = changed_since(seen_by(connection), since), cursor(seen_by(connection))
            entities = read_entities(seen_by(connection), ids)
            costmap.update(entities, set(ids) - {entity.id for entity in entities})
            expected = Costmap(read_scene(seen_by(connection), "floor-3rd"), [BASE, ARM], grid)
            assert (costmap.master == expected.master).all(), change
            assert "slab" in change or (costmap.master != before).any(), change
            connection.rollback()
        assert changed_since(seen_by(connection), since) == set()
