"""Changes of a map as events: one for each change of an entity by a transaction."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import chain, groupby
from typing import Any

from semmap.error import UnknownNameError
from semmap.geometry.pose import Pose
from semmap.query.entity_query import SETTLE, check_cursor
from semmap.query.snapshot import Snapshot

Names = defaultdict[int | None, tuple[str | None, str | None]]
"""Of entities by their ids, with their kinds; None of no entity."""

MOVED, CARRIED = "moved itself", "carried by its holder"
STATED, DERIVED = "given another holder", "holder derived again"
REASONS = (MOVED, CARRIED, STATED, DERIVED)
"""Of a move, the first that applies: a move from which another holder follows is a move."""

CHANGES = {
    "name": "renamed",
    "type": "retyped",
    "label": "labelled",
    "properties": "properties set",
    "front": "turned its front",
    "state": "state set",
}
"""The values that the log keeps, and the reason of a change of each."""


@dataclass(frozen=True)
class MapEvent:
    """The changes of one entity by one transaction.

    Attributes
    ----------
    what : ``added``, ``moved``, ``changed``, ``state`` (of a door), ``reshaped``, ``removed``,
        ``linked``, ``belief``, ``statement``; without an entity: ``field``, ``inferred``
    name, kind, id : of the entity, its present name or its last one; None without an entity
    at : when it was written; an earlier event may be committed later
    cursor : goes on after this event. Events of one transaction are read again as a whole, unless
        the cursor is that of its last one
    from_pose, to_pose : in the map's frame, of an entity that was added, moved or removed
    from_holder, to_holder : their names; None for the map itself
    reason : of a move or a change, such as ``carried by its holder`` or ``retyped``
    values : former and new value of ``name``, ``type``, ``label``, ``properties``, ``front`` or
        ``state``, where it changed
    """

    what: str
    name: str | None
    kind: str | None
    id: int | None
    at: datetime
    cursor: str
    from_pose: Pose | None = None
    to_pose: Pose | None = None
    from_holder: str | None = None
    to_holder: str | None = None
    reason: str | None = None
    values: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)


@dataclass
class _Move:
    """The net move of an entity by a transaction; poses are seven numbers, holders are ids."""

    poses: tuple[list[float] | None, list[float] | None]
    holders: tuple[int | None, int | None]
    reason: str

    def then(self, later: _Move) -> _Move:
        """This move and a later one as one."""
        holders = self.holders[0], later.holders[1]
        reason = min(self.reason, later.reason, key=REASONS.index)
        if reason == STATED and holders[0] == holders[1]:
            reason = DERIVED
        return _Move((self.poses[0], later.poses[1]), holders, reason)


@dataclass
class _Draft:
    """The changes of one entity by one transaction, in the order in which they were written."""

    id: int | None
    whats: dict[str, datetime] = field(default_factory=dict)
    move: _Move | None = None
    values: dict[str, tuple[Any, Any]] = field(default_factory=dict)


def events_since(seen: Snapshot, since: str | None) -> tuple[str, list[MapEvent]]:
    """The events of a map after a cursor (all that are kept where None), and the next cursor.

    The events of a transaction follow each other; transactions that change the same entity are in
    the order of their commits. Raises ValueError: this is not a cursor; UnknownNameError: the map
    was dropped or renamed.
    """
    check_cursor(since)
    with seen.session.transaction():
        # One statement, so that cursor and rows are of one snapshot.
        rows = seen.session.execute(
            "SELECT change_cursor(), m.id, c.id, x.xid, c.at, c.what, c.entities, c.facts "
            "FROM (SELECT max(id) AS id FROM map WHERE name = %s) m "
            "LEFT JOIN (changes_since(%s) c JOIN change x ON x.id = c.id) ON c.map_id = m.id "
            "ORDER BY max(c.id) OVER (PARTITION BY x.xid), c.id",
            (seen.name, since),
        ).fetchall()
        seen.session.execute(SETTLE)
        cursor = str(rows[0][0])
        if rows[0][1] is None:
            raise UnknownNameError(f"the map {seen.name} was dropped or renamed")
        written = [row[2:] for row in rows if row[2] is not None]
        by_transaction = {
            xid: _drafted(of_one) for xid, of_one in groupby(written, key=lambda row: row[1])
        }
        names = _names(seen, chain.from_iterable(by_transaction.values()))
    left = set(by_transaction)
    events: list[MapEvent] = []
    for xid, drafts in by_transaction.items():
        before = _without(cursor, left)
        left.discard(xid)
        made = [event for draft in drafts for event in _events(draft, names, before)]
        if made:
            made[-1] = replace(made[-1], cursor=_without(cursor, left))
        events += made
    return cursor, events


def _without(cursor: str, left: Iterable[int]) -> str:
    """The cursor that has not seen some transactions which `cursor` has seen."""
    low, high, running = cursor.split(":")
    unseen = {int(xid) for xid in running.split(",") if xid} | set(left)
    return f"{min(int(low), *unseen, int(high))}:{high}:{','.join(map(str, sorted(unseen)))}"


def _drafted(rows: Iterable[tuple[Any, ...]]) -> list[_Draft]:
    """The changes of each entity by one transaction."""
    drafts: dict[int | None, _Draft] = {}
    for _, _, at, what, entities, facts in rows:
        facts = facts if isinstance(facts, dict) else {}
        for number in entities or [None]:
            draft = drafts.setdefault(number, _Draft(number))
            values = facts.get("values", {}).get(str(number), {})
            draft.whats["state" if "state" in values else what] = at
            for key, (old, new) in values.items():
                draft.values[key] = (draft.values.get(key, (old,))[0], new)
        for number, old, new, holder in facts.get("poses") or ():
            move = _move(old, new, holder, facts.get("placed", {}).get(str(number)), facts)
            draft = drafts.setdefault(number, _Draft(number))
            draft.move = move if draft.move is None else draft.move.then(move)
    return list(drafts.values())


def _move(
    old: list[float] | None,
    new: list[float] | None,
    holder: int | None,
    placed: list[int | None] | None,
    facts: Mapping[str, Any],
) -> _Move:
    """One move as the log has it; `placed`: former holder and holder, where it was not carried."""
    if placed is None:
        holders = (None if old is None else holder, None if new is None else holder)
        return _Move((old, new), holders, MOVED if old is None or new is None else CARRIED)
    reason = DERIVED if facts.get("why") == "derived" else MOVED
    if reason == MOVED and placed[0] != placed[1] and old is not None and new is not None:
        stays = all(abs(a - b) < 1e-9 for a, b in zip(old, new, strict=True))
        reason = STATED if stays else MOVED
    return _Move((old, new), (placed[0], placed[1]), reason)


def _events(draft: _Draft, names: Names, cursor: str) -> Iterator[MapEvent]:
    """The events of one entity: what is added or removed does not move or change besides.

    That the belief about it changed is an event where nothing else did, from which that follows.
    """
    whats = draft.whats
    alone = "removed" if "removed" in whats else "added" if "added" in whats else None
    if {"added", "removed"} <= whats.keys():
        return
    name, kind = names[draft.id]
    for what, at in whats.items():
        if alone and what in ("moved", "changed", "state", "reshaped", "added") and what != alone:
            continue
        if what == "belief" and len(whats) > 1:
            continue
        given: dict[str, Any] = {}
        if what in ("moved", "added", "removed") and draft.move is not None:
            former, present = (None if p is None else Pose(*p) for p in draft.move.poses)
            given = {
                "from_pose": former,
                "to_pose": present,
                "from_holder": names[draft.move.holders[0]][0],
                "to_holder": names[draft.move.holders[1]][0],
                "reason": draft.move.reason if what == "moved" else None,
            }
        elif what in ("changed", "state"):
            kept = {k: v for k, v in draft.values.items() if (k == "state") == (what == "state")}
            given = {"values": kept, "reason": ", ".join(CHANGES[k] for k in kept) or None}
        yield MapEvent(what, name, kind, draft.id, at, cursor, **given)


def _names(seen: Snapshot, drafts: Iterable[_Draft]) -> Names:
    """Names and kinds of the entities and holders; of those that are gone, the last ones."""
    wanted: set[int | None] = set()
    for draft in drafts:
        wanted |= {draft.id, *(draft.move.holders if draft.move else ())}
    rows = seen.session.execute(
        "SELECT h.entity_id, h.name, h.kind FROM entity_history h "
        "WHERE h.entity_id = ANY (%(ids)s) AND h.ended "
        "UNION ALL SELECT id, name, kind FROM entity WHERE id = ANY (%(ids)s)",
        {"ids": [number for number in wanted if number is not None]},
    ).fetchall()
    found: Names = defaultdict(lambda: (None, None))
    return found | {number: (name, kind) for number, name, kind in rows}
