"""Missions in the small house, the hotel and the clinic: what could happen there, and what not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import shapely
from sqlalchemy import Engine, text

import semmap
from planner.live_topology import LiveTopology
from planner.mission import MissionStore, Runner
from planner.mission.command import Command
from planner.mission.sim_robot import SimBehaviour, SimulatedRobot, Work
from planner.mission.sim_setup import body_options, entry_poses, open_world
from planner.robot_class import RobotClass
from planner.task_planner import TaskPlanner
from planner.tasks import NoPlanError
from semmap import Map
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose
from semmap.robot import Part
from tests.effort import effort
from tests.manipulation.grippers import urdf
from tests.worlds.test_arms_small_house import FOLDED

CAN = Path("ycb/meshes/005_tomato_soup_can_textured.gltf")
ON_TABLE = (5.86, 0.87, 0.80135)
"""Where the can stands on the kitchen table of the small house."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of simulated worlds go into the test's folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def db(house_and_hotel: Engine, worlds: Path) -> Iterator[semmap.Database]:
    """The small house with a can on its kitchen table, and the hotel."""
    with semmap.connect(house_and_hotel.url.render_as_string(hide_password=False)) as db:
        db.map("house").add_object("can", type="can", mesh=worlds / CAN, pose=ON_TABLE)
        yield db


@pytest.fixture
def house(db: semmap.Database) -> Map:
    return db.map("house")


@pytest.fixture
def hotel(db: semmap.Database) -> Map:
    return db.map("hotel")


def run(map_: Map, goal: str, **options: Any) -> Any:
    """A simulated mission without trials of grasps."""
    return map_.run(goal, **{"speed": 1e5, "try_grasps": False, **options})


def subjects(ended: Any, action: str) -> list[str]:
    """The first argument of each step of a kind."""
    return [step["arguments"][0] for step in ended.steps if step["action"] == action]


def change(map_: Map, statement: str, **values: Any) -> None:
    """Change a map as another program does."""
    with map_.database.engine.begin() as connection:
        see_map(connection, map_.name)
        connection.execute(text(statement), values)


def agents(map_: Map) -> set[str]:
    """The names of the agents of a map."""
    with map_.database.engine.connect() as connection:
        see_map(connection, map_.name)
        found = "SELECT name FROM entity WHERE map_id = current_map() AND kind = 'agent'"
        return set(connection.execute(text(found)).scalars())


# -- failures on demand ---------------------------------------------------------------------------


def test_a_mission_takes_another_lift_than_the_broken_one(hotel: Map) -> None:
    goal, start = "in(robot, L3-room1)", {"start": "lobby"}
    (planned,) = set(subjects(run(hotel, goal, **start), "use_elevator"))
    (other,) = {"Lift1", "Lift2"} - {planned}
    ended = run(hotel, goal, **start, fail=[f"{planned} broken"])
    assert ended.done
    assert subjects(ended, "use_elevator") == [other]
    assert set(subjects(ended, "call_elevator")) == {planned, other}
    ended = run(hotel, goal, **start, fail=["Lift1 broken", "Lift2 broken"])
    assert not ended.done
    assert "call_elevator of Lift1 failed" in ended.reason
    assert "call_elevator of Lift2 failed" in ended.reason
    assert ended.reason.endswith("nothing joins them; run again once one of them works")
    assert subjects(ended, "use_elevator") == []


def test_a_door_whose_name_has_blanks_is_locked(house: Map) -> None:
    rename = "UPDATE entity SET name = :new WHERE id = entity_id(:old)"
    change(house, rename, old="bedroom-door", new="the bedroom's door")
    try:
        ended = run(
            house, "in(robot, bedroom)", start="kitchen", fail=["the bedroom's door locked"]
        )
    finally:
        change(house, rename, new="bedroom-door", old="the bedroom's door")
    assert (ended.state, ended.steps[-1]["cause"]) == ("failed", "locked")
    assert "the bedroom's door is locked" in ended.reason


