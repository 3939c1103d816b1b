"""The state of a simulated world, in a file that outlives the processes that use it."""

from __future__ import annotations

import json
import os
import random
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from planner.mission.behaviours import Sighting
from planner.mission.failures import BROKEN, FailureRule
from planner.topology import Topology
from semmap.geometry.pose import Pose

_TABLES = """
CREATE TABLE robot (name TEXT PRIMARY KEY, place TEXT, pose TEXT);
CREATE TABLE thing (name TEXT PRIMARY KEY, place TEXT, holder TEXT, relation TEXT, pose TEXT);
CREATE TABLE door (name TEXT PRIMARY KEY, state TEXT, ajar INTEGER DEFAULT 0, elevator TEXT);
CREATE TABLE elevator (name TEXT PRIMARY KEY, at TEXT, occupant TEXT, broken INTEGER DEFAULT 0);
CREATE TABLE rule (id INTEGER PRIMARY KEY, what TEXT, times INTEGER, chance REAL);
CREATE TABLE event (id INTEGER PRIMARY KEY, robot TEXT, what TEXT, about TEXT);
CREATE TABLE draw (robot TEXT PRIMARY KEY, n INTEGER);
"""


class SimWorld:
    """A simulated world in a file that several processes may open; each change is atomic."""

    def __init__(self, path: Path) -> None:
        self._open(path)

    def _open(self, path: Path) -> None:
        self.path = path
        self._file = sqlite3.connect(path, timeout=30, isolation_level=None)
        self._file.row_factory = sqlite3.Row
        self._file.execute("PRAGMA synchronous = OFF")

    @classmethod
    def make(
        cls,
        path: Path,
        topology: Topology,
        objects: Iterable[tuple[str, str, Sighting]] = (),
        rules: Iterable[FailureRule] = (),
    ) -> SimWorld:
        """A new world: doors and elevators as in the map, objects by name, place and pose.

        Another process never sees an unfinished file. If another one makes the file at the same
        time, the first one stays.
        """
        draft = path.with_name(f"{path.name}.{os.getpid()}")
        with closing(cls._made(draft, topology, objects)):
            pass
        with suppress(FileExistsError):
            os.link(draft, path)
        draft.unlink()
        world = cls(path)
        world.add_rules(rules)
        return world

    @classmethod
    def _made(
        cls, path: Path, topology: Topology, objects: Iterable[tuple[str, str, Sighting]]
    ) -> SimWorld:
        path.unlink(missing_ok=True)
        world = cls(path)
        cabins = topology.elevators()
        with world.change() as file:
            for statement in _TABLES.split(";"):
                file.execute(statement)
            for door in topology.connectors.values():
                lift = next((cabins[p] for p in door.places if p in cabins), None)
                state = "closed" if lift else door.state
                file.execute("INSERT INTO door VALUES (?, ?, 0, ?)", (door.name, state, lift))
            for lift, inside in topology.cabins().items():
                file.execute("INSERT INTO elevator VALUES (?, ?, NULL, 0)", (lift, inside[0]))
            for name, place, seen in objects:
                world.put_object(name, place, seen)
        return world

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def move(self, path: Path) -> None:
        """Give the file another name; no other process may have it open."""
        self.close()
        self._open(self.path.replace(path))

    @contextmanager
    def change(self) -> Iterator[sqlite3.Connection]:
        """A transaction of several changes."""
        if self._file.in_transaction:
            yield self._file
            return
        self._file.execute("BEGIN IMMEDIATE")
        try:
            yield self._file
        except BaseException:
            self._file.execute("ROLLBACK")
            raise
        self._file.execute("COMMIT")

    def log(self, robot: str, what: str, about: str) -> None:
        """Store an event."""
        statement = "INSERT INTO event (robot, what, about) VALUES (?, ?, ?)"
        self._file.execute(statement, (robot, what, about))

    def events(self) -> list[tuple[str, str, str]]:
        """All events in order: robot, kind, and entity."""
        rows = self._file.execute("SELECT robot, what, about FROM event ORDER BY id")
        return [(r["robot"], r["what"], r["about"]) for r in rows]

    def robot(self, name: str) -> tuple[str, Pose]:
        """Where a robot is; LookupError without it."""
        row = self._file.execute("SELECT * FROM robot WHERE name = ?", (name,)).fetchone()
        if row is None:
            raise LookupError(f"there is no robot {name} in the simulated world: put one there")
        return str(row["place"]), _pose(row["pose"])

    def has_robot(self, name: str) -> bool:
        """Whether there is a robot of that name."""
        found = self._file.execute("SELECT 1 FROM robot WHERE name = ?", (name,)).fetchone()
        return found is not None

    def put_robot(self, name: str, place: str, pose: Pose) -> None:
        """Set the place and pose of a robot."""
        self._file.execute("REPLACE INTO robot VALUES (?, ?, ?)", (name, place, _text(pose)))

    def put_object(self, name: str, place: str, seen: Sighting) -> None:
        """Set the place and pose of an object; in the frame of the robot that holds it, if any."""
        self._file.execute(
            "REPLACE INTO thing VALUES (?, ?, ?, ?, ?)",
            (name, place, seen.holder, seen.relation, _text(seen.pose)),
        )

    def objects(self, place: str | None = None) -> dict[str, tuple[str, Sighting]]:
        """The objects of a place, or all, each with its place and pose."""
        rows = self._file.execute(
            "SELECT * FROM thing WHERE ? IS NULL OR place = ? ORDER BY name", (place, place)
        )
        return {
            r["name"]: (r["place"], Sighting(r["holder"], r["relation"], _pose(r["pose"])))
            for r in rows
        }

    def carry(self, robot: str, place: str) -> None:
        """Move the objects that a robot holds to a place."""
        self._file.execute("UPDATE thing SET place = ? WHERE holder = ?", (place, robot))

    def door(self, name: str) -> str:
        """Open, closed, locked, or ajar: opened by a robot, to be shut behind it."""
        row = self._file.execute("SELECT * FROM door WHERE name = ?", (name,)).fetchone()
        if row is None:
            raise LookupError(f"there is no door {name} in the simulated world")
        return "ajar" if row["ajar"] and row["state"] == "closed" else str(row["state"])

    def set_door(self, name: str, state: str) -> None:
        """Set the state of a door: open, closed, locked or ajar."""
        change, values = ("ajar = 1", ()) if state == "ajar" else ("state = ?, ajar = 0", (state,))
        known = self._file.execute(f"UPDATE door SET {change} WHERE name = ?", (*values, name))
        if not known.rowcount:
            raise LookupError(f"there is no door {name} in the simulated world")

    def elevator(self, name: str) -> tuple[str, str | None]:
        """The cabin (a place) at which an elevator stands, and the robot in it."""
        row = self._file.execute("SELECT * FROM elevator WHERE name = ?", (name,)).fetchone()
        return str(row["at"]), row["occupant"]

    def set_elevator(self, name: str, at: str, occupant: str | None) -> None:
        """Set where an elevator stands; all its other doors close."""
        self._file.execute("UPDATE door SET ajar = 0 WHERE elevator = ?", (name,))
        self._file.execute(
            "UPDATE elevator SET at = ?, occupant = ? WHERE name = ?", (at, occupant, name)
        )

    def is_broken(self, elevator: str) -> bool:
        """Whether an elevator neither comes nor leaves."""
        row = self._file.execute("SELECT * FROM elevator WHERE name = ?", (elevator,)).fetchone()
        return bool(row["broken"])

    def add_rules(self, rules: Iterable[FailureRule]) -> None:
        """Add future failures; states of doors and elevators change at once."""
        with self.change() as file:
            for rule in rules:
                if rule.state == BROKEN:
                    file.execute("UPDATE elevator SET broken = 1 WHERE name = ?", (rule.what,))
                elif rule.state is not None:
                    self.set_door(rule.what, rule.state)
                else:
                    file.execute(
                        "INSERT INTO rule (what, times, chance) VALUES (?, ?, ?)",
                        (rule.what, rule.times, rule.chance),
                    )

    def fails(self, robot: str, what: str, seed: int) -> bool:
        """Whether a rule lets a behaviour fail this time; reproducible for a seed."""
        failed = False
        for rule in self._file.execute("SELECT * FROM rule WHERE what = ?", (what,)).fetchall():
            if rule["times"]:
                self._file.execute("UPDATE rule SET times = times - 1 WHERE id = ?", (rule["id"],))
                return True
            if rule["chance"]:
                self._file.execute("INSERT OR IGNORE INTO draw VALUES (?, 0)", (robot,))
                self._file.execute("UPDATE draw SET n = n + 1 WHERE robot = ?", (robot,))
                n = self._file.execute("SELECT n FROM draw WHERE robot = ?", (robot,)).fetchone()
                drawn = random.Random(f"{seed} {robot} {n[0]}").random()
                failed = failed or drawn < rule["chance"]
        return failed


def _text(pose: Pose) -> str:
    return json.dumps(pose)


def _pose(text: Any) -> Pose:
    return Pose.of_json(json.loads(text))
