"""Bundles: manipulation knowledge as a signed file that other databases import as a whole.

The first line is a header, each further line a gripper, an object model or an action, all in JSON;
the last line has the signature of all bytes before it (Ed25519). A bundle has everything that its
contributor knows: a newer one replaces the outcomes of an older one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any
from uuid import UUID

import psycopg
from psycopg.rows import dict_row

from semmap.belief.store.beliefs import Session
from semmap.limits import BUNDLE_AHEAD, TEXT_BYTES
from semmap.manipulation.action_record import ActionRecord, action_key, pose_of
from semmap.manipulation.bundle_entry import check_entry
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.signing import is_signed, own_key
from semmap.manipulation.store.actions import insert_actions
from semmap.manipulation.store.database_answers import number, refusals
from semmap.manipulation.store.devices import add_gripper, gripper_words, is_same_gripper
from semmap.whole_file import write_whole

FORMAT = "semmap manipulation knowledge"

VERSION = 1
"""Of the format; other versions are refused."""

RESERVED = ("own", "simulation", "assumed")

POSES = ("pose", "pre_pose", "post_pose")
COLUMNS = ("motion", "approach", "family", "width", "posture", "pre_posture", "quality", "shift")

# -- export ---------------------------------------------------------------------------------------

GRIPPERS = """
SELECT d.name, g.form, g.opening, g.depth, g.force, d.urdf, d.joints FROM gripper g
JOIN device d ON d.id = g.device_id WHERE d.id = ANY (%s) ORDER BY d.name
"""

OBJECTS = """
SELECT o.key, o.name, o.type, ARRAY(SELECT DISTINCT f FROM unnest(o.functions ||
       functions_of(o.type)) f ORDER BY 1) AS functions, o.shape, o.size, o.shape_pose, o.inliers,
       ARRAY(SELECT digest FROM object_mesh WHERE object_id = o.id ORDER BY 1) AS meshes
FROM object_model o WHERE o.id = ANY (%s) ORDER BY o.key
"""

ACTIONS = """
SELECT a.id, a.key, a.kind, a.object_id, a.gripper_id, o.key AS object, d.name AS gripper,
       a.pose, a.pre_pose, a.post_pose, a.motion, a.approach, a.family, a.width, a.posture,
       a.pre_posture, a.quality, a.shift, coalesce(e.attempts, 0) AS attempts,
       coalesce(e.successes, 0) AS successes, r.key AS replaced_by,
       ARRAY(SELECT p.key FROM action_step s JOIN action p ON p.id = s.step_id
             WHERE s.whole_id = a.id ORDER BY s.number) AS steps
FROM action a JOIN object_model o ON o.id = a.object_id JOIN device d ON d.id = a.gripper_id
LEFT JOIN (SELECT action_id, sum(attempts) AS attempts, sum(successes) AS successes
           FROM experience WHERE contributor_id = ANY (%(counted)s) GROUP BY 1) e
  ON e.action_id = a.id
