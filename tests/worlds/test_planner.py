"""Routes, missions, deleted rooms and questions about names, in the small house and the hotel."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

import semmap
from navgrid.occupancy_grid import storey_grid
from planner.base_pose import NoBasePoseError
from planner.live_topology import LiveTopology
from planner.mission import Command, MissionResult, MissionStore, Runner
from planner.mission.sim_robot import SimulatedRobot
from planner.mission.sim_setup import entry_poses, open_world, simulated_robot
from planner.mission.sim_world import SimWorld
from planner.mission.store.mission_list import MissionError
from planner.mission.store.observations import find_placement
from planner.mission.store.simulation_map import simulation_map
from planner.readers.robot_class import store_robot_class
from planner.readers.topology import read_topology
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.route_planner import RoutePlanner
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.search.line_of_sight import LineOfSight
from planner.search.reader import read_believed_object
from planner.search.viewpoints import free_positions
from planner.storey_costmaps import StoreyCostmaps
from planner.task_planner import TaskPlanner
from planner.tasks import parse_goal
from planner.tasks.reader import read_world
from planner.topology import OUTSIDE, UnknownPlaceError
from semmap.cli.demo.choices import DemoChoices, choose, figure_3
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapHandle
from semmap.query.sql_statement import run_sql
from semmap.query.storey_reader import read_storeys
from semmap.robot import load_robot, robot_parts
from tests.command_line import semmap as semmap_command
from tests.consistency import HOLDERS
from tests.effort import effort
from tests.robot.robots import real_robot
from tests.schema.test_roles import as_role
from tests.seen import seen_by

SEMMAP = Path(sys.executable).parent / "semmap"
FOLDED = {
    "arm_1_joint": 0.2,
    "arm_2_joint": -1.34,
    "arm_3_joint": -0.2,
    "arm_4_joint": 1.94,
    "arm_5_joint": -1.57,
    "arm_6_joint": 1.37,
}
"""Joint angles with which TIAGo's arm is within its base, radians."""


@pytest.fixture(scope="module")
def engine(house_and_hotel: Engine) -> Engine:
    return house_and_hotel


@pytest.fixture(scope="module")
def url(engine: Engine) -> str:
    return engine.url.render_as_string(hide_password=False)


@pytest.fixture(scope="module")
def tiago() -> RobotClass:
    return RobotClass("tiago", tuple(robot_parts(load_robot(real_robot("tiago")), {})), speed=0.5)


@pytest.fixture(scope="module")
def tiago_live(engine: Engine, tiago: RobotClass) -> LiveTopology:
    return LiveTopology(MapHandle(engine, "house"), replace(tiago, reach=(0.2, 1.2)))


def test_tiago_looks_from_poses_in_the_rooms_that_they_name(tiago_live: LiveTopology) -> None:
    """Also beside an open door, where the room's costs reach into the next room."""
    costs = tiago_live.graph.costs
    assert isinstance(costs, StoreyCostmaps)
    with tiago_live.snapshot() as seen:
        places = read_believed_object(seen, "Ball_01_003").places
    rooms = [place for place in places if place.kind == "room"]
    assert len(rooms) == 4
    for room in rooms:
        assert room.footprint is not None
        floor = tiago_live.topology.places[room.name].floor
        positions = free_positions(
            room.name, floor, room.footprint, LineOfSight(np.empty((0, 3, 3))), costs
        )
        assert len(positions) > 3, room.name
        assert shapely.contains_xy(room.footprint, positions).all(), room.name


TABLES = (
    "CoffeeTable_01_001",
    "NightStand_01_001",
    "KitchenTable_01_001",
    "BalconyTable_01_001",
    "ReadingDesk_01_001",
    "TVCabinet_01_001",
    "CookingBench_01_001",
    "NightStand_01_002",
    "ShoeRack_01_001",
)
"""Of the small house; the first four are in its four rooms."""


def test_tiago_faces_everything_within_reach_in_the_small_house(tiago_live: LiveTopology) -> None:
    planner = RoutePlanner.of_live(tiago_live)
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
        topology = read_topology(seen_by(connection))
        assert {*topology.places} == {"bedroom", "kitchen", "living-room", "outside"}
        assert {*topology.connectors} == {"bedroom-door", "kitchen-door", "front-door"}
        kinds = "SELECT count(*) FROM entity WHERE map_id = current_map() AND kind = 'connector'"
        assert connection.execute(text(kinds)).scalar() == 3
        (scene,) = read_storeys(seen_by(connection))
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


