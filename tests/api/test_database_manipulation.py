"""Grippers, robots and shared knowledge by methods of a database."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap
from semmap import Map
from semmap.manipulation.retrieval import DEFAULT_GRIPPER
from tests.conftest import MakeDatabase
from tests.manipulation.grippers import urdf


@pytest.fixture(scope="module", autouse=True)
def plates(cup_map: Map) -> None:
    """A preferred gripper whose URDF is there."""
    cup_map.database.add_gripper(DEFAULT_GRIPPER, "plates", prefer=True)


COUNTS = "SELECT count(*), sum(attempts)::int, sum(successes)::int FROM experience"


def test_knowledge_is_shared_from_database_to_database(
    cup_map: Map, make_database: MakeDatabase, tmp_path: Path
) -> None:
    db = cup_map.database
    grasps = cup_map.grasps("cup1", limit=3, check=False)
    for row, outcome in zip(grasps, ("error", "completed", "completed"), strict=True):
        cup_map.record_attempt("cup1", row["action_id"], outcome)
    counts = db.export_manipulation(tmp_path / "own.bundle", "kitchen robot")
    (stored,) = cup_map.execute("SELECT count(*) FROM action")
    assert counts["actions"] == stored[0]
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as other:
        with pytest.raises(ValueError, match="is signed by 'kitchen robot', whom nobody trusts"):
            other.import_manipulation(tmp_path / "own.bundle")
        other.trust_contributor("kitchen robot", db.manipulation_key(), 0.5)
        assert other.import_manipulation(tmp_path / "own.bundle")["actions"] == stored[0]
        mine, theirs = (one.session.execute(COUNTS).fetchone() for one in (db, other))
        assert mine == theirs
        (who,) = [row for row in other.list_contributors() if row["name"] == "kitchen robot"]
        assert (who["trust"], who["attempts"]) == (0.5, 3)
        assert {row["name"] for row in other.list_grippers()} <= {
            row["name"] for row in db.list_grippers()
        }


def test_robots_are_listed_by_what_they_are_able_to_do(cup_map: Map) -> None:
    db = cup_map.database
    assert db.add_manipulator(urdf("panda"), posture={"panda_joint4": -2.0}) == "panda"
    assert [row["name"] for row in db.list_manipulators(["grasp"])] == ["panda"]
    assert db.list_manipulators(["grasp", "see"]) == []
    with pytest.raises(LookupError, match="there is no capability gras; did you mean grasp"):
        db.list_manipulators(["gras"])
    with pytest.raises(ValueError, match="is beyond its limits"):
        db.add_manipulator(urdf("panda"), posture='{"panda_joint4": 2.0}')


def test_files_and_names_that_cannot_be_used(cup_map: Map, tmp_path: Path) -> None:
    db = cup_map.database
    with pytest.raises(ValueError, match=r"gone.urdf: does not exist"):
        db.add_gripper(tmp_path / "gone.urdf")
    with pytest.raises(ValueError, match="cannot be stored"):
        db.add_gripper(DEFAULT_GRIPPER, "two\0")
    with pytest.raises(ValueError, match=r"cannot be written \(No such file or directory\)"):
        db.export_manipulation(tmp_path / "gone" / "a.bundle", "me")
    with pytest.raises(ValueError, match=r"cannot be read \(No such file or directory\)"):
        db.import_manipulation(tmp_path / "gone.bundle")
    with pytest.raises(ValueError, match=r"cannot be read \(No such file or directory\)"):
        db.import_grasps([tmp_path / "gone.csv"])
    with pytest.raises(ValueError, match="is not a public key"):
        db.trust_contributor("me", "12")
