"""A map with the office, a robot in lab1, and a world of which it knows what it sees."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text

from planner.mission import MissionStore, Runner, Sighting
from planner.mission.failures import FailureRule
from planner.mission.sim_robot import SimulatedRobot
from planner.mission.sim_world import SimWorld
from semmap.database import open_engine
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapHandle
from tests.conftest import Import
from tests.office import OFFICE_FILES
from tests.planner.mission.simple import simple_planner

START = Pose.planar(13.0, 2.5)
SPEED = 1e5


@pytest.fixture(scope="session")
def mission_url(imported: Import) -> Iterator[str]:
    """A database with the office, which missions may change; each test begins with it as it was."""
    with imported(*((path, "office") for path in OFFICE_FILES)) as engine:
        with engine.begin() as connection:
            for name in ("placement", "connector"):
                connection.execute(text(f"CREATE TABLE public.was_{name} AS SELECT * FROM {name}"))
        yield engine.url.render_as_string(hide_password=False)


AS_IT_WAS = (
    "DELETE FROM reservation",
    "DELETE FROM execution",
    "DELETE FROM mission",
    "DELETE FROM task",
    "DELETE FROM automaton",
    "DELETE FROM device",  # with grippers and what is known of them
    "DELETE FROM entity WHERE kind = 'agent' OR name = 'muffin2'",
    "UPDATE placement p SET holder_id = k.holder_id, relation = k.relation, pose = k.pose "
    "FROM public.was_placement k WHERE k.entity_id = p.entity_id "
    "AND (p.holder_id, p.relation, p.pose) IS DISTINCT FROM (k.holder_id, k.relation, k.pose)",
    "UPDATE connector c SET state = k.state, seen_at = NULL "
    "FROM public.was_connector k WHERE k.entity_id = c.entity_id",
)


class World:
    """A map and the world, side by side."""

    def __init__(self, url: str, folder: Path) -> None:
        self.url = url
        self.file = folder / "sim_world"
        self.engine: Engine = open_engine(url)
        self.begin_anew()

    def begin_anew(self) -> None:
        """The map and the world as they were."""
        with self.engine.begin() as connection:
            for statement in AS_IT_WAS:
                connection.execute(text(statement))
        with self.store() as store:
            self.topology = store.topology()
            objects = [(t.name, t.place, t.seen) for t in store.objects() if "muffin" in t.name]
        self.objects = objects
        self.file.unlink(missing_ok=True)
        self.world = SimWorld.make(self.file, self.topology, objects)
        self.add_robot("robot", "lab1", START)

    def add_robot(self, name: str, place: str, pose: Pose) -> None:
        with self.store() as store:
            store.add_robot(name, place, pose)
        self.world.put_robot(name, place, pose)

    def store(self, runner: str = "test") -> MissionStore:
        return MissionStore(MapHandle(self.engine, "office"), runner)

    def robot(self, name: str = "robot", **more: Any) -> SimulatedRobot:
        return SimulatedRobot(name, self.world, self.topology, **{"speed": SPEED, **more})

    def fail(self, *said: str) -> None:
        self.world.add_rules(FailureRule.parse(s) for s in said)

    def run(self, goal: str = "on(muffin, desk1)", robot: str = "robot", **more: Any) -> Any:
        with self.store() as store:
            runner = Runner(
                store,
                self.robot(robot),
                simple_planner,
                **{"speed": SPEED, "tick": 0.0, **more},
            )
            return runner.run(store.add(robot, goal))

    def ask(self, sql: str, **values: Any) -> list[Any]:
        with self.engine.begin() as connection:
            connection.execute(text("SET LOCAL semmap.map = 'office'"))
            return list(connection.execute(text(sql), values).all())

    def add_muffin(self, place: str, holder: str, pose: Pose) -> None:
        """Another muffin, as large as the first."""
        self.ask(
            "INSERT INTO entity (map_id, kind, name, type) "
            "VALUES (current_map(), 'object', 'muffin2', 'muffin') RETURNING id"
        )
        self.ask(
            "INSERT INTO placement (entity_id, holder_id, pose, relation) "
            "SELECT entity_id('muffin2'), w.entity_id, pose_compose(pose_inverse(w.pose), "
            "CAST(:pose AS float8[])), 'on' FROM world w WHERE w.entity_id = entity_id(:holder) "
            "RETURNING 1",
            pose=pose.row,
            holder=holder,
        )
        self.ask(
            "INSERT INTO entity_model (entity_id, model_id, role) SELECT entity_id('muffin2'), "
            "model_id, role FROM entity_model WHERE entity_id = entity_id('muffin1') RETURNING 1"
        )
        self.world.put_object("muffin2", place, Sighting(holder, "on", pose))

    def holder(self, name: str) -> tuple[str, str]:
        return tuple(
            self.ask(
                "SELECT h.name, p.relation FROM placement p JOIN entity h ON h.id = p.holder_id "
                "WHERE p.entity_id = entity_id(:name)",
                name=name,
            )[0]
        )

    def check(self, robot: str = "robot") -> None:
        """The map says of robot and objects what is true."""
        place, pose = self.world.robot(robot)
        assert self.holder(robot) == (place, "in")
        assert near(self.world_pose(robot), pose)
        for name, (_, seen) in self.world.objects().items():
            assert self.holder(name) == (seen.holder, seen.relation), name
            at = seen.pose
            if self.world.has_robot(seen.holder):
                at = self.world.robot(seen.holder)[1] @ at
            assert near(self.world_pose(name), at), name

    def world_pose(self, name: str) -> Pose:
        row = self.ask("SELECT pose FROM world WHERE entity_id = entity_id(:name)", name=name)
        return Pose(*row[0][0])

    def close(self) -> None:
        self.world.close()
        self.engine.dispose()


def near(a: Pose, b: Pose) -> bool:
    return bool(abs(a.translation - b.translation).max() < 0.011)


@pytest.fixture
def world(mission_url: str, tmp_path: Path) -> Iterator[World]:
    made = World(mission_url, tmp_path)
    yield made
    made.close()
