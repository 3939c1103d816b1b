"""Practice on objects of a map: what was tried in simulation is what queries then propose."""

from __future__ import annotations

import numpy as np
import psycopg
import pytest

from semmap.manipulation.error import ManipulationError
from semmap.manipulation.evaluation import mismatch
from semmap.manipulation.practice import practise, practise_places, practise_pushes
from semmap.manipulation.ranking import grasp_of_row
from semmap.manipulation.reader import actions_on, list_tasks
from semmap.manipulation.retrieval import (
    DEFAULT_GRIPPER,
    find_grasps,
    register_gripper,
    stored_gripper,
)
from semmap.manipulation.solids import solid_of
from semmap.manipulation.trial import Trial, TrialOutcome, body_of
from tests.manipulation.grippers import urdf
from tests.seen import seen_by


def test_what_worked_in_simulation_is_proposed_first(cups):
    session = cups.connection
    register_gripper(session, urdf("panda"), "panda")
    attempts = practise(seen_by(session), "cup1", "panda", mass=0.2)
    assert attempts[-1]["outcome"] == "completed"
    best = attempts[-1]["stored"] or attempts[-1]["action_id"]
    tasks = {t["action_id"]: t["outcome"] for t in list_tasks(seen_by(session), 20)}
    assert tasks[best] == "completed"
    again = practise(seen_by(session), "cup1", "panda", mass=0.2)
    assert len(again) == 1  # at once
    assert again[0]["outcome"] == "completed"
    # The other cup of the model has it, too.
    row = next(
        r
        for r in actions_on(seen_by(session), name="cup2", gripper="panda", limit=500)
        if r["action_id"] == best
    )
    assert row["successes"] > 0


def test_what_fails_is_stored_with_its_cause_and_not_proposed_again(cups):
    """A heavy, slippery cup: nothing holds it."""
    session = cups.connection
    register_gripper(session, urdf("panda"), "panda")
    attempts = practise(seen_by(session), "cup1", "panda", mass=6.0, friction=0.2, tries=3)
    assert len(attempts) == 3
    assert all(a["outcome"] in ("missed", "dropped", "slipped", "turned") for a in attempts)
    failed = attempts[0]["action_id"]
    known = {
        r["action_id"]: r
        for r in actions_on(seen_by(session), name="cup1", gripper="panda", limit=500)
    }
    assert known[failed]["expected"] < 0.9
    assert (
        find_grasps(seen_by(session), name="cup1", gripper="panda").rows[0]["action_id"] != failed
    )


def heavy_bar(cups, name, length, gripper):
    """A bar on the floor, heavy at its end at -x; return what executes grasps of it."""
    session = cups.connection
    solid = solid_of("cuboid", (length, 0.04, 0.05))
    cups.add_object(name, mesh=solid.mesh(), pose=(3.0, 0.5, 0.0255))
    body = body_of(solid, mass=0.5, friction=0.5, offset=(-0.3 * length, 0, 0))
    standing = np.eye(4)
    standing[2, 3] = 0.0255
    return Trial(stored_gripper(session, gripper), body, standing).run


def test_a_correction_replaces_what_failed_and_is_carried_over_to_similar_shapes(cups):
    session = cups.connection
    for robot in ("panda", "pr2"):
        register_gripper(session, urdf(robot), robot)
    attempt = heavy_bar(cups, "bar", 0.24, "panda")
    first = find_grasps(seen_by(session), name="bar", gripper="panda").rows[0]
    assert abs(first["model_pose"].x) < 0.01
    attempts = practise(seen_by(session), "bar", "panda", attempt=attempt)
    assert [a["outcome"] == "completed" for a in attempts] == [False] * (len(attempts) - 1) + [True]
    failed, learned = attempts[0]["action_id"], attempts[-1]["stored"]
    assert failed == first["action_id"]
    assert learned not in (None, failed)
    # What worked is stored instead of what did not, which stays known as failed.
    rows = find_grasps(seen_by(session), name="bar", gripper="panda", limit=1000, check=False).rows
    assert rows[0]["action_id"] == learned
    assert rows[0]["model_pose"].x < -0.02  # at the heavy end
    stored = actions_on(seen_by(session), name="bar", gripper="panda", limit=1000)
    assert failed not in {r["action_id"] for r in [*rows, *stored]}
    outcomes = {t["action_id"]: (t["outcome"], t["message"]) for t in list_tasks(seen_by(session))}
    assert outcomes == {failed: ("error", attempts[0]["outcome"]), learned: ("completed", None)}
    kept = "SELECT id, attempts > 0, successes > 0, replaced_by FROM action WHERE attempts > 0"
    assert set(session.execute(kept).fetchall()) == {
        (failed, True, False, learned),
        (learned, True, True, None),
    }
    again = practise(seen_by(session), "bar", "panda", attempt=attempt)
    assert [(a["action_id"], a["outcome"]) for a in again] == [(learned, "completed")]
    # A longer bar, by this gripper and by another one: the first attempt is at the heavy end.
    for gripper in ("panda", "pr2"):
        name = f"longer bar for {gripper}"
        attempt = heavy_bar(cups, name, 0.27, gripper)
        with cups.transaction() as transaction:
            session.execute("UPDATE contributor SET trust = 0")
            blind = find_grasps(seen_by(session), name=name, gripper=gripper).rows[0]
            raise psycopg.Rollback(transaction)
        assert mismatch(attempt(grasp_of_row(blind, 0.08))) is not None
        (tried,) = practise(seen_by(session), name, gripper, attempt=attempt)
        best = find_grasps(seen_by(session), name=name, gripper=gripper).rows[0]
        assert (tried["outcome"], tried["action_id"]) == ("completed", best["action_id"])
        assert best["model_pose"].x < -0.02
        cups[name].delete()