def test_an_arm_that_does_not_fit_is_told_of_the_state_that_folds_it(
    engine: Engine, tiago: RobotClass
) -> None:
    """A kitchen door 0.9 m wide is too narrow for the stretched arm; one of 0.5 m for the base."""
    with engine.connect() as connection:
        see_map(connection, "house")
        topology = read_topology(seen_by(connection))

    def ways(robot: RobotClass, width: float) -> list[str | None]:
        door = replace(topology.connectors["kitchen-door"], width=width)
        topology.connectors["kitchen-door"] = door
        route = RoutePlanner(RoutingGraph(topology, robot)).route("living-room", "kitchen")
        return [step.connector and step.connector.name for step in route.steps]

    hint = "through kitchen-door: it is 1.09 m wide, .* add the robot again with posture="
    with pytest.raises(NoRouteError, match=f"the arm does not fit {hint}"):
        ways(tiago, 0.9)
    folded = replace(tiago, parts=tuple(robot_parts(load_robot(real_robot("tiago")), FOLDED)))
    assert "kitchen-door" in ways(folded, 0.9)
    with pytest.raises(NoRouteError, match="the base does not fit") as refused:
        ways(folded, 0.5)
    assert "posture" not in str(refused.value)  # no state makes a base narrower


def test_home_is_a_goal_in_the_small_house(engine: Engine, url: str, tmp_path: Path) -> None:
    corners = "-6.2,-4.6 -5.2,-4.6 -5.2,-3.6 -6.2,-3.6"
    words = ("--polygon", corners, "--type", "home_region", "--holder", "bedroom")
    assert semmap_command(url, "regions", "draw", "home", *words, "--map", "house").exit_code == 0
    try:
        goal = ("in(robot, home)", "--map", "house", "--from", "kitchen")
        planned = semmap_command(url, "plan", *goal, "--json")
        assert planned.exit_code == 0, planned.output
        assert "bedroom-door" in planned.stdout
        world = tmp_path / "world"
        own = ("--simulate", "--speed", "100000", "--world", world)
        done = semmap_command(url, "run", *goal, *own)
        assert done.exit_code == 0, done.output
        with closing(SimWorld(world)) as seen:
            place, pose = seen.robot("robot")
        assert place == "bedroom"
        assert shapely.box(-6.2, -4.6, -5.2, -3.6).covers(shapely.Point(pose.x, pose.y))
    finally:
        with engine.begin() as connection:
            see_map(connection, "house")
            connection.execute(text("DELETE FROM entity WHERE id = entity_id('home')"))


def test_an_elevator_can_be_avoided(engine: Engine) -> None:
    planner = RoutePlanner.of_map(MapHandle(engine, "hotel"))
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
        semmap_command(url, "show", "Ball_01_001", "--map", "house", "--at", "2020-01-01")


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
    LiveTopology(MapHandle(engine, "house"), "tiago")
    printed = semmap_command(url, "sql", "--map", "house", statement, "--json").stdout
    assert "bedroom-door" in printed
    assert "kitchen-door" in printed


def test_the_simulated_robot_passes_every_connector_of_the_hotel(
    engine: Engine, tmp_path: Path
) -> None:
    with MissionStore(MapHandle(engine, "hotel")) as store:
        topology = store.topology()
    graph = RoutingGraph(topology)
    passed = set()
    with closing(SimWorld.make(tmp_path / "world", topology)) as world:
        robot = SimulatedRobot("robot", world, topology, speed=1e6)
        for connector in topology.connectors.values():
            if OUTSIDE in connector.places:
                continue
            start, goal = connector.places
            commands = [
                Command(s.behaviour, (connector.name,), s, seconds=s.seconds)
                for s in find_route(graph, graph.endpoint(start), graph.endpoint(goal)).steps
            ]
            first = commands[0].step
            assert first is not None
            world.put_robot("robot", start, first.approach or first.leave)
            for command in commands:
                running = getattr(robot, command.behaviour)(command)
                while (outcome := running.poll()) is None:
                    pass
                assert outcome.succeeded, (connector.name, outcome)
            assert world.robot("robot")[0] == goal
            passed.add(connector.behaviour)
    assert {"pass_door", "drive_through"} <= passed


