"""Knowledge that one database signs and another one imports; and bundles that are refused whole."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
from nacl.signing import SigningKey

import semmap
from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.reader import actions_by_shape, actions_on
from semmap.manipulation.signing import own_key
from semmap.manipulation.store.actions import add_actions, add_put
from semmap.manipulation.store.bundle import export_bundle, import_bundle, trust
from semmap.manipulation.store.devices import add_gripper
from semmap.manipulation.store.models import object_model_id, set_shape
from semmap.manipulation.store.tasks import record_task
from tests.conftest import MakeDatabase
from tests.manipulation.cup_map import candidate, primitive
from tests.seen import seen_by

KEY = SigningKey(bytes(range(32)))
PUBLIC = bytes(KEY.verify_key).hex()


@pytest.fixture(scope="module")
def other_database(make_database: MakeDatabase) -> Iterator[Any]:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        db.create_map("elsewhere")
        yield db.session


@pytest.fixture
def other(other_database: Any) -> Iterator[Any]:
    """A database that has the T-Box, and neither objects nor grippers."""
    with other_database.transaction() as transaction:
        yield other_database
        raise psycopg.Rollback(transaction)


@pytest.fixture
def taught(cups: Map) -> dict[str, int]:
    """Ids of actions: one that failed, the one that replaces it, one that nobody tried, a put."""
    here = cups.connection
    set_shape(here, "cup1", primitive("cylinder", 0.035, 0.09))
    failed, new = add_actions(here, "cup1", None, [candidate(quality=0.9), candidate(yaw=1.0)])
    (worked,) = add_actions(here, "cup1", None, [candidate(x=0.004, shift=(0.0, 0.004, 0.0))])
    (place,) = add_actions(
        here, "cup1", None, [ActionRecord("place", Pose(z=0.05), post_pose=Pose(z=0.2))]
    )
    record_task(here, "cup1", action=failed, outcome="error")
    record_task(here, "cup2", action=worked, outcome="completed", instead_of=failed)
    whole = add_put(here, worked, place)
    return {"failed": failed, "worked": worked, "new": new, "put": whole}


def rows(other: Any) -> dict[str, int]:
    tables = ("device", "object_model", "object_mesh", "action", "experience", "action_step")
    return {t: other.execute(f"SELECT count(*) FROM {t}").fetchone()[0] for t in tables}


def test_another_database_knows_what_the_first_one_learned(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path
) -> None:
    here = cups.connection
    path = tmp_path / "cups.bundle"
    counts = export_bundle(here, path, "kitchen", key=KEY)
    assert counts == {"grippers": 1, "objects": 1, "actions": 5}
    trust(other, "kitchen robot", PUBLIC)
    assert import_bundle(other, path) == counts | {"outcomes": 2}
    known = rows(other)
    assert known == {
        "device": 1,
        "object_model": 1,
        "object_mesh": 1,
        "action": 5,
        "experience": 2,
        "action_step": 2,
    }
    best, untried = actions_by_shape(other, "cylinder", (0.035, 0.09))
    assert best["pose"].matrix == pytest.approx(candidate(x=0.004).pose)
    assert best["expected"] == pytest.approx(2 / 3)
    assert untried["pose"].matrix == pytest.approx(candidate(yaw=1.0).pose)
    source = other.execute(
        "SELECT DISTINCT c.name FROM action a JOIN contributor c ON c.id = a.contributor_id"
    ).fetchall()
    assert source == [("kitchen robot",)]
    assert import_bundle(other, path)["actions"] == 0
    assert rows(other) == known


def test_a_cup_of_the_same_mesh_profits_and_outcomes_count_by_trust(
    cups: Map, taught: dict[str, int], tmp_path: Path
) -> None:
    here = cups.connection
    path = tmp_path / "cups.bundle"
    export_bundle(here, path, "kitchen", key=KEY)
    here.execute("DELETE FROM action")
    assert actions_on(seen_by(here), name="cup2") == []
    trust(here, "friend", PUBLIC, 0.5)
    import_bundle(here, path)
    (row, other) = actions_on(seen_by(here), name="cup2")
    assert (row["attempts"], row["successes"], row["contributor"]) == (0.5, 0.5, "friend")
    assert (row["shift"], other["shift"]) == ([0.0, 0.004, 0.0], None)
    trust(here, "friend", PUBLIC, 1)
    assert actions_on(seen_by(here), name="cup2")[0]["attempts"] == 1
    record_task(here, "cup2", action=row["action_id"], outcome="completed")
    import_bundle(here, path)  # replaces the outcomes of the friend, and keeps the own ones
    cup = object_model_id(here, "cup1")
    tried = here.execute(
        "SELECT approach, sum(attempts), sum(successes) FROM action "
        "WHERE object_id = %s AND kind = 'grasp' AND attempts > 0 GROUP BY 1",
        (cup,),
    ).fetchall()
    assert ("side", 3, 2) in tried


def test_what_was_only_imported_is_not_shared_again(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path
) -> None:
    path = tmp_path / "cups.bundle"
    export_bundle(cups.connection, path, "kitchen", key=KEY)
    trust(other, "kitchen", PUBLIC)
    import_bundle(other, path)
    assert export_bundle(other, tmp_path / "mine", "me", key=KEY)["actions"] == 0


def changed(content: bytes, line: int, old: str, new: str) -> bytes:
    lines = content.split(b"\n")
    assert old.encode() in lines[line]
    lines[line] = lines[line].replace(old.encode(), new.encode())
    return b"\n".join(lines)


def signed(content: bytes) -> bytes:
    """The bundle, signed again by its contributor."""
    body = content.rstrip(b"\n").rpartition(b"\n")[0] + b"\n"
    return body + json.dumps({"signature": KEY.sign(body).signature.hex()}).encode() + b"\n"


DAMAGE = {
    "a changed outcome": (lambda c: changed(c, 3, '"attempts": 1', '"attempts": 9'), "was changed"),
    "a truncated file": (lambda c: c[: len(c) // 2], "was changed"),
    "a missing line": (lambda c: c.replace(c.split(b"\n")[2] + b"\n", b""), "was changed"),
    "a line more": (lambda c: c + b'{"object": {}}\n', "was changed"),
    "another version": (
        lambda c: signed(changed(c, 0, '"version": 1', '"version": 2')),
        "is of version 2, this semmap reads version 1",
    ),
    "another format": (lambda c: b"hello\n" + c, "is not a bundle"),
    "nothing": (lambda c: b"", "is not a bundle"),
    "an unknown key": (
        lambda c: changed(c, 0, PUBLIC, SigningKey.generate().verify_key.encode().hex()),
        "whom nobody trusts",
    ),
    "a pose that is not one": (
        lambda c: signed(changed(c, 3, '"pose": [', '"pose": [7, ')),
        "line 4: line 4: pose: is not a pose",
    ),
    "more successes than attempts": (
        lambda c: signed(changed(c, 3, '"successes": 0', '"successes": 5')),
        "line 4: 5 of 1 attempts",
    ),
    "a content of another action": (
        lambda c: signed(changed(c, 3, '"kind": "grasp"', '"kind": "place"')),
        "its key does not belong",
    ),
    "an object that is missing": (
        lambda c: signed(changed(c, 3, '"object": "mesh:', '"object": "mush:')),
        "is not in the bundle before it",
    ),
    "an unknown entry": (
        lambda c: signed(changed(c, 1, '{"gripper"', '{"gripperr"')),
        "'gripperr' is not an entry",
    ),
    "a shape that is not one": (
        lambda c: signed(changed(c, 2, '"cylinder"', '"potato"')),
        "refused: object model shape",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_bundle_is_refused_whole(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path, name: str
) -> None:
    path = tmp_path / "cups.bundle"
    export_bundle(cups.connection, path, "kitchen", key=KEY)
    trust(other, "kitchen", PUBLIC)
    damage, text = DAMAGE[name]
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ManipulationError, match=text):
        import_bundle(other, path)
    assert set(rows(other).values()) == {0}


def test_bundles_of_strangers_of_the_distrusted_and_old_ones_are_refused(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path
) -> None:
    here = cups.connection
    old, new = tmp_path / "old", tmp_path / "new"
    export_bundle(here, old, "kitchen", key=KEY)
    export_bundle(here, new, "kitchen", key=KEY)
    with pytest.raises(ManipulationError, match="whom nobody trusts here"):
        import_bundle(other, new)
    trust(other, "kitchen", PUBLIC, 0)
    with pytest.raises(ManipulationError, match="is not trusted"):
        import_bundle(other, new)
    trust(other, "kitchen", PUBLIC)
    import_bundle(other, new)
    with pytest.raises(ManipulationError, match="older than the bundle"):
        import_bundle(other, old)


@pytest.mark.parametrize("at", ["2026-01-01T10:00:00", "9999-12-31T23:59:59+00:00", "noon", None])
def test_a_time_without_a_zone_or_in_the_future_is_refused(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path, at: str | None
) -> None:
    """A contributor whose bundle is of the year 9999 could not send another one."""
    path = tmp_path / "bundle"
    export_bundle(cups.connection, path, "kitchen", key=KEY)
    first, *lines = path.read_bytes().split(b"\n")[:-2]
    body = b"\n".join([json.dumps(json.loads(first) | {"at": at}).encode(), *lines]) + b"\n"
    signature = {"signature": KEY.sign(body).signature.hex()}
    path.write_bytes(body + json.dumps(signature).encode() + b"\n")
    trust(other, "kitchen", PUBLIC)
    before = rows(other)
    with pytest.raises(ManipulationError, match=r"no time with a zone|made in the future"):
        import_bundle(other, path)
    assert rows(other) == before


def test_a_suction_cup_comes_with_its_force(cups: Map, other: Any, tmp_path: Path) -> None:
    add_gripper(cups.connection, "lip", form="suction", opening=0.03, depth=0.06, force=60)
    add_actions(cups.connection, "cup1", "lip", [candidate(width=None)])
    export_bundle(cups.connection, tmp_path / "lip.bundle", "kitchen", key=KEY)
    trust(other, "kitchen", PUBLIC)
    import_bundle(other, tmp_path / "lip.bundle")
    query = "SELECT form, opening, depth, force FROM gripper WHERE form = 'suction'"
    assert other.execute(query).fetchall() == [("suction", 0.03, 0.06, 60)]


def test_a_cup_of_the_same_name_and_another_force_is_refused(
    cups: Map, other: Any, tmp_path: Path
) -> None:
    add_gripper(cups.connection, "lip", form="suction", opening=0.03, depth=0.06, force=60)
    add_actions(cups.connection, "cup1", "lip", [candidate(width=None)])
    export_bundle(cups.connection, tmp_path / "lip.bundle", "kitchen", key=KEY)
    add_gripper(other, "lip", form="suction", opening=0.03, depth=0.06, force=20)
    trust(other, "kitchen", PUBLIC)
    with pytest.raises(
        ManipulationError,
        match=r"lip is a suction cup of 0\.03 m and 60 N there and a suction .* and 20 N here",
    ):
        import_bundle(other, tmp_path / "lip.bundle")
    assert rows(other)["action"] == 0


def test_actions_of_a_cup_stay_with_its_lip(cups: Map) -> None:
    here = cups.connection
    add_gripper(here, "lip", form="suction", opening=0.03, depth=0.06, force=60)
    add_gripper(here, "lip", form="suction", opening=0.04, depth=0.06, force=60)  # nothing is lost
    add_actions(here, "cup1", "lip", [candidate(width=None)])
    for form, opening, force in (
        ("suction", 0.03, 60.0),
        ("suction", 0.04, 30.0),
        ("parallel", 0.04, None),
    ):
        with pytest.raises(ManipulationError, match=r"lip: 1 actions are stored .* another name"):
            add_gripper(here, "lip", form=form, opening=opening, depth=0.06, force=force)
    add_gripper(here, "lip", form="suction", opening=0.04, depth=0.07, force=60)
    query = "SELECT form, opening, depth, force FROM gripper WHERE form = 'suction'"
    assert here.execute(query).fetchall() == [("suction", 0.04, 0.07, 60)]


def test_only_cups_have_a_force(cups: Map) -> None:
    here = cups.connection
    with pytest.raises(ManipulationError, match="only suction cups have a force"):
        add_gripper(here, "jaws", form="parallel", opening=0.03, depth=0.06, force=60)
    with (
        pytest.raises(psycopg.errors.CheckViolation, match="gripper_force_is_that_of_suction"),
        here.transaction(),
    ):
        here.execute("UPDATE gripper SET force = 5 WHERE form = 'parallel'")


def test_a_gripper_of_the_same_name_and_another_opening_is_refused(
    cups: Map, taught: dict[str, int], other: Any, tmp_path: Path
) -> None:
    path = tmp_path / "cups.bundle"
    export_bundle(cups.connection, path, "kitchen", key=KEY)
    add_gripper(other, "two_fingers", form="parallel", opening=0.12, depth=0.05)
    trust(other, "kitchen", PUBLIC)
    with pytest.raises(ManipulationError, match=r"opens 0\.09 m there and .* opens 0\.12 m here"):
        import_bundle(other, path)
    assert rows(other)["action"] == 0


@pytest.mark.parametrize(
    ("name", "key", "level", "text"),
    [
        ("friend", "12", 1, "is not a public key"),
        ("friend", "zz" * 32, 1, "is not a public key"),
        ("friend", PUBLIC, 1.5, "trust is 1.5"),
        ("kitchen", "00" * 32, 1, "kitchen is a contributor with another key"),
        ("pantry", PUBLIC, 1, "this key is that of kitchen"),
        ("own", "00" * 32, 1, "own is a contributor with another key"),
    ],
)
def test_trust_is_given_to_a_key_and_a_name(
    other: Any, name: str, key: str, level: float, text: str
) -> None:
    trust(other, "kitchen", PUBLIC)
    with pytest.raises(ManipulationError, match=text):
        trust(other, name, key, level)


def test_the_private_key_is_readable_by_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "key"
    assert bytes(own_key(path)) == bytes(own_key(path))
    assert path.stat().st_mode & 0o077 == 0
    path.write_text("not a key")
    with pytest.raises(ManipulationError, match="is not a signing key"):
        own_key(path)
