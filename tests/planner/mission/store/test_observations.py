"""What a robot observes, written in the map."""

import pytest
from sqlalchemy import text

from planner.mission.behaviours import RobotObservation
from planner.mission.store.observations import write_observation
from semmap.database.maps import see_map
from semmap.geometry.pose import Pose


@pytest.mark.parametrize("state", ["closed", "locked", "open"])
def test_doors_that_it_sees_are_in_the_map_as_it_saw_them(office_engine, state):
    with office_engine.connect() as connection:
        see_map(connection, "office")
        robot = connection.execute(
            text(
                "INSERT INTO entity (map_id, kind, name) VALUES (current_map(), 'agent', 'seer') "
                "RETURNING id"
            )
        ).scalar_one()
        seen = RobotObservation(
            "lab1", Pose.planar(13.0, 3.0), doors={"door1": state, "door2": "odd"}
        )
        write_observation(connection, robot, seen)
        states = dict(
            connection.execute(
                text(
                    "SELECT e.name, c.state FROM connector c JOIN entity e ON e.id = c.entity_id "
                    "WHERE e.map_id = current_map() AND e.name IN ('door1', 'door2')"
                )
            ).all()
        )
        connection.rollback()
    assert states == {"door1": state, "door2": "open"}
