"""Routes, deleted rooms and questions about names, in the small house and the hotel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import shapely
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

from navgrid.occupancy_grid import storey_grid
from planner.base_pose import NoBasePoseError
from planner.live_topology import LiveTopology
from planner.readers.robot_class import store_robot_class
from planner.readers.topology import read_topology
from planner.robot_class import RobotClass
from planner.route_planner import RoutePlanner
from planner.topology import UnknownPlaceError
from semmap.database import connect
from semmap.ingest.importer import import_file
from semmap.query.storey_reader import read_storeys
from semmap.robot import load_robot, robot_parts
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.robot.robots import real_robot

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"


@pytest.fixture(scope="module")
def engine(make_database: MakeDatabase, worlds: Path) -> Iterator[Engine]:
    """A database that holds the small house and the hotel."""
    engine = connect(make_database())
    house = worlds / "small_house" / "worlds" / "small_house.world"
    for path in (house, ROOMS):
        import_file(engine, path, map_name="house")
    import_file(engine, worlds / "rmf" / "hotel" / "hotel.building.yaml", map_name="hotel")
    yield engine
    engine.dispose()


@pytest.fixture(scope="module")
def url(engine: Engine) -> str:
    return engine.url.render_as_string(hide_password=False)


@pytest.fixture(scope="module")
def tiago() -> RobotClass:
    return RobotClass("tiago", tuple(robot_parts(load_robot(real_robot("tiago")), {})), speed=0.5)


def test_tiago_faces_everything_within_reach_in_the_small_house(
    engine: Engine, tiago: RobotClass
) -> None:
    planner = RoutePlanner.of_live(LiveTopology(engine, "house", replace(tiago, reach=(0.2, 1.2))))
    reached = 0
    for name in ("TV_02_001", "RoomWall_01_001", "FoldingDoor_01_002", "Bed_01_001"):
        try:
            poses = planner.approach(name)
        except NoBasePoseError:
            continue
        (entity,) = planner.lookup.find(name)
        for pose in poses:
            base = shapely.Point(pose.x, pose.y)
            assert entity.footprint is not None
            assert 0.19 < shapely.distance(base, entity.footprint) < 1.21
            ahead = shapely.Point(
                pose.x + 1.3 * math.cos(pose.yaw), pose.y + 1.3 * math.sin(pose.yaw)
            )
            look = shapely.LineString([base, ahead])
            assert shapely.distance(look, entity.footprint) < 0.35
        reached += bool(poses)
    assert reached >= 3


def test_a_deleted_room_takes_its_connectors_along(engine: Engine) -> None:
    with engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        held = "SELECT e.name FROM placement p JOIN entity e ON e.id = p.entity_id "
        balls = connection.execute(
            text(held + "WHERE p.holder_id = entity_id('balcony')")
        ).scalars()
        names = [*balls]
        assert "Ball_01_001" in names
        connection.execute(text("DELETE FROM entity WHERE id = entity_id('balcony')"))
        topology = read_topology(connection)
        assert {*topology.places} == {"bedroom", "kitchen", "living-room", "outside"}
        assert {*topology.connectors} == {"bedroom-door", "kitchen-door", "front-door"}
        kinds = "SELECT count(*) FROM entity WHERE map_id = current_map() AND kind = 'connector'"
        assert connection.execute(text(kinds)).scalar() == 3
        (scene,) = read_storeys(connection)
        assert (storey_grid(scene, (0.05, 1.8)).cells == 0).any()
        storey = text(
            held + "WHERE p.holder_id = entity_id('ground-floor') AND e.name = ANY (:names)"
        )
        left = {*connection.execute(storey, {"names": names}).scalars()}
        assert left == {*names}  # nobody else holds them, and nothing was deleted with the room
        connection.rollback()


def test_deleted_furniture_leaves_its_contents_in_the_room(engine: Engine) -> None:
    with engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        connection.execute(text("DELETE FROM entity WHERE id = entity_id('KitchenTable_01_001')"))
        holder = connection.execute(
            text(
                "SELECT h.name FROM placement p JOIN entity h ON h.id = p.holder_id "
                "WHERE p.entity_id = entity_id('Tableware_01_001')"
            )
        ).scalar()
        assert holder == "kitchen"
        connection.rollback()


def test_an_elevator_can_be_avoided(engine: Engine) -> None:
    planner = RoutePlanner.of_map(engine, "hotel")
    ridden = {
        avoid: {s.elevator for s in planner.route("restaurant", "L3-room1", avoid=avoid).steps}
        for avoid in ((), ("Lift1",), ("Lift2",))
    }
    assert "Lift1" not in ridden["Lift1",]
    assert "Lift2" not in ridden["Lift2",]
    assert ridden[()] in (ridden["Lift1",], ridden["Lift2",])
    with pytest.raises(UnknownPlaceError, match="did you mean Lift"):
        planner.route("restaurant", "L3-room1", avoid=["Lift9"])


def test_an_unknown_name_is_an_error(engine: Engine, url: str) -> None:
    for question in (
        "is_on(entity_id('Ball_01_001'), entity_id('Bal_01_001'))",
        "(SELECT count(*) FROM things_on(entity_id('KitchenTabel')))",
    ):
        with engine.connect() as connection:
            connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
            with pytest.raises(DBAPIError, match="no entity named"):
                connection.execute(text(f"SELECT {question}"))
    with pytest.raises(LookupError, match="was not in the map at 2020-01-01"):
        semmap(url, "show", "Ball_01_001", "--map", "house", "--at", "2020-01-01")


def test_pgrouting_is_there_and_finds_the_routes_of_the_documents(
    engine: Engine, url: str, tiago: RobotClass
) -> None:
    with engine.connect() as connection:
        offered = "SELECT count(*) FROM pg_available_extensions WHERE name = 'pgrouting'"
        if not connection.execute(text(offered)).scalar():
            pytest.skip("the server has no pgRouting")
    page = (Path(__file__).parents[2] / "docs" / "planner.md").read_text()
    statement = page[page.index("    SELECT d.seq") : page.index("ORDER BY d.seq;") + 14]
    for old, new in {
        "delivery": "tiago",
        "door1": "bedroom-door",
        "door8": "kitchen-door",
        "lab1": "bedroom",
        "lab2": "kitchen",
    }.items():
        statement = statement.replace(f"'{old}'", f"'{new}'")
    with engine.begin() as connection:
        store_robot_class(connection, tiago)
    LiveTopology(engine, "house", "tiago")
    printed = semmap(url, "sql", "--map", "house", statement, "--json").stdout
    assert "bedroom-door" in printed
    assert "kitchen-door" in printed