class Building:
    """A copy of a map in which TIAGo, its arm folded, carries out goals."""

    def __init__(self, engine: Engine, name: str, folder: Path) -> None:
        self.live = LiveTopology(MapHandle(engine, name), "folded")
        self.store = MissionStore(MapHandle(engine, name), "test")
        self.file = folder / "world"

    def add_robot(self, place: str) -> None:
        self.store.add_robot("robot", place, entry_poses(self.live.graph, place)[0], "folded")
        self.world = open_world(self.file, self.store, self.live.topology, "robot")

    def reach(self, goal: str) -> MissionResult:
        robot = simulated_robot(self.live, self.world, "robot", speed=1e6)
        runner = Runner(self.store, robot, TaskPlanner(self.live), speed=1e6, tick=0)
        return runner.run(self.store.add("robot", goal))

    def contradictions(self) -> list[Any]:
        """Where the inventory of the map disagrees with its geometry."""
        with self.live.snapshot() as seen:
            own = f"SELECT name FROM ({HOLDERS}) c WHERE map = :name"
            return list(seen.connection.execute(text(own), {"name": self.store.map_name}).scalars())

    def close(self) -> None:
        self.world.close()
        self.store.close()


@pytest.fixture
def building(engine: Engine, tmp_path: Path) -> Iterator[Callable[..., Building]]:
    """Opens a copy of a map with a mug, and with tables in rooms of buildings without shapes."""
    parts = robot_parts(load_robot(real_robot("tiago")), FOLDED)
    with engine.begin() as connection:
        store_robot_class(connection, RobotClass("folded", tuple(parts), speed=0.5))
    with ExitStack() as opened:

        def open_copy(original: str, mug: tuple[str, tuple[float, ...]], tables: Sequence[str]):
            name = opened.enter_context(simulation_map(engine, original))
            with semmap.connect(engine.url.render_as_string(hide_password=False)) as database:
                edited = database.map(name)
                for room in tables:
                    middle = tuple(edited[room].describe()["pose"][:3])
                    size = (1.2, 0.6, 0.72)
                    edited.add_object(f"table in {room}", type="table", size=size, pose=middle)
                on, pose = mug
                edited.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1), on=on, pose=pose)
            made = Building(engine, name, tmp_path)
            opened.callback(made.close)
            return made

        yield open_copy


@pytest.mark.explore
def test_tiago_fetches_a_mug_from_any_room_to_any_table_of_the_small_house(
    engine: Engine, building: Callable[..., Building]
) -> None:
    before = state_of(engine, "house")
    house = building("house", ("KitchenTable_01_001", (5.75, 0.83, 0.801351)), [])
    house.add_robot("bedroom")
    rooms = set()
    for table in effort(TABLES[:5], TABLES):
        result = house.reach(f"on(mug1, {table})")
        assert result.state == "done", (table, result)
        place, seen = house.world.objects()["mug1"]
        assert seen.holder == table
        rooms.add(place)
        robot_at, pose = house.world.robot("robot")
        assert robot_at == place
        assert math.dist((pose.x, pose.y), (seen.pose.x, seen.pose.y)) < 1.5
        assert house.store.robot("robot") == (place, pytest.approx(pose))
    assert rooms == {"bedroom", "kitchen", "living-room", "balcony"}
    assert house.reach("in(robot, kitchen) and in(mug1, balcony)").state == "done"
    assert house.world.robot("robot")[0] == "kitchen"
    assert state_of(engine, "house") == before, "a simulated run changes no map"
    assert house.contradictions() == []


def test_placing_keeps_the_doors_of_the_small_house_and_their_ways_free(engine: Engine) -> None:
    """Put down before, in and behind a doorway, an object stands beside the way and its leaves."""
    put_down = 0
    with engine.connect() as connection:
        see_map(connection, "house")
        rows = connection.execute(text(_ON_FLOORS)).all()
        bodies = {row.name: shapely.from_wkb(bytes(row.footprint)) for row in rows}
        assert "FoldingDoor_02_002" in bodies
        connectors = read_topology(seen_by(connection)).connectors.values()
        sides = [(c, place, side) for c in connectors for side, place in enumerate(c.places)]
        for (connector, place, side), item in product(sides, ("Trash_01_001", "Ball_01_001")):
            if place == OUTSIDE:
                continue
            here, there = (shapely.Point(connector.poses[k][:2]) for k in (side, 1 - side))
            way = shapely.LineString([here, there])
            yaw = math.atan2(there.y - here.y, there.x - here.x)
            radius = connection.execute(text(_RADIUS), {"name": item}).scalar_one() / 2
            others = [body for name, body in bodies.items() if name != item]
            for ahead in (-0.5, 0.0, 0.5):
                robot = Pose.planar(here.x, here.y, yaw) @ Pose(ahead)
                spot = find_placement(seen_by(connection), item, place, robot)
                assert spot is not None
                body = shapely.Point(spot.x, spot.y).buffer(radius - 1e-3)
                assert shapely.distance(way, body) > 0.6, (connector.name, item)
                assert not shapely.intersects(body, others).any(), (connector.name, item)
                put_down += 1
    assert put_down == 7 * 2 * 3


