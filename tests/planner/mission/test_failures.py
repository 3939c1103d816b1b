"""Failures as one says them."""

from __future__ import annotations

import pytest

from planner.mission.failures import FailureRule
from planner.mission.retry_policy import Failure, RetryPolicy
from semmap.geometry.pose import Pose


@pytest.mark.parametrize(
    ("said", "rule"),
    [
        ("door5 locked", FailureRule("door5", "locked")),
        ("pickup fails once", FailureRule("pickup", times=1)),
        ("pickup fails 7", FailureRule("pickup", times=7)),
        ("drop fails 0.25", FailureRule("drop", chance=0.25)),
    ],
)
def test_rules(said: str, rule: FailureRule) -> None:
    assert FailureRule.parse(said) == rule


@pytest.mark.parametrize(
    "said",
    [
        "",
        "door5",
        "door5 gone",
        "locked",
        " broken",
        "grasp fails",
        "pickup fails 1.5",
        "jump fails once",
        "pickup fails -1",
        "pickup fails nan",
        "pickup fails 0",
    ],
)
def test_what_is_none(said: str) -> None:
    with pytest.raises(ValueError, match="is not a failure; write 'door5 locked'"):
        FailureRule.parse(said)


def test_names_may_have_blanks() -> None:
    assert FailureRule.parse("Cafe  door locked") == FailureRule("Cafe  door", "locked")
    assert FailureRule.parse(" Lift 1 broken ") == FailureRule("Lift 1", "broken")


def test_an_object_is_avoided_after_four_base_poses_or_three_failures_at_one() -> None:
    def failed(*where: float) -> list[Failure]:
        return [Failure("pickup", "cup", "unable", "too far", Pose(x)) for x in where]

    policy = RetryPolicy()
    assert policy.avoided(failed(1, 2, 3, 1)) == {}
    assert policy.avoided(failed(1, 2, 1, 1))["cup"].startswith("pickup of cup failed from 2")
    assert policy.avoided(failed(1, 1, 1))["cup"] == "pickup of cup failed 3 times: too far"
    assert "from 4 base poses" in policy.avoided(failed(1, 2, 3, 4))["cup"]
    assert policy.tried(failed(1, 2)) == {("cup", Pose(1)), ("cup", Pose(2))}
    assert policy.tried([Failure("pickup", "cup", "missed", "", Pose(1))]) == set()


@pytest.mark.parametrize(
    ("cause", "at", "again"),
    [
        ("missed", None, True),
        ("unable", Pose(1), True),  # from another base pose
        ("unable", None, False),
        ("full", None, False),
        ("unfit", None, False),
        ("unfit", Pose(1), False),
    ],
)
def test_what_would_be_the_same_again_is_not_tried(
    cause: str, at: Pose | None, again: bool
) -> None:
    failed = Failure("pickup", "cup", cause, "too wide", at)
    reasons = {} if again else {"cup": "pickup of cup failed once: too wide"}
    assert RetryPolicy().avoided([failed]) == reasons
