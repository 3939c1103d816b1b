"""What is in, on, near or touching what, and what an agent sees: from voxels, as things move.

Each relation begins at one threshold and ends at another, so that a thing that trembles at one of
them causes no flood. The words are those of `semmap.query.relations`, which asks the same of the
surfaces in the database; here the voxels of a `RegionMap` decide, and only pairs of which one
changed are looked at.

Source: "VDB-based Spatially Grounded Semantics for Interactive Robots", section VI, which leaves it
to future work ("tell me when the human looks at the book").
"""

from __future__ import annotations

import math
import threading
from collections import defaultdict
from collections.abc import Container, Hashable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal, NamedTuple

from semmap.fields.regions.region_map import Neighbour, RegionMap

__all__ = ["RULES", "Event", "Fact", "Kind", "Relations", "Rule", "near_within"]

Kind = Literal["body", "space", "view"]
"""What fills space, a piece of space such as a room or a zone, and an agent's field of view."""

Measure = Literal["within", "supported", "seen", "voxels apart", "metres apart"]
"""The share (0 to 1) of the subject's voxels that the object has; of its lowest layer that rests on
the object (`Support`); of the object's voxels that the subject has; or the gap between them."""

_SLACK = 1e-9  # 0.15 / 0.05 is less than 3
_APART = Neighbour(0, math.inf)


@dataclass(frozen=True)
class Rule:
    """When a relation begins, and when it ends.

    Attributes
    ----------
    name : of the relation
    measure : what decides
    begin, end : it begins where the measure reaches `begin`, and ends where it is beyond `end`.
        Where `begin` is above `end`, more is nearer; where it is below, less is.
    between : the kinds of subject and object between which it is looked for
    """

    name: str
    measure: Measure
    begin: float
    end: float
    between: frozenset[tuple[Kind, Kind]]

    def __post_init__(self) -> None:
        """Refuse what would tremble."""
        if not (math.isfinite(self.begin) and math.isfinite(self.end)) or self.begin == self.end:
            raise ValueError(
                f"{self.name} begins at {self.begin!r} and ends beyond {self.end!r}: give two "
                "numbers that differ, so that what trembles there is no flood"
            )

    def holds(self, meeting: _Meeting, standing: bool) -> bool:
        """Whether it holds, given whether it did."""
        value = meeting.measured(self.measure, standing)
        limit = self.end if standing else self.begin
        return value >= limit - _SLACK if self.begin > self.end else value <= limit + _SLACK

    def reach(self, voxel_size: float) -> float:
        """Metres of gap up to which it can hold."""
        if self.measure == "metres apart":
            return max(self.begin, self.end)
        return max(self.begin, self.end) * voxel_size if self.measure == "voxels apart" else 0.0


_BODIES: frozenset[tuple[Kind, Kind]] = frozenset({("body", "body")})
_INTO: frozenset[tuple[Kind, Kind]] = frozenset({("body", "body"), ("body", "space")})
_EITHER: frozenset[tuple[Kind, Kind]] = _INTO | {("space", "body")}
_VIEWED: frozenset[tuple[Kind, Kind]] = frozenset({("view", "body")})


def near_within(distance: float) -> Rule:
    """The rule of `near` for a gap of up to `distance` metres; it ends beyond 1.2 times that."""
    if not 0 < distance < math.inf:
        raise ValueError(f"near is within {distance!r}: give metres above 0")
    return Rule("near", "metres apart", distance, 1.2 * distance, _EITHER)


RULES = (
    Rule("in", "within", 0.9, 0.8, _INTO),
    Rule("on", "supported", 0.1, 0.05, _BODIES),
    Rule("touching", "voxels apart", 0.0, 1.0, _BODIES),
    near_within(0.5),
    Rule("sees", "seen", 0.2, 0.1, _VIEWED),
)
"""All relations. What is `on` need not be so to the voxel in order to last: see `Support.loose`.
`sees` is that of a field of view: what stands in the way is not looked at."""


class Fact(NamedTuple):
    """A statement that holds: `human1 sees book_326`."""

    relation: str
    subject: Hashable
    object: Hashable


@dataclass(frozen=True)
class Event:
    """A fact that begins to hold, or no longer does."""

    relation: str
    subject: Hashable
    object: Hashable
    began: bool
    time: datetime

    @property
    def fact(self) -> Fact:
        """What begins or ends."""
        return Fact(self.relation, self.subject, self.object)

    def __str__(self) -> str:
        verb = "begins" if self.began else "ends"
        return f"{self.subject} {self.relation} {self.object} {verb}"