_ON_FLOORS = """
SELECT e.name, ST_AsBinary(w.footprint) AS footprint
FROM entity e JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND e.kind = 'object' AND e.type NOT IN ('wall', 'floor', 'window')
  AND ST_ZMin(w.box) < 0.9 AND ST_ZMax(w.box) > 0.05
"""

_RADIUS = """
SELECT diagonal FROM world w, LATERAL sqrt((ST_XMax(w.box) - ST_XMin(w.box)) ^ 2
                                        + (ST_YMax(w.box) - ST_YMin(w.box)) ^ 2) AS diagonal
WHERE w.entity_id = entity_id(:name)
"""


def test_tiago_carries_a_mug_through_the_storeys_of_the_hotel(
    building: Callable[..., Building],
) -> None:
    tables = ("restaurant", "L2-room1", "L3-room13")
    hotel = building("hotel", ("table in restaurant", (13.24, -13.24, 0.72)), tables)
    hotel.add_robot("lobby")
    for place in (*tables[1:], tables[0]):
        assert hotel.reach(f'on(mug1, "table in {place}")').state == "done"
        assert hotel.world.objects()["mug1"][0] == place
    floor = hotel.reach("in(mug1, shop)")
    assert floor.state == "done", floor
    spot = hotel.world.objects()["mug1"][1].pose
    for connector, side in hotel.live.topology.connectors_of("shop"):
        passage = shapely.LineString([p[:2] for p in connector.poses])
        assert passage.distance(shapely.Point(spot.x, spot.y)) > 0.6, connector.name
        assert connector.places[side] == "shop"
    assert hotel.reach("on(mug1, CoffeeTable_3)").reason == (
        "CoffeeTable_3 has no level surface to put mug1 on: the map has no shape of it; "
        "give it one, or let sizes be assumed (assume_sizes=True, --assume-sizes)"
    )
    waypoint = next(r for r in hotel.live.topology.regions if r.name == "L1-waypoint100")
    assert hotel.reach("in(robot, L1-waypoint100)").state == "done"
    _, pose = hotel.world.robot("robot")
    assert shapely.distance(waypoint.outline, shapely.Point(pose.x, pose.y)) <= 0.3
    assert hotel.reach("in(robot, L1-waypoint100)").state == "done"  # it is there already


def test_what_can_be_carried_follows_from_type_size_and_mass(engine: Engine) -> None:
    said = {}
    with engine.connect() as connection:
        for name in ("house", "hotel"):
            connection.execute(text("SELECT set_config('semmap.map', :n, true)"), {"n": name})
            world = read_world(
                seen_by(connection),
                parse_goal("on(object, table)"),
                read_topology(seen_by(connection)),
                (0.0, 1.6),
            )
            for item in world.objects.values():
                assert item.properties.get("static", True)  # kept, and not what decides
                said[name, item.name] = item.obstacle((0.0, 1.6))
    light = {"Tablet_01_001", "Tableware_01_001", "SeasoningBox_01_001", "DeskPortraitA_02"}
    assert {n for n in light if said["house", n] is None} == light
    assert "is a sofa" in (said["house", "SofaC_01_001"] or "")
    assert "is a wall" in (said["house", "HouseWallB_01_001"] or "")
    assert "m wide" in (said["house", "TV_01_001"] or "")
    assert "weighs 80 kg" in (said["house", "Dumbbell_01_001"] or "")
    assert any(why is None for (name, _), why in said.items() if name == "hotel")
    assert "is a kiosk" in (said["hotel", "DigitalKiosk"] or "")
    unknown = next(n for (where, n), _ in said.items() if where == "hotel" and "scalator" in n)
    assert "not in the T-Box" in (said["hotel", unknown] or "")