LEFT JOIN action r ON r.id = a.replaced_by
WHERE a.contributor_id IN (1, 2) OR e.attempts > 0
ORDER BY a.kind = 'put', a.id
"""


def export_bundle(
    session: Session, path: Path, name: str, *, simulated: bool = False, key: Any = None
) -> dict[str, int]:
    """Write the knowledge of this database to a signed bundle; return how much it has.

    Actions that were imported and never tried here are left out: their contributors share them.
    ManipulationError where the name is not one for a contributor, or the file cannot be written.
    """
    if name in RESERVED or not name.strip():
        raise ManipulationError(f"{name!r} is not a name for a contributor: choose another one")
    signer = own_key() if key is None else key
    counted = [1, 2] if simulated else [1]
    with session.transaction(), session.cursor(row_factory=dict_row) as cursor:
        actions = cursor.execute(ACTIONS, {"counted": counted}).fetchall()
        chosen = {row["key"] for row in actions}
        grippers = cursor.execute(GRIPPERS, ([*{a["gripper_id"] for a in actions}],)).fetchall()
        objects = cursor.execute(OBJECTS, ([*{a["object_id"] for a in actions}],)).fetchall()
    lines: list[dict[str, Any]] = [
        {
            "format": FORMAT,
            "version": VERSION,
            "contributor": name,
            "key": bytes(signer.verify_key).hex(),
            "at": datetime.now(UTC).isoformat(),
        }
    ]
    lines += [{"gripper": row} for row in grippers]
    lines += [{"object": row} for row in objects]
    for row in actions:
        for internal in ("id", "object_id", "gripper_id"):
            del row[internal]
        if row["replaced_by"] not in chosen:
            row["replaced_by"] = None
        lines.append({"action": row})
    body = "".join(json.dumps(line, default=str) + "\n" for line in lines).encode()
    signature = json.dumps({"signature": signer.sign(body).signature.hex()}).encode() + b"\n"
    try:
        write_whole(path, body + signature)
    except OSError as error:
        raise ManipulationError(
            f"{path}: cannot be written ({error.strerror}): check the path"
        ) from error
    return {"grippers": len(grippers), "objects": len(objects), "actions": len(actions)}


# -- import ---------------------------------------------------------------------------------------


def trust(session: Session, name: str, key: str, level: float = 1.0) -> None:
    """Trust the bundles of a contributor, by its key of 64 hexadecimal digits.

    `level` is how much its outcomes count, 0 to 1; with 0 its bundles are refused.
    """
    try:
        public = bytes.fromhex(key)
    except ValueError:
        public = b""
    if len(public) != 32:
        raise ManipulationError(
            f"{key!r} is not a public key: give the 64 hexadecimal digits that "
            "`semmap manipulation key` prints"
        )
    if not (math.isfinite(level) and 0 <= level <= 1):
        raise ManipulationError(f"trust is {level}: give a share, 0 to 1")
    with refusals(), session.transaction():
        for known, of in session.execute(
            "SELECT name, key FROM contributor WHERE name = %s OR key = %s", (name, public)
        ).fetchall():
            if (known, of) != (name, public):
                raise ManipulationError(
                    f"{known} is a contributor with another key: choose another name"
                    if known == name
                    else f"this key is that of {known}: use that name"
                )
        session.execute(
            "INSERT INTO contributor (name, key, trust) VALUES (%s, %s, %s) "
            "ON CONFLICT (name) DO UPDATE SET trust = excluded.trust",
            (name, public, level),
        )


def import_bundle(session: Session, path: Path) -> dict[str, int]:
    """Store the knowledge of a bundle, if somebody who is trusted signed it; return what was new.

    Outcomes replace those of former bundles of the same contributor; own knowledge stays.
    ManipulationError where it cannot be trusted or used; nothing is stored.
    """
    error = partial(_error, path)
    lines, header = _checked_lines(session, path, error)
    with refusals(), session.transaction():
        return _Import(session, error, header).store(lines)


def _error(path: Path, problem: str, fix: str) -> ManipulationError:
    return ManipulationError(f"{path}: {problem}: {fix}. Nothing was stored")


Refuse = Callable[[str, str], ManipulationError]


def _checked_lines(
    session: psycopg.Connection[Any], path: Path, error: Refuse
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The lines of a bundle after the header, and the header, if it can be trusted."""
    try:
        TEXT_BYTES.check(path.stat().st_size, lambda p, f: error(p, f), "Split it.")
        content = path.read_bytes()
    except OSError as problem:
        raise error(f"cannot be read ({problem.strerror})", "check the path") from problem
    body, _, last = content.rstrip(b"\n").rpartition(b"\n")
    header = _json(content.split(b"\n", 1)[0])
    if header.get("format") != FORMAT:
        raise error("is not a bundle of manipulation knowledge", "name a file of `export`")
    if header.get("version") != VERSION:
        raise error(
            f"is of version {header.get('version')!r}, this semmap reads version {VERSION}",
            "use the same version of semmap on both sides",
        )
    key, signature = _digits(header.get("key")), _digits(_json(last).get("signature"))
    row = session.execute("SELECT name, trust, latest FROM contributor WHERE key = %s", (key,))
    known = row.fetchone()
    if known is None:
        raise error(
            f"is signed by {header.get('contributor')!r}, whom nobody trusts here",
            "semmap manipulation trust NAME KEY, if you know that the key is theirs",
        )
    if known[1] == 0:
        raise error(f"is of {known[0]}, who is not trusted", "raise the trust to import it")
    if not is_signed(body + b"\n", signature, key):
        raise error("was changed after it was signed, or is truncated", "get it again")
    lines = [_json(line) for line in body.split(b"\n")[1:]]
    try:
        at = datetime.fromisoformat(str(header["at"]))
        ahead = at - datetime.now(UTC)
    except (KeyError, ValueError, TypeError) as problem:  # a time without a zone is of another type
        raise error("its header has no time with a zone", "export it again") from problem
    if BUNDLE_AHEAD.exceeded_by(ahead.total_seconds()):  # later ones must not be older
        raise error(f"was made in the future, at {at}", "set the clock of the machine it is from")
    if known[2] is not None and at < known[2]:
        raise error(
            f"is older than the bundle of {known[0]} that was imported before", "get the newest one"
        )
    return lines, {"contributor": known[0], "at": at}


