"""Rules about what places, connectors and regions cost, or that routes must avoid them.

`penalties` turns them into penalties on the edges of a routing graph.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, time
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

from planner.graph_edges import Penalties
from planner.routing_graph import RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import PlaceRegion
from semmap.error import Error
from semmap.finite_number import is_finite_number
from semmap.yaml_file import parse_yaml, read_text

Kind = Literal["place", "connector", "region"]


class CostRulesError(Error, ValueError):
    """A file of rules is invalid; the message names the rule and how to fix it."""


@dataclass(frozen=True)
class CostRule:
    """Seconds that using the selected entities costs; infinity forbids them.

    Attributes
    ----------
    kind
        Of the entities that it selects; None selects all kinds.
    names
        Selects entities that have one of these names or labels.
    types
        Selects entities of one of these types; subtypes count.
    properties
        Selects entities that have all of these properties.
    hours
        Local time from which until which the rule applies; past midnight if the second is earlier.
    """

    seconds: float
    kind: Kind | None = None
    names: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    hours: tuple[time, time] | None = None

    def applies_at(self, at: datetime | None) -> bool:
        """Whether the rule applies at a moment; without a moment, only if it has no hours."""
        if self.hours is None:
            return True
        if at is None:
            return False
        begin, end = self.hours
        now = at.time()
        return begin <= now < end if begin <= end else now >= begin or now < end

    def selects(
        self,
        kind: Kind,
        names: Iterable[str | None],
        types: Iterable[str],
        properties: Mapping[str, Any],
    ) -> bool:
        """Whether the rule selects an entity."""
        return (
            self.kind in (None, kind)
            and len(self.properties) <= len(properties)
            and (not self.names or bool({*self.names} & {*names}))
            and (not self.types or bool({*self.types} & {*types}))
            and all(properties.get(k) == v for k, v in self.properties)
        )


@dataclass(frozen=True)
class CostRules:
    """Rules whose seconds add up."""

    rules: tuple[CostRule, ...]

    @staticmethod
    @cache
    def default() -> CostRules:
        """The rules that come with the planner, in ``planner/rules.yaml``."""
        text = (resources.files("planner") / "rules.yaml").read_text("utf-8")
        return CostRules.parse(text, "planner's rules.yaml")

    @classmethod
    def read(cls, path: Path | str) -> CostRules:
        """The rules in a YAML file; raises CostRulesError."""
        return cls.parse(read_text(path, "a file of rules", CostRulesError), str(path))

    @classmethod
    def parse(cls, text: str, file: str) -> CostRules:
        """The rules in YAML text, which errors call `file`; raises CostRulesError."""
        document = parse_yaml(text, file, CostRulesError)
        if not isinstance(document, dict) or not isinstance(document.get("rules"), list):
            raise CostRulesError(f"{file}: there is no list of rules; write rules: [...]")
        if set(document) != {"rules"}:
            unknown = ", ".join(sorted(str(k) for k in set(document) - {"rules"}))
            raise CostRulesError(f"{file}: unknown key {unknown}; the only key is rules")
        return cls(tuple(_rule(r, f"{file}: rule {i}") for i, r in enumerate(document["rules"], 1)))


def avoiding(names: Iterable[str]) -> tuple[CostRule, ...]:
    """Rules that forbid all entities of these names, labels or types."""
    return tuple(
        rule
        for name in names
        for rule in (CostRule(math.inf, names=(name,)), CostRule(math.inf, types=(name,)))
    )


_KEYS = {"kind", "name", "type", "properties", "from", "until", "seconds", "forbid"}


def _rule(value: object, where: str) -> CostRule:
    if not isinstance(value, dict) or set(value) - _KEYS:
        wrong = sorted(map(str, set(value) - _KEYS)) if isinstance(value, dict) else [repr(value)]
        raise CostRulesError(
            f"{where}: unknown key {', '.join(wrong)}; the keys are {', '.join(sorted(_KEYS))}"
        )
    kind = value.get("kind")
    if kind not in (None, *get_args(Kind)):
        raise CostRulesError(f"{where}: kind {kind!r} is not one of {', '.join(get_args(Kind))}")
    forbid, seconds = value.get("forbid", False), value.get("seconds", 0.0)
    if (
        not isinstance(forbid, bool)
        or not (is_finite_number(seconds) and seconds >= 0)
        or forbid == bool(seconds)
    ):
        raise CostRulesError(f"{where}: give seconds above 0, or forbid: true")
    if not any(value.get(key) for key in ("kind", "name", "type", "properties")):
        raise CostRulesError(f"{where}: selects everything; give a kind, name, type or properties")
    properties = value.get("properties", {})
    if not isinstance(properties, dict):
        raise CostRulesError(f"{where}: properties: give key: value, not {properties!r}")
    return CostRule(
        math.inf if forbid else float(seconds),
        kind,
        _words(value, "name", where),
        _words(value, "type", where),
        tuple(properties.items()),
        _hours(value, where),
    )


def _words(rule: dict[str, Any], key: str, where: str) -> tuple[str, ...]:
    value = rule.get(key, [])
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list) or not all(isinstance(v, str) and v for v in words):
        raise CostRulesError(f"{where}: {key}: give a word or a list of words, not {words!r}")
    return tuple(words)


def _hours(rule: dict[str, Any], where: str) -> tuple[time, time] | None:
    if "from" not in rule and "until" not in rule:
        return None
    try:
        begin, end = (time.fromisoformat(rule[key]) for key in ("from", "until"))
    except (KeyError, TypeError, ValueError):
        begin = end = time()
    local = begin.tzinfo is None and end.tzinfo is None
    if not local or begin == end:
        raise CostRulesError(
            f'{where}: the hours are invalid; write from: "22:00" and until: "06:00", in quotes'
        )
    return begin, end


def penalties(
    graph: RoutingGraph,
    rules: Sequence[CostRule],
    at: datetime | None = None,
    *,
    costmaps: StoreyCostmaps | None = None,
) -> Penalties:
    """The penalties that rules put on the edges of a graph at a moment.

    Travel leads around a forbidden region and takes as long as that. A region that costs seconds
    adds them to travel through it, or the additional time of the detour if that is less. Without
    costmaps, the places of the region are meant. Without a moment, rules that have hours do not
    apply.
    """
    found = Penalties()
    if costmaps is not None:
        _add_detours(graph, costmaps, forbidden_regions(graph, rules, at), found)
    for rule in (r for r in rules if r.applies_at(at)):
        for place in graph.topology.places.values():
            if rule.selects("place", (place.name, place.label), place.types, place.properties):
                edges = graph.edges_into(place.name)
                found.add(edges, rule.seconds, f"{place.name} is to be avoided")
        for i, c in enumerate(graph.connectors):
            if rule.selects("connector", (c.name,), (c.type,), c.properties):
                found.add((2 * i, 2 * i + 1), rule.seconds, f"{c.name} is to be avoided")
        for region in graph.topology.regions:
            if _selects_region(rule, region):
                _add_region(graph, costmaps, region, rule.seconds, found)
    return found


def forbidden_regions(
    graph: RoutingGraph, rules: Sequence[CostRule], at: datetime | None = None
) -> list[PlaceRegion]:
    """The regions that rules forbid at a moment."""
    forbidding = [r for r in rules if math.isinf(r.seconds) and r.applies_at(at)]
    return [
        region
        for region in graph.topology.regions
        if any(_selects_region(rule, region) for rule in forbidding)
    ]


def _selects_region(rule: CostRule, region: PlaceRegion) -> bool:
    return rule.selects("region", (region.name, region.label), region.types, region.properties)


def _add_detours(
    graph: RoutingGraph,
    costmaps: StoreyCostmaps,
    regions: Sequence[PlaceRegion],
    found: Penalties,
) -> None:
    """Let travel lead around all forbidden regions of its place; block it where none can."""
    for place in dict.fromkeys(p for r in regions for p in r.places):
        here = [r for r in regions if place in r.places]
        names = " and ".join(r.name for r in here)
        reason = f"{names} is to be avoided, and the path in {place} leads through it"
        for edge, seconds, metres in _longer_travel(graph, costmaps, place, here):
            if math.isinf(seconds):
                found.blocked.setdefault(edge, reason)
            else:
                found.detours[edge] = seconds, metres


def _add_region(
    graph: RoutingGraph,
    costmaps: StoreyCostmaps | None,
    region: PlaceRegion,
    seconds: float,
    found: Penalties,
) -> None:
    """Let travel through a region, or around it, cost more."""
    reason = f"{region.name} is to be avoided"
    for place in region.places:
        if costmaps is None:
            found.add(graph.edges_into(place), seconds, reason)
        elif math.isfinite(seconds):
            for edge, longer, _ in _longer_travel(graph, costmaps, place, [region]):
                found.add([edge], min(longer - float(graph.base[edge]), seconds), reason)


def _longer_travel(
    graph: RoutingGraph, costmaps: StoreyCostmaps, place: str, regions: Sequence[PlaceRegion]
) -> Iterator[tuple[int, float, float]]:
    """The travel edges of a place that are longer around regions: edge, seconds, metres."""
    edges = graph.travel_edges.get(place, slice(0, 0))
    storey = costmaps.storey_of(place)
    with costmaps.also_avoiding({storey: regions}):
        travel = graph.travel_in(place)
    for k, edge in enumerate(range(edges.start, edges.stop)):
        if travel.seconds[k] > graph.base[edge]:
            yield edge, float(travel.seconds[k]), float(travel.metres[k])
