"""Practice on objects of a map: what was tried in simulation is what queries then propose."""

from __future__ import annotations

import pytest

from semmap.manipulation.error import ManipulationError
from semmap.manipulation.practice import practise, practise_places, practise_pushes
from semmap.manipulation.reader import actions_on, list_tasks
from semmap.manipulation.retrieval import DEFAULT_GRIPPER, find_grasps, register_gripper
from tests.manipulation.grippers import urdf


def test_what_worked_in_simulation_is_proposed_first(cups):
    session = cups.session_of_map()
    register_gripper(session, urdf("panda"), "panda")
    attempts = practise(session, "cup1", "panda", mass=0.2)
    assert attempts[-1]["outcome"] == "completed"
    best = attempts[-1]["stored"] or attempts[-1]["action_id"]
    tasks = {t["action_id"]: t["outcome"] for t in list_tasks(session, 20)}
    assert tasks[best] == "completed"
    again = practise(session, "cup1", "panda", mass=0.2)
    assert len(again) == 1  # at once
    assert again[0]["outcome"] == "completed"
    # The other cup of the model has it, too.
    row = next(
        r
        for r in actions_on(session, name="cup2", gripper="panda", limit=500)
        if r["action_id"] == best
    )
    assert row["successes"] > 0


def test_what_fails_is_replaced_by_its_correction(cups):
    """A heavy, slippery cup: nothing holds it, and each failure is stored with its cause."""
    session = cups.session_of_map()
    register_gripper(session, urdf("panda"), "panda")
    attempts = practise(session, "cup1", "panda", mass=6.0, friction=0.2, tries=3)
    assert len(attempts) == 3
    assert all(a["outcome"] in ("missed", "dropped", "slipped", "turned") for a in attempts)
    failed = attempts[0]["action_id"]
    known = {
        r["action_id"]: r for r in actions_on(session, name="cup1", gripper="panda", limit=500)
    }
    assert known[failed]["expected"] < 0.9
    assert find_grasps(session, name="cup1", gripper="panda").rows[0]["action_id"] != failed


def test_a_second_gripper_profits_from_the_first(cups):
    session = cups.session_of_map()
    register_gripper(session, urdf("panda"), "panda")
    register_gripper(session, DEFAULT_GRIPPER, "simple")
    practise(session, "cup1", "panda", mass=6.0, friction=0.2, tries=1)
    failed = list_tasks(session, 1)[0]["action_id"]
    family = next(
        r["family"]
        for r in actions_on(session, name="cup1", gripper="panda", limit=500)
        if r["action_id"] == failed
    )
    find_grasps(session, name="cup1", gripper="simple")
    rows = actions_on(session, name="cup1", gripper="simple", limit=500)
    alike = [r["expected"] for r in rows if r["family"] == family]
    assert alike
    assert max(alike) < max(r["expected"] for r in rows)


def test_places_and_pushes_are_tried_and_their_outcomes_stored(cups):
    session = cups.session_of_map()
    register_gripper(session, urdf("panda"), "panda")
    placed = practise_places(session, "cup1", "table", "panda", mass=0.2)
    pushed = practise_pushes(session, "cup1", "panda", mass=0.2)
    for kind, attempts in (("place", placed), ("push", pushed)):
        assert attempts[-1]["outcome"] == "completed"
        assert attempts[-1]["off"] < 0.03
        rows = actions_on(session, name="cup2", gripper="panda", kind=kind, limit=500)
        (row,) = (r for r in rows if r["action_id"] == attempts[-1]["action_id"])
        assert row["successes"] > 0
    heavy = practise_places(session, "cup1", "table", "panda", mass=6.0, friction=0.2, tries=2)
    assert {attempt["outcome"] for attempt in heavy} == {"not held"}
    kinds = [task["kind"] for task in list_tasks(session, 50)]
    assert kinds.count("place") == len(placed)  # what was not held is no outcome of a place


def test_objects_without_a_mesh_are_refused(cups):
    with pytest.raises(ManipulationError, match="note"):
        practise(cups.session_of_map(), "note")
