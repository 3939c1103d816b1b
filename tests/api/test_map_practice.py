"""Attempts and their outcomes by methods of a map."""

from __future__ import annotations

import pytest

from semmap import Map
from semmap.manipulation.retrieval import DEFAULT_GRIPPER


@pytest.fixture(scope="module", autouse=True)
def plates(cup_map: Map) -> None:
    """A preferred gripper whose URDF is there."""
    cup_map.database.add_gripper(DEFAULT_GRIPPER, "plates", prefer=True)


def test_outcomes_count_and_are_listed(cups: Map) -> None:
    first, second = cups.grasps("cup1", limit=2, check=False)
    cups.record_attempt("cup1", first["action_id"], "error", robot="robot", message="slipped")
    cups.record_attempt(
        "cup1", second["action_id"], "completed", instead_of=first["action_id"], simulated=True
    )
    told = cups.list_manipulations(2)
    assert [(row["outcome"], row["robot"], row["message"]) for row in told] == [
        ("completed", None, None),
        ("error", "robot", "slipped"),
    ]
    rows = {row["action_id"]: row for row in cups.grasps("cup1", stored=True, limit=1000)}
    assert first["action_id"] not in rows, "it is replaced"
    now = rows[second["action_id"]]
    # simulation is trusted by half: (0.5 successes + 2 quality) / (0.5 attempts + 2)
    quality = second["quality"]
    assert now["attempts"] == 0.5
    assert now["expected"] == pytest.approx((0.5 + 2 * quality) / 2.5)
    with pytest.raises(LookupError, match="there is no action 999999"):
        cups.record_attempt("cup1", second["action_id"], "completed", instead_of=999999)


def test_practice_stores_each_outcome(cups: Map) -> None:
    tried = cups.practise("cup2", push=True, tries=2)
    told = cups.list_manipulations(len(tried))
    assert [row["action_id"] for row in reversed(told)] == [row["action_id"] for row in tried]
    assert {row["contributor"] for row in told} == {"simulation"}
    for row, task in zip(tried, reversed(told), strict=True):
        assert (row["outcome"] == "completed") == (task["outcome"] == "completed")


def test_shapes_are_those_of_the_solids(cups: Map) -> None:
    found = {row["entity"]: row for row in cups.find_shapes()}
    assert sorted(found["bottle"]["size"]) == pytest.approx([0.07, 0.07, 0.25], abs=1e-3)
    assert found["cup1"]["shape"] == "cylinder"
    told: list[tuple[str, int, int]] = []
    cups.find_shapes(["book"], progress=lambda *at: told.append(at))
    assert told == [("book", 0, 1)]