# -- refused options ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fail": ["kitchen-dor locked"]}, "no door kitchen-dor; did you mean kitchen-door"),
        ({"fail": ["Lift1 broken"]}, "no elevator Lift1"),
        ({"put": ["can on the moon"]}, "no room holds the moon"),
        ({"put": ["can"]}, "is not 'OBJECT on PLACE'"),
        ({"speed": -1.0}, "speed is -1"),
        ({"assume_sizes": True}, "what is assumed is not written into a map"),
        ({"gripper": "claw"}, "no gripper claw"),
        ({"robot": "crawler"}, "no robot class named crawler"),
        ({"start": "cellar"}, "no place named cellar"),
        ({"agent": "nobody", "start": None}, "no robot named nobody"),
        ({"agent": "can"}, "can is of kind object"),
        ({"goal": "found(moon)"}, "no entity moon"),
    ],
)
def test_a_refused_option_leaves_no_mission_and_no_robot(
    house: Map, options: dict[str, Any], message: str
) -> None:
    before = house.missions(), agents(house)
    goal = options.pop("goal", "in(can, bedroom)")
    with pytest.raises((ValueError, LookupError, semmap.Error), match=message):
        run(house, goal, **{"start": "kitchen", "apply": True, **options})
    assert (house.missions(), agents(house)) == before
    assert not [*Path().rglob("*.sqlite")]


# -- what disappears during a mission -------------------------------------------------------------

REMOVE = "DELETE FROM entity WHERE id = entity_id(:name)"


@pytest.fixture
def copy(db: semmap.Database) -> Iterator[Map]:
    """A copy of the small house, with a second table beside the sofa, that a test may change."""
    with db.engine.begin() as connection:
        connection.execute(text("SELECT copy_map('house', 'copy')"))
    copy = db.map("copy")
    copy.add_object("table", type="table", size=(0.7, 0.7, 0.6), pose=(-1.5, 0, 0))
    yield copy
    with db.engine.begin() as connection:
        connection.execute(text("SELECT drop_map('copy')"))


def run_and_remove(copy: Map, goal: str, name: str, event: str, start: str = "kitchen") -> Any:
    """A mission during which somebody removes something at the first event of a kind."""
    moments = [event]

    def on_event(seen: Any) -> None:
        if moments and f"{seen.kind} {seen.command and seen.command.behaviour}" == moments[0]:
            moments.clear()
            change(copy, REMOVE, name=name)

    ended = run(copy, goal, start="kitchen", apply=True, on_event=on_event)
    assert moments == [], "it was removed"
    assert ended.state == copy.missions()[0]["state"]
    return ended


@pytest.mark.explore
@pytest.mark.parametrize("event", ["starts pickup", "starts place", *effort([], ["ended pickup"])])
def test_another_table_is_taken_when_the_first_disappears(copy: Map, event: str) -> None:
    goal = "in(can, living-room)"
    table = run(copy, goal, start="kitchen").steps[-1]["arguments"][-1]
    ended = run_and_remove(copy, goal, table, event)
    assert ended.done, ended.reason
    assert ended.steps[-1]["arguments"][-1] != table
    failed = [step for step in ended.steps if step["state"] == "failed"]
    assert {step["cause"] for step in failed} <= {"gone"}


@pytest.mark.parametrize(
    ("goal", "name", "event", "reason"),
    [
        ("on(can, table)", "can", "starts pickup", "there is no can"),
        ("on(can, table)", "can", "starts place", "there is no can"),
        ("on(can, BalconyTable_01_001)", "BalconyTable_01_001", "ended pickup", "is no Balcony"),
        ("on(can, BalconyTable_01_001)", "living-room", "started navigate", "cannot be reached"),
        ("on(can, BalconyTable_01_001)", "balcony-opening", "ended pickup", "has no door"),
        ("in(can, balcony)", "kitchen", "started navigate", "no room holds robot"),
        ("found(Tablet_01_001)", "Tablet_01_001", "started pass_door", "has no Tablet_01_001"),
    ],
)
def test_a_mission_ends_with_the_reason_when_what_it_needs_disappears(
    copy: Map, goal: str, name: str, event: str, reason: str
) -> None:
    ended = run_and_remove(copy, goal, name, event)
    assert ended.state == "failed"
    assert reason in ended.reason