class Relations:
    """The relations that hold between the entities of a region map.

    Two that are symmetric, `touching` and `near`, are two facts. May be used by several threads.

    Parameters
    ----------
    regions : RegionMap
    views : mapping, optional
        The agent of each entity that is a field of view; no agent sees itself.
    spaces : container, optional
        Those that are pieces of space: rooms, zones, personal spaces.
    names : mapping, optional
        What entities are called in facts, looked up when one begins, since what vanished may have
        no name any more; the entity itself if it has none.
    rules : iterable of Rule
        One a name.

    Notes
    -----
    `views`, `spaces` and `names` are read at each update: change them beforehand, and name what
    they concern among what changed.

    Examples
    --------
    >>> from semmap.fields import Box, RegionMap
    >>> regions = RegionMap(0.1)
    >>> regions.insert("table", Box((0, 0, 0.4), (1, 1, 0.8)))
    >>> regions.insert("mug", Box((0, 0, 0.85), (0.1, 0.1, 0.1)))
    >>> relations = Relations(regions)
    >>> [str(event) for event in relations.update(["table", "mug"]) if event.relation == "on"]
    ['mug on table begins']
    >>> regions.remove("mug")
    >>> [str(event) for event in relations.update(["mug"]) if event.relation == "on"]
    ['mug on table ends']
    """

    def __init__(
        self,
        regions: RegionMap,
        *,
        views: Mapping[Any, Hashable] | None = None,
        spaces: Container[Any] = (),
        names: Mapping[Any, Hashable] | None = None,
        rules: Iterable[Rule] = RULES,
    ) -> None:
        self.regions = regions
        self.rules = tuple(rules)
        self._views: Mapping[Any, Hashable] = {} if views is None else views
        self._spaces = spaces
        self._names: Mapping[Any, Hashable] = {} if names is None else names
        self._place = {rule.name: i for i, rule in enumerate(self.rules)}
        if len(self._place) < len(self.rules):
            raise ValueError("two rules have one name: give each relation one rule")
        self._between: dict[tuple[Kind, Kind], list[Rule]] = defaultdict(list)
        for rule in self.rules:
            for kinds in rule.between:
                self._between[kinds].append(rule)
        self._reach = max((rule.reach(regions.voxel_size) for rule in self.rules), default=0.0)
        # By entities of the map; an agent may have several views, so that facts are counted.
        self._standing: dict[tuple[Hashable, Hashable], dict[str, Fact]] = {}
        self._partners: dict[Hashable, set[Hashable]] = defaultdict(set)
        self._count: dict[Fact, int] = defaultdict(int)
        self._since: dict[Fact, datetime] = {}
        self._last: datetime | None = None
        self._lock = threading.RLock()

    def update(self, changed: Iterable[Hashable], time: datetime | None = None) -> list[Event]:
        """Take in that entities came, moved or vanished.

        Only pairs with one of them are looked at, and of space only what is around them.

        Parameters
        ----------
        time : datetime, optional
            Of the change, with a time zone; now if not given.

        Returns
        -------
        list of Event
            One a fact at most; those that end first.

        Raises
        ------
        ValueError
            A time without a zone, or before that of the last update.
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
            held: dict[Fact, bool] = {}
            done: set[Hashable] = set()
            for entity in dict.fromkeys(changed):
                reach = None if entity in self._views else self._reach
                around = self.regions.neighbours(entity, reach)
                done.add(entity)
                for other in (around.keys() | self._partners.get(entity, set())) - done:
                    lies = around.get(other, _APART)
                    self._judge(entity, other, lies, held)
                    self._judge(other, entity, lies, held)
            events = [
                Event(*fact, began=not before, time=now)
                for fact, before in held.items()
                if before != (fact in self._count)
            ]
            for event in events:
                if event.began:
                    self._since[event.fact] = now
                else:
                    del self._since[event.fact]
        return sorted(events, key=self._order)

    def holding(
        self,
        relation: str | None = None,
        *,
        subject: Hashable | None = None,
        object: Hashable | None = None,
    ) -> dict[Fact, datetime]:
        """The facts that hold, and since when; of one relation, subject or object if given."""
        with self._lock:
            return {
                fact: since
                for fact, since in self._since.items()
                if (relation is None or fact.relation == relation)
                and (subject is None or fact.subject == subject)
                and (object is None or fact.object == object)
            }

    def _judge(self, a: Hashable, b: Hashable, lies: Neighbour, held: dict[Fact, bool]) -> None:
        """Set what holds of a to b; `held` remembers what did before."""
        before = self._standing.get((a, b), {})
        after: dict[str, Fact] = {}
        agent = self._views.get(a, a)
        if agent != b:
            meeting = _Meeting(self.regions, a, b, lies)
            for rule in self._between.get((self._kind(a), self._kind(b)), ()):
                if rule.holds(meeting, rule.name in before):
                    subject, object = (self._names.get(each, each) for each in (agent, b))
                    after[rule.name] = Fact(rule.name, subject, object)
        if before == after:
            return
        for fact in before.values():
            held.setdefault(fact, True)
            self._count[fact] -= 1
        for fact in after.values():
            held.setdefault(fact, fact in self._count)
            self._count[fact] += 1
        for fact in before.values():
            if self._count.get(fact) == 0:
                del self._count[fact]
        self._remember(a, b, after)

    def _remember(self, a: Hashable, b: Hashable, facts: dict[str, Fact]) -> None:
        if facts:
            self._standing[a, b] = facts
            self._partners[a].add(b)
            self._partners[b].add(a)
            return
        del self._standing[a, b]
        if (b, a) not in self._standing:
            for one, other in ((a, b), (b, a)):
                self._partners[one].discard(other)
                if not self._partners[one]:
                    del self._partners[one]

    def _kind(self, entity: Hashable) -> Kind:
        if entity in self._views:
            return "view"
        return "space" if entity in self._spaces else "body"

    def _order(self, event: Event) -> tuple[bool, int, str, str]:
        place = self._place[event.relation]
        return event.began, place, str(event.subject), str(event.object)


@dataclass(frozen=True)
class _Meeting:
    """How `a` lies to `b`; measured when asked."""

    regions: RegionMap
    a: Hashable
    b: Hashable
    lies: Neighbour

    def measured(self, measure: Measure, standing: bool) -> float:
        match measure:
            case "within" | "seen":
                if self.lies.shared == 0:
                    return 0.0
                return self.lies.shared / self.regions.size(
                    self.a if measure == "within" else self.b
                )
            case "supported":
                if not standing and self.lies.gap > 0:
                    return 0.0
                layer, firm, loose = self.regions.support(self.a, self.b)
                return (loose if standing else firm) / layer if layer else 0.0
            case "voxels apart":
                return self.lies.gap
            case "metres apart":
                return self.lies.gap * self.regions.voxel_size