def test_a_run_on_the_command_line_changes_a_map_only_if_it_shall(
    engine: Engine, url: str, tmp_path: Path
) -> None:
    before, shared = state_of(engine, "house"), tmp_path / "shared"
    goal = "in(DeskPortraitD_02, bedroom)"
    words = ["--from", "bedroom", "--simulate", "--map", "house", "--speed", "100000"]
    runs = {
        "one": [goal, "--assume-grasps"],
        "two": ["on(SeasoningBox_01_001, CoffeeTable_01_001)", "--assume-grasps"],
    }
    processes = [
        subprocess.Popen(
            [SEMMAP, "--db", url, "run", *wanted, *words, "--world", shared, "--agent", name],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name, wanted in runs.items()
    ]
    printed = [process.communicate(timeout=600)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], printed
    assert "house is unchanged (--apply changes it)" in printed[0]
    assert state_of(engine, "house") == before
    with closing(SimWorld(shared)) as world:
        place, seen = world.objects()["DeskPortraitD_02"]
        assert (place, world.objects()["SeasoningBox_01_001"][0]) == (
            "bedroom",
            "living-room",
        )
        assert [world.robot(name)[1].z for name in runs] == [0.0, 0.0]  # on the floor
    assert semmap_command(url, "missions", "--map", "house").exit_code == 0
    own = ("--apply", "--world", tmp_path / "own")
    assert semmap_command(url, "run", *runs["one"], *words, *own).exit_code == 0
    after = state_of(engine, "house")
    assert after["DeskPortraitD_02"] != before["DeskPortraitD_02"]
    assert seen.holder == after["DeskPortraitD_02"][0]


def state_of(engine: Engine, name: str) -> dict[str, tuple[str | None, tuple[float, ...]]]:
    """The holder and pose of everything in a map."""
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT e.name, h.name AS holder, w.pose FROM entity e "
                "JOIN map m ON m.id = e.map_id LEFT JOIN placement p ON p.entity_id = e.id "
                "LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id "
                "WHERE m.name = :name"
            ),
            {"name": name},
        )
        return {row.name: (row.holder, tuple(row.pose or ())) for row in rows}


def test_the_demo_chooses_what_a_world_has(engine: Engine) -> None:
    with engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        house = choose(seen_by(connection), DemoChoices())
        _, rows = run_sql(connection, figure_3(house), write=False)
        connection.execute(text("SELECT set_config('semmap.map', 'hotel', true)"))
        hotel = choose(seen_by(connection), DemoChoices())
    assert house.type == "picture"  # three of them stand on the most furnished table
    assert "CoffeeTable_01_001" in {row[1] for row in rows}
    assert house.place in ("living-room", "bedroom")
    assert "KitchenTable_01_001" in house.onto
    assert hotel.type is None  # no object has a shape there


def test_who_may_not_copy_a_map_is_told_which_role_may(engine: Engine) -> None:
    for role in ("semmap_reader", "semmap_robot"):
        other = as_role(engine, role)
        try:
            with (
                pytest.raises(MissionError, match=f"{role} may not copy .*GRANT semmap_admin"),
                simulation_map(other, "hotel"),
            ):
                pass
        finally:
            other.dispose()


def test_a_copy_of_a_map_is_as_the_map_and_hidden(engine: Engine, url: str) -> None:
    with simulation_map(engine, "hotel") as name, simulation_map(engine, "hotel") as second:
        assert name != second  # another run takes place
        topologies = []
        for each in ("hotel", name):
            with engine.connect() as connection:
                connection.execute(text("SELECT set_config('semmap.map', :n, true)"), {"n": each})
                topologies.append(read_topology(seen_by(connection)))
        ours, copied = topologies
        assert {n: replace(p, id=None) for n, p in ours.places.items()} == {
            n: replace(p, id=None) for n, p in copied.places.items()
        }
        assert {n: replace(c, id=None) for n, c in ours.connectors.items()} == {
            n: replace(c, id=None) for n, c in copied.connectors.items()
        }
        assert [r.name for r in ours.regions] == [r.name for r in copied.regions]
        assert state_of(engine, name) == state_of(engine, "hotel")
        with semmap.connect(url) as database:
            assert database.maps == ["house", "hotel"]
            assert len(database.map(name)) == len(database.map("hotel"))
    with simulation_map(engine, "hotel") as again:
        assert again == name  # it is replaced, since its run has ended
