"""Relations between entities as these move: in, on, near, touching, and what an agent sees.

The SQL functions `is_on`, `is_in`, ... compute them from surfaces, this module from voxels. Source:
"VDB-based Spatially Grounded Semantics for Interactive Robots", section VI (future work).
"""

from __future__ import annotations

import math
import threading
from collections import defaultdict
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from semmap.fields.regions.region_map import NamedRegionMap, Neighbour, RegionMap
from semmap.fields.relations.facts import RelationEvent, RelationFact
from semmap.fields.relations.rules import RULES, Kind, PairGeometry, RelationRule

_APART = Neighbour(0, math.inf)


class RelationTracker:
    """The relations that are true between the entities of a region map.

    A symmetric relation, `touching` or `near`, is two facts. Safe for several threads. `views`,
    `spaces` and `names` are read at each update: pass it the entities that they concern.

    Parameters
    ----------
    views : the agent of each entity that is a field of view; no agent sees itself
    spaces : the entities that are parts of space: rooms, zones, personal spaces
    parts : the entities that are parts of the building
    rooms : the spaces that are rooms: a body is in one of them, the one with most of it, if at
        least half of it is in rooms
    stated_rooms : the rooms in which something else states a body to be, such as the inventory of
        the map; None where voxels decide. Rooms that share a voxel are not told apart by voxels
    names : of entities in facts; the entity itself where it has none. A name is read when a fact
        begins, since a removed entity may have lost its name when the fact ends
    rules : at most one rule for each name and pair of kinds

    Examples
    --------
    >>> from semmap.fields import Box, RegionMap
    >>> regions = RegionMap(0.1)
    >>> regions.insert("table", Box((0, 0, 0.4), (1, 1, 0.8)))
    >>> regions.insert("mug", Box((0, 0, 0.85), (0.1, 0.1, 0.1)))
    >>> tracker = RelationTracker(regions)
    >>> [str(event) for event in tracker.update(["table", "mug"]) if event.relation == "on"]
    ['mug on table begins']
    """

    def __init__(
        self,
        regions: RegionMap,
        *,
        views: Mapping[Any, Hashable] | None = None,
        spaces: Container[Any] = (),
        parts: Container[Any] = (),
        rooms: Container[Any] = (),
        stated_rooms: Callable[[Any], Sequence[Hashable] | None] = lambda body: None,
        names: Mapping[Any, Hashable] | None = None,
        rules: Iterable[RelationRule] = RULES,
    ) -> None:
        self.regions = regions
        self.rules = tuple(rules)
        self._views: Mapping[Any, Hashable] = {} if views is None else views
        self._spaces, self._parts, self._rooms = spaces, parts, rooms
        self._stated_rooms = stated_rooms
        self._names: Mapping[Any, Hashable] = {} if names is None else names
        self._rank = {rule.name: i for i, rule in enumerate(self.rules)}
        self._between: dict[tuple[Kind, Kind], list[RelationRule]] = defaultdict(list)
        for rule in self.rules:
            for kinds in rule.between:
                if rule.name in (each.name for each in self._between[kinds]):
                    raise ValueError(
                        f"{rule.name} has two rules from {kinds[0]} to {kinds[1]}: give one rule"
                    )
                self._between[kinds].append(rule)
        self._reach = max((rule.reach(regions.voxel_size) for rule in self.rules), default=0.0)
        # By entities of the map. An agent may have several views: facts are counted.
        self._active: dict[tuple[Hashable, Hashable], dict[str, RelationFact]] = {}
        self._partners: dict[Hashable, set[Hashable]] = defaultdict(set)
        self._count: dict[RelationFact, int] = defaultdict(int)
        self._since: dict[RelationFact, datetime] = {}
        self._last: datetime | None = None
        self._lock = threading.RLock()

    @classmethod
    def of(cls, named: NamedRegionMap) -> RelationTracker:
        """Return the tracker of a region map, of names and roles as these change."""
        names: Mapping[Any, Any] = named.names
        return cls(
            named.regions,
            names=names,
            views=named.views,
            spaces=named.spaces,
            parts=named.parts,
            rooms=named.rooms,
            stated_rooms=named.stated_rooms,
        )

    def update(
        self, changed: Iterable[Hashable], time: datetime | None = None
    ) -> list[RelationEvent]:
        """Update the relations of entities that were inserted, moved or removed; return the events.

        Only pairs with one of them are compared. A fact has at most one event; ends come first.
        `time` is aware, now if not given. Raises ValueError: it has no zone, or is before the last
        update.
        """
        now = datetime.now(UTC) if time is None else time
        if now.tzinfo is None:
            raise ValueError(f"{now} has no time zone: give an aware datetime, such as one of UTC")
        with self._lock:
            if self._last is not None and now < self._last:
                if time is not None:
                    raise ValueError(f"{now} is before {self._last}, the last update: give later")
                now = self._last  # the clock was set back
            self._last = now
            former: dict[RelationFact, bool] = {}
            done: set[Hashable] = set()
            for entity in dict.fromkeys(self._with_bodies(changed)):
                reach = None if entity in self._views else self._reach
                around = self.regions.neighbours(entity, reach)
                done.add(entity)
                others = around.keys() | self._partners.get(entity, set())
                for other in others.union(self._stated_rooms(entity) or ()) - done:
                    neighbour = around.get(other, _APART)
                    self._compare(entity, other, neighbour, former)
                    self._compare(other, entity, neighbour, former)
            events = [
                RelationEvent(*fact, began=not before, time=now)
                for fact, before in former.items()
                if before != (fact in self._count)
            ]
            for event in events:
                if event.began:
                    self._since[event.fact] = now
                else:
                    del self._since[event.fact]
        return sorted(events, key=self._order)

    def holding(self, relation: str | None = None) -> dict[RelationFact, datetime]:
        """Return the facts that are true now, of one relation if given, and since when."""
        with self._lock:
            return {
                fact: since
                for fact, since in self._since.items()
                if relation in (None, fact.relation)
            }

    def _compare(
        self, a: Hashable, b: Hashable, neighbour: Neighbour, former: dict[RelationFact, bool]
    ) -> None:
        """Update the facts of a about b; `former` records which were true before."""
        before = self._active.get((a, b), {})
        after: dict[str, RelationFact] = {}
        agent = self._views.get(a, a)
        if agent not in (b, self._names.get(b, b)):
            pair = PairGeometry(self.regions, a, b, neighbour)
            for rule in self._between.get((self._kind(a), self._kind(b)), ()):
                if rule.name == "in" and b in self._rooms and self._kind(a) == "body":
                    true = b == self._room_of(a, rule)
                else:
                    true = rule.is_true(pair, rule.name in before)
                if true:
                    subject, object = (self._names.get(each, each) for each in (agent, b))
                    after[rule.name] = RelationFact(rule.name, subject, object)
        if before == after:
            return
        for fact in before.values():
            former.setdefault(fact, True)
            self._count[fact] -= 1
        for fact in after.values():
            former.setdefault(fact, fact in self._count)
            self._count[fact] += 1
        for fact in before.values():
            if self._count.get(fact) == 0:
                del self._count[fact]
        self._set_active(a, b, after)

    def _with_bodies(self, changed: Iterable[Hashable]) -> Iterator[Hashable]:
        """The changed entities, and what is partly in changed rooms: it may be in another one."""
        for entity in changed:
            yield entity
            if entity in self._rooms:
                yield from self.regions.neighbours(entity)
                yield from self._partners.get(entity, ())

    def _room_of(self, body: Hashable, rule: RelationRule) -> Hashable | None:
        """The room of a body, as stated; else the one with most of it, if enough is in rooms.

        Of rooms with as many of its voxels, it stays in its own.
        """
        stated = self._stated_rooms(body)
        if stated is not None:
            return next(iter(stated), None)
        shared = {
            (each.shared, "in" in self._active.get((body, other), {}), str(other).zfill(20)): other
            for other, each in self.regions.neighbours(body).items()
            if other in self._rooms and each.shared
        }
        if not shared:
            return None
        most = max(shared)
        within = sum(voxels for voxels, *_ in shared) / self.regions.size(body)
        return shared[most] if within >= (rule.end if most[1] else rule.begin) - 1e-9 else None

    def _set_active(self, a: Hashable, b: Hashable, facts: dict[str, RelationFact]) -> None:
        if facts:
            self._active[a, b] = facts
            self._partners[a].add(b)
            self._partners[b].add(a)
            return
        del self._active[a, b]
        if (b, a) not in self._active:
            for one, other in ((a, b), (b, a)):
                self._partners[one].discard(other)
                if not self._partners[one]:
                    del self._partners[one]

    def _kind(self, entity: Hashable) -> Kind:
        if entity in self._views:
            return "view"
        if entity in self._spaces:
            return "space"
        return "part" if entity in self._parts else "body"

    def _order(self, event: RelationEvent) -> tuple[bool, int, str, str]:
        rank = self._rank[event.relation]
        return event.began, rank, str(event.subject), str(event.object)