def test_a_second_gripper_profits_from_the_first(cups):
    session = cups.connection
    register_gripper(session, urdf("panda"), "panda")
    register_gripper(session, DEFAULT_GRIPPER, "simple")
    practise(seen_by(session), "cup1", "panda", mass=6.0, friction=0.2, tries=1)
    failed = list_tasks(seen_by(session), 1)[0]["action_id"]
    family = next(
        r["family"]
        for r in actions_on(seen_by(session), name="cup1", gripper="panda", limit=500)
        if r["action_id"] == failed
    )
    rows = find_grasps(seen_by(session), name="cup1", gripper="simple", limit=500, check=False).rows
    alike = [r["expected"] for r in rows if r["family"] == family]
    assert alike
    assert max(alike) < max(r["expected"] for r in rows)


def test_a_correction_that_leads_back_is_not_tried(cups):
    """The cup turns one way, then the other way: between them is where the grasp failed before."""
    session = cups.connection
    register_gripper(session, urdf("panda"), "panda")
    first = find_grasps(seen_by(session), name="cup1", gripper="panda").rows[0]
    down = first["pose"].rotation_matrix.T @ [0.0, 0.0, -1.0]
    turn = tuple((0.6 * np.cross([0.0, *down[2:0:-1] * [1, -1]], down)).tolist())
    back = tuple(-v for v in turn)
    held = {"lifted": 0.15, "slipped": 0.0, "pushed": 0.0, "grip": 0.05, "width": 0.05}
    outcomes = iter(
        TrialOutcome(**held, turned=t, shift=(0, 0, 0)) for t in (turn, back, (0, 0, 0))
    )
    attempts = practise(seen_by(session), "cup1", "panda", attempt=lambda grasp: next(outcomes))
    assert [a["outcome"] for a in attempts] == ["turned", "turned", "completed"]
    assert [a["moved"] > 0 for a in attempts] == [False, True, False]
    assert attempts[2]["action_id"] != attempts[0]["action_id"] == first["action_id"]


def test_places_and_pushes_are_tried_and_their_outcomes_stored(cups):
    session = cups.connection
    register_gripper(session, urdf("panda"), "panda")
    placed = practise_places(seen_by(session), "cup1", "table", "panda", mass=0.2)
    pushed = practise_pushes(seen_by(session), "cup1", "panda", mass=0.2)
    for kind, attempts in (("place", placed), ("push", pushed)):
        assert attempts[-1]["outcome"] == "completed"
        assert attempts[-1]["off"] < 0.03
        rows = actions_on(seen_by(session), name="cup2", gripper="panda", kind=kind, limit=500)
        (row,) = (r for r in rows if r["action_id"] == attempts[-1]["action_id"])
        assert row["successes"] > 0
    heavy = practise_places(
        seen_by(session), "cup1", "table", "panda", mass=6.0, friction=0.2, tries=2
    )
    assert {attempt["outcome"] for attempt in heavy} == {"not held"}
    kinds = [task["kind"] for task in list_tasks(seen_by(session), 50)]
    assert kinds.count("place") == len(placed)  # what was not held is no outcome of a place


def test_objects_without_a_mesh_are_refused(cups):
    with pytest.raises(ManipulationError, match="note"):
        practise(seen_by(cups.connection), "note")