def _digits(given: Any) -> bytes:
    """The bytes of hexadecimal digits; none where they are not digits."""
    try:
        return bytes.fromhex(str(given))
    except ValueError:
        return b""


def _json(line: bytes) -> dict[str, Any]:
    """A line as a dict; empty if it is not an object in JSON."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


REPLACE = """
UPDATE action old SET replaced_by = new.id FROM action new
WHERE old.key = %(old)s AND new.key = %(new)s AND old.replaced_by IS NULL
  AND (old.kind, old.object_id, old.gripper_id) = (new.kind, new.object_id, new.gripper_id)
  AND NOT EXISTS (SELECT FROM experience e WHERE e.action_id = old.id AND e.contributor_id = 1
                  AND e.successes > 0)
  AND old.id NOT IN (WITH RECURSIVE later (id) AS (
      SELECT new.id UNION SELECT a.replaced_by FROM later l JOIN action a ON a.id = l.id
      WHERE a.replaced_by IS NOT NULL) SELECT id FROM later)
"""
"""An action that failed for the contributor is replaced here, too, unless it succeeded here."""


@dataclass
class _Import:
    """The ids of grippers, objects and actions of a bundle, while it is stored."""

    session: psycopg.Connection[Any]
    error: Refuse
    header: Mapping[str, Any]

    def store(self, lines: list[dict[str, Any]]) -> dict[str, int]:
        self.contributor = number(
            self.session.execute(
                "UPDATE contributor SET latest = %s WHERE name = %s RETURNING id",
                (self.header["at"], self.header["contributor"]),
            )
        )
        self.grippers: dict[str, int] = {}
        self.objects: dict[str, int] = {}
        self.keys: set[UUID] = set()
        counts = {"grippers": 0, "objects": 0, "actions": 0, "outcomes": 0}
        actions = []
        for at, line in enumerate(lines, 2):
            kind, content = next(iter(line.items()), ("", None))
            if len(line) != 1 or not isinstance(content, dict):
                raise self.error(f"line {at} is not an entry", "export it again")
            try:
                check_entry(kind, content)
                if kind == "gripper":
                    counts["grippers"] += self._gripper(content)
                elif kind == "object":
                    counts["objects"] += self._object(content)
                else:
                    actions.append(self._action(content, f"line {at}"))
            except (TypeError, ValueError) as problem:
                raise self.error(f"line {at}: {problem}", "export it again") from problem
        counts["actions"] = self._store_actions(actions)
        counts["outcomes"] = self._count([content for _, content in actions])
        return counts

    def _gripper(self, given: dict[str, Any]) -> bool:
        name = given["name"]
        own = self.session.execute(
            "SELECT d.id, g.form, g.opening, g.force FROM device d "
            "JOIN gripper g ON g.device_id = d.id WHERE d.name = %s",
            (name,),
        ).fetchone()
        if own is not None:
            there = given["form"], given["opening"], given.get("force")
            if not is_same_gripper(own[1:], there):
                raise ManipulationError(
                    f"gripper {name} is {gripper_words(*there)} there and "
                    f"{gripper_words(*own[1:])} here: one of them needs another name"
                )
            self.grippers[name] = int(own[0])
            return False
        self.grippers[name] = add_gripper(
            self.session,
            name,
            form=given["form"],
            opening=given["opening"],
            depth=given["depth"],
            force=given.get("force"),
            urdf=given.get("urdf"),
            joints=given.get("joints") or {},
            preferred=False,
        )
        return True

    def _object(self, given: dict[str, Any]) -> bool:
        pose = given.get("shape_pose")
        row = self.session.execute(
            "INSERT INTO object_model (key, name, type, functions, shape, size, shape_pose, "
            "inliers, contributor_id) VALUES (%s, %s, (SELECT name FROM semantic_type "
            "WHERE name = %s), %s, %s, %s::float8[], %s::float8[], %s, %s) "
            "ON CONFLICT (key) DO NOTHING RETURNING id",
            (
                given["key"],
                given.get("name"),
                given.get("type"),
                given.get("functions") or [],
                given.get("shape"),
                None if given.get("size") is None else [float(v) for v in given["size"]],
                None if pose is None else pose_of(pose, "shape_pose").row,
                given.get("inliers"),
                self.contributor,
            ),
        ).fetchone()
        found = self.session.execute("SELECT id FROM object_model WHERE key = %s", (given["key"],))
        self.objects[given["key"]] = number(found)
        for digest in given.get("meshes") or ():
            self.session.execute(
                "INSERT INTO object_mesh (digest, object_id) VALUES (%s, %s) "
                "ON CONFLICT DO NOTHING",
                (digest, self.objects[given["key"]]),
            )
        return row is not None

    def _action(
        self, given: dict[str, Any], where: str
    ) -> tuple[ActionRecord | None, dict[str, Any]]:
        for table, key in ((self.objects, "object"), (self.grippers, "gripper")):
            if given[key] not in table:
                raise ManipulationError(f"{key} {given[key]} is not in the bundle before it")
        attempts, successes = given["attempts"], given["successes"]
        if successes > attempts:
            raise ManipulationError(f"{successes!r} of {attempts!r} attempts is not an outcome")
        given["key"] = UUID(given["key"])
        if given["key"] in self.keys:
            raise ManipulationError(f"the action {given['key']} occurs twice")
        self.keys.add(given["key"])
        if given["kind"] == "put":
            return None, given
        values: dict[str, Any] = {column: given.get(column) for column in COLUMNS}
        for column in ("posture", "pre_posture"):
            values[column] = values[column] or {}
        for column in POSES:
            pose = given.get(column)
            values[column] = None if pose is None else pose_of(pose, f"{where}: {column}")
        record = ActionRecord(kind=given["kind"], **values).checked(where)
        if action_key(record, given["object"], given["gripper"]) != given["key"]:
            raise ManipulationError("its key does not belong to its content")
        return record, given

    def _store_actions(self, actions: list[tuple[ActionRecord | None, dict[str, Any]]]) -> int:
        count = number(self.session.execute("SELECT count(*) FROM action"))
        insert_actions(
            self.session,
            [
                (
                    given["key"],
                    record,
                    self.objects[given["object"]],
                    self.grippers[given["gripper"]],
                )
                for record, given in actions
                if record is not None
            ],
            str(self.header["contributor"]),
        )
        for record, given in actions:
            if record is None:
                self._put(given)
        return number(self.session.execute("SELECT count(*) FROM action")) - count

    def _put(self, given: dict[str, Any]) -> None:
        row = self.session.execute(
            "INSERT INTO action (key, kind, object_id, gripper_id, quality, contributor_id) "
            "VALUES (%s, 'put', %s, %s, %s, %s) ON CONFLICT (key) DO NOTHING RETURNING id",
            (
                given["key"],
                self.objects[given["object"]],
                self.grippers[given["gripper"]],
                given["quality"],
                self.contributor,
            ),
        ).fetchone()
        if row is not None:
            self.session.execute(
                "INSERT INTO action_step (whole_id, number, step_id) "
                "SELECT %s, s.number, a.id FROM unnest(%s::uuid[]) WITH ORDINALITY s (key, number) "
                "JOIN action a ON a.key = s.key",
                (row[0], [UUID(step) for step in given["steps"]]),
            )

    def _count(self, actions: list[dict[str, Any]]) -> int:
        """Replace the outcomes of the contributor, and take over its replacements."""
        self.session.execute(
            "DELETE FROM experience WHERE contributor_id = %s", (self.contributor,)
        )
        tried = [a for a in actions if a["attempts"]]
        self.session.execute(
            "INSERT INTO experience (action_id, contributor_id, attempts, successes) "
            "SELECT a.id, %s, t.attempts, t.successes FROM unnest(%s::uuid[], %s::int[], "
            "%s::int[]) t (key, attempts, successes) JOIN action a ON a.key = t.key",
            (
                self.contributor,
                [a["key"] for a in tried],
                [a["attempts"] for a in tried],
                [a["successes"] for a in tried],
            ),
        )
        for given in actions:
            if given.get("replaced_by"):
                self.session.execute(
                    REPLACE, {"old": given["key"], "new": UUID(str(given["replaced_by"]))}
                )
        return sum(a["attempts"] for a in tried)