def test_a_search_goes_on_when_a_place_disappears_at_which_it_looks(copy: Map) -> None:
    place: list[str] = []
    rooms = {room.name for room in copy.rooms}  # without that in which it stands, it gives up

    def on_event(seen: Any) -> None:
        if not place and seen.kind == "started" and seen.command.behaviour == "look":
            place.extend(each for each in seen.command.arguments[1:] if each not in rooms)
            change(copy, REMOVE, name=place[0])

    ended = run(
        copy,
        "found(Tablet_01_001)",
        start="kitchen",
        put=["Tablet_01_001 on NightStand_01_001"],  # the first look does not show it
        apply=True,
        on_event=on_event,
    )
    looks = [step for step in ended.steps if step["action"] == "look"]
    assert len(looks) > 1
    assert all(place[0] not in step["arguments"] for step in looks[1:])
    assert copy.missions()[0]["state"] == ended.state != "running"


# -- words of a goal ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [{"type": "home_region"}, {"properties": {"home": True}}])
def test_home_is_a_region_of_the_type_or_with_the_property(copy: Map, kind: dict[str, Any]) -> None:
    """The region has another name, and a second one is no home."""
    corners = {"basket": (-6.2, -4.6, -5.2, -3.6), "mat": (8.0, -0.2, 8.8, 0.5)}
    for name, (x0, y0, x1, y1) in corners.items():
        more = kind if name == "mat" else {}
        copy.draw_region(name, box=(x0, y0, 0, x1, y1, 0.5), **more)
    with MissionStore(copy) as store:
        ended = run(copy, "in(robot, home)", start="bedroom", apply=True)
        assert ended.done, ended.reason
        place, pose = store.robot("robot") or ("", Pose())
    assert place == "kitchen"
    assert shapely.box(*corners["mat"]).covers(shapely.Point(pose.x, pose.y))
    assert run(copy, "in(robot, home)").steps == []  # it is there already
    assert copy.route("bedroom", "home").steps[-1].to_place == "kitchen"


# -- what a robot can grasp -----------------------------------------------------------------------


def test_what_no_grasp_fits_is_not_brought_by_an_assumed_gripper(house: Map) -> None:
    """The ball is 64 cm wide; the robot, of which nothing is known, does not pretend."""
    change(house, OWN, name="Ball_01_003", own='{"graspable": true}')
    ended = run(house, "in(Ball_01_003, living-room)", start="bedroom")
    assert ended.state == "failed"
    assert "no grasp fits its shape (sphere" in ended.reason
    assert "parallel_gripper is assumed" in ended.reason
    assert subjects(ended, "place") == []


def test_the_gripper_in_the_urdf_of_the_class_decides(db: semmap.Database, house: Map) -> None:
    """A TIAGo's gripper takes the can, and not the ball; a plan says so before a mission."""
    db.add_robot("tiago", urdf("tiago"), posture=FOLDED)
    change(house, OWN, name="Ball_01_003", own='{"graspable": true}')
    with pytest.raises(NoPlanError, match=r"Ball_01_003: no grasp fits .* gripper tiago\w* opens"):
        house.plan("in(Ball_01_003, kitchen)", start="bedroom", robot="tiago")
    own = {"tiago_gripper"}
    assert own.isdisjoint(row["name"] for row in db.list_grippers())  # a plan stores nothing
    ended = run(house, "in(Ball_01_003, kitchen)", start="bedroom", robot="tiago")
    assert (ended.state, ended.steps) == ("failed", [])
    ended = run(house, "on(can, CoffeeTable_01_001)", start="kitchen", robot="tiago")
    assert ended.done, ended.reason
    (pickup,) = (step for step in ended.steps if step["action"] == "pickup")
    assert "by tiago_gripper" in pickup["message"]
    assert "of the arm, planned" in pickup["message"]


OWN = """
UPDATE entity SET properties = properties || CAST(:own AS jsonb) WHERE id = entity_id(:name)
"""


# -- objects without geometry ---------------------------------------------------------------------


