"""What the outcomes of one gripper tell of another one: by their geometry, as the map has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semmap import Map
from semmap.manipulation.ranking import evidence_on
from semmap.manipulation.retrieval import find_grasps, register_gripper
from semmap.manipulation.solids import solid_of
from semmap.manipulation.store.tasks import record_task
from tests.manipulation.grippers import gripper_by_hand, real_gripper, urdf
from tests.seen import seen_by

HEAVY = -0.03
"""Where a bar is held at its heavy end: x less than this, metres from its middle."""


def bar(cups: Map, length: float) -> str:
    name = f"bar of {length} m"
    solid = solid_of("cuboid", (length, 0.04, 0.05))
    cups.add_object(name, mesh=solid.mesh(), pose=(3.0, 0.5, 0.0255))
    return name


def grasps(cups: Map, name: str, gripper: str) -> list[dict[str, Any]]:
    seen = seen_by(cups.connection)
    return list(find_grasps(seen, name=name, gripper=gripper, limit=1000, check=False).rows)


def teach(cups: Map, gripper: str) -> None:
    """Bars hold at their heavy end alone."""
    for length in (0.2, 0.22, 0.25):
        name = bar(cups, length)
        rows = grasps(cups, name, gripper)
        ends = [row for row in rows if abs(row["model_pose"].x) > 0.03]
        for row in (*rows[:4], *ends[:4], *ends[-4:]):
            outcome = "completed" if row["model_pose"].x < HEAVY else "error"
            record_task(cups.connection, name, action=row["action_id"], outcome=outcome)


@pytest.fixture
def kitchen(cups: Map) -> Map:
    for robot in ("panda", "pr2", "allegro"):
        register_gripper(cups.connection, urdf(robot), robot)
    return cups


def test_outcomes_of_a_gripper_reorder_the_grasps_of_a_similar_one(kitchen: Map) -> None:
    name = bar(kitchen, 0.23)
    before = grasps(kitchen, name, "pr2")
    assert before[0]["model_pose"].x > HEAVY
    teach(kitchen, "panda")
    after = grasps(kitchen, name, "pr2")
    assert {row["action_id"] for row in after} == {row["action_id"] for row in before}
    assert after[0]["model_pose"].x < HEAVY
    assert all(row["model_pose"].x < -0.02 for row in after[:5])
    kitchen.connection.execute("UPDATE contributor SET trust = 0")
    assert grasps(kitchen, name, "pr2") == before


def test_a_gripper_of_another_form_teaches_nothing(kitchen: Map) -> None:
    name = bar(kitchen, 0.23)
    before = grasps(kitchen, name, "pr2")
    teach(kitchen, "allegro")
    assert grasps(kitchen, name, "pr2") == before
    (number,) = {row["object_id"] for row in before}
    assert evidence_on(kitchen.connection, number, "pr2").by_geometry is None
    assert evidence_on(kitchen.connection, number, "allegro").by_geometry is not None


def test_the_less_alike_grippers_are_the_less_outcomes_count(kitchen: Map) -> None:
    here = kitchen.connection
    name = bar(kitchen, 0.23)
    best = grasps(kitchen, name, "pr2")[0]["object_id"]
    teach(kitchen, "panda")

    def share(opening: float) -> float:
        here.execute(
            "UPDATE gripper SET opening = %s WHERE device_id = gripper_named('panda')", (opening,)
        )
        return evidence_on(here, best, "pr2").alike.every.attempts

    counted = [share(opening) for opening in (0.09, 0.18, 0.4)]
    assert counted[0] > counted[1] > counted[2] > 0
    width = real_gripper("pr2").opening
    wider, widest = (np.log(opening / width) for opening in (0.18, 0.4))
    assert counted[2] / counted[1] == pytest.approx(np.exp((wider**2 - widest**2) / 2))


def test_likeness_is_that_of_the_descriptors(kitchen: Map) -> None:
    likeness = "SELECT gripper_likeness(gripper_named(%s), gripper_named(%s))"

    def alike(one: str, other: str) -> float:
        return float(kitchen.connection.execute(likeness, (one, other)).fetchone()[0])

    a, b = real_gripper("panda"), real_gripper("pr2")
    apart = np.log([a.opening / b.opening, a.depth / b.depth])
    volumes = np.log(a.swept_volume / b.swept_volume) / 3
    assert alike("panda", "pr2") == pytest.approx(np.exp(-(apart @ apart + volumes**2) / 2))
    assert alike("panda", "pr2") == alike("pr2", "panda")
    assert alike("pr2", "pr2") == 1
    assert alike("pr2", "allegro") == 0
    kitchen.connection.execute("UPDATE gripper SET swept = NULL")  # not read since an upgrade
    assert alike("panda", "pr2") == pytest.approx(np.exp(-(apart @ apart) / 2))


def test_two_plates_pass_the_boxes_through_which_they_slide(tmp_path: Path) -> None:
    """Each is 1 x 2 x 6 cm and slides by 5 cm."""
    assert gripper_by_hand(tmp_path).swept_volume == pytest.approx(2 * 0.06 * 0.02 * 0.06)