def test_a_hotel_of_shapeless_tables_works_with_typical_sizes(hotel: Map, worlds: Path) -> None:
    """The tables have the size that the T-Box states for their type, in the copy alone."""
    if "can" not in hotel:
        hotel.add_object("can", type="can", mesh=worlds / CAN, pose=(17.4, -16.0, 8.7705))
    goal, table = "on(can, CoffeeTable_3)", hotel["CoffeeTable_3"]
    with pytest.raises(NoPlanError, match="CoffeeTable_3 has no level surface"):
        hotel.plan(goal, start="lobby")
    plan = hotel.plan(goal, start="lobby", assume_sizes=True)
    assert plan.assumed == ("CoffeeTable_3",)
    said: list[str] = []
    ended = plan.run(speed=1e5, try_grasps=False, say=said.append)
    assert ended.done, ended.reason
    assert "CoffeeTable_3" in ended.assumed
    assert any("the typical size of the type is assumed" in text for text in said)
    with MissionStore(hotel.database.map(ended.map)) as store:
        seen = {row.name: row.seen for row in store.objects()}["can"]
    assert seen.holder == "CoffeeTable_3"
    sizes = "SELECT typical_size FROM semantic_type WHERE name = 'coffee_table'"
    depth, width, height = hotel.execute(sizes)[0][0]
    can = hotel["can"]
    middle = can.pose.inverse().apply([can.mesh.bounds.mean(axis=0)])
    offset = table.pose.inverse().apply(seen.pose.apply(middle))[0]
    assert abs(offset[0]) < max(depth, width) / 2
    assert abs(offset[1]) < max(depth, width) / 2
    assert 0 < offset[2] - height < 0.1
    with pytest.raises(NoPlanError, match="CoffeeTable_3 has no level surface"):
        hotel.plan(goal, start="lobby")


# -- another base pose ----------------------------------------------------------------------------


class Clumsy(SimulatedRobot):
    """Its arm takes nothing, or puts nothing down, from so many base poses at first."""

    def __init__(self, action: str, poses: int, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.action, self.poses, self.bases = action, poses, list[Pose]()

    def pickup(self, command: Command) -> SimBehaviour:
        return self._tried(command) or super().pickup(command)

    def place(self, command: Command) -> SimBehaviour:
        return self._tried(command) or super().place(command)

    def _tried(self, command: Command) -> SimBehaviour | None:
        if command.behaviour != self.action:
            return None
        _, pose = self.world.robot(self.name)
        self.bases.append(pose)
        return SimBehaviour(self._fail(), self.speed) if len(self.bases) <= self.poses else None

    def _fail(self) -> Work:
        yield 0.0
        return "unable", "the arm reaches nothing from here"


def test_what_no_grasp_takes_is_not_tried(house: Map) -> None:
    """It is not tried at all: the plan judges as the mission does."""
    goal = "on(Tablet_01_001, KitchenTable_01_001)"
    ended = run(house, goal, start="living-room")
    assert (ended.state, subjects(ended, "pickup")) == ("failed", [])
    with pytest.raises(NoPlanError) as refused:
        house.plan(goal, start="living-room")
    assert "grasps, the gripper touches what is around" in str(refused.value)
    assert ended.reason == str(refused.value)


@pytest.mark.parametrize("action", ["pickup", "place"])
@pytest.mark.parametrize(("poses", "state"), [(2, "done"), (99, "failed")])
def test_other_base_poses_are_tried_before_giving_up(
    copy: Map, action: str, poses: int, state: str
) -> None:
    corners = shapely.get_coordinates(shapely.Point(0, 0).buffer(0.2).exterior)[:0:-1]
    part = Part("base", ("base",), (0.05, 1.0), corners, 0.199, 0.2)
    live = LiveTopology(copy, RobotClass("disc", (part,)))
    with MissionStore(copy, "test") as store:
        store.add_robot("robot", "kitchen", entry_poses(live.graph, "kitchen")[0])
        with closing(open_world(Path("world"), store, live.topology, "robot")) as world:
            options = body_options(live, speed=1e6)
            robot = Clumsy(action, poses, "robot", world, live.topology, **options)
            runner = Runner(store, robot, TaskPlanner(live), speed=1e6, tick=0)
            ended = runner.run(store.add("robot", "on(can, CoffeeTable_01_001)"))
    assert ended.state == state, ended.reason
    assert len(robot.bases) == min(poses + 1, 4)
    places = [(pose.x, pose.y) for pose in robot.bases]
    apart = [math.dist(a, b) for a, b in combinations(places, 2)]
    assert min(apart) > 0.1
    if state == "failed":
        assert "failed from 4 base poses: the arm reaches nothing from here" in ended.reason
