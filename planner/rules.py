"""Penalties by semantics: what a way costs beside its time, and where it must not lead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, time
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

from planner.ground import Ground
from planner.network import Network
from planner.topology import Region
from semmap.yaml_file import parse_yaml, read_text

__all__ = ["Penalties", "Rule", "Rules", "RulesError", "barred_regions", "forbid", "penalties"]

Kind = Literal["place", "connector", "region"]


class RulesError(ValueError):
    """A file of rules that says what no rules say; the message names the element and the mend."""


@dataclass(frozen=True)
class Rule:
    """Seconds for what it fits; inf bars it.

    Attributes
    ----------
    names : what is named so, or has such a label
    types : one of these types; subtypes count
    properties : all of these
    hours : from when until when it holds; from evening until morning where the second is earlier
    """

    seconds: float
    kind: Kind | None = None
    names: tuple[str, ...] = ()
    types: tuple[str, ...] = ()
    properties: tuple[tuple[str, Any], ...] = ()
    hours: tuple[time, time] | None = None

    def holds_at(self, at: datetime | None) -> bool:
        """Whether it holds at a moment; where none is said, only if it always does."""
        if self.hours is None:
            return True
        if at is None:
            return False
        begin, end = self.hours
        now = at.time()
        return begin <= now < end if begin <= end else now >= begin or now < end

    def fits(
        self,
        kind: Kind,
        names: Iterable[str | None],
        types: Iterable[str],
        properties: Mapping[str, Any],
    ) -> bool:
        """Whether it asks for what is such."""
        return (
            self.kind in (None, kind)
            and (not self.names or bool({*self.names} & {*names}))
            and (not self.types or bool({*self.types} & {*types}))
            and all(properties.get(k) == v for k, v in self.properties)
        )


@dataclass(frozen=True)
class Rules:
    """Rules, which add up."""

    rules: tuple[Rule, ...]

    @staticmethod
    @cache
    def default() -> Rules:
        """Those that come with the planner, ``rules.yaml`` beside this file."""
        return Rules.parse(
            (resources.files("planner") / "rules.yaml").read_text("utf-8"), "planner's rules.yaml"
        )

    @classmethod
    def read(cls, path: Path | str) -> Rules:
        """The rules of a file.

        Raises
        ------
        RulesError
        """
        return cls.parse(read_text(path, "a file of rules", RulesError), str(path))

    @classmethod
    def parse(cls, said: str, file: str) -> Rules:
        """The rules of YAML text; `file` is what errors call it."""
        document = parse_yaml(said, file, RulesError)
        if not isinstance(document, dict) or not isinstance(document.get("rules"), list):
            raise RulesError(f"{file}: needs rules as a list, rules: [...]")
        if set(document) != {"rules"}:
            unknown = ", ".join(sorted(str(k) for k in set(document) - {"rules"}))
            raise RulesError(f"{file}: knows no {unknown}; it takes rules")
        return cls(tuple(_rule(r, f"{file}: rule {i}") for i, r in enumerate(document["rules"], 1)))


_KEYS = {"kind", "name", "type", "properties", "from", "until", "seconds", "forbid"}


def _rule(said: object, where: str) -> Rule:
    if not isinstance(said, dict) or set(said) - _KEYS:
        wrong = sorted(map(str, set(said) - _KEYS)) if isinstance(said, dict) else [repr(said)]
        raise RulesError(
            f"{where}: knows no {', '.join(wrong)}; it takes {', '.join(sorted(_KEYS))}"
        )
    if said.get("kind") not in (None, *get_args(Kind)):
        raise RulesError(f"{where}: its kind is one of {', '.join(get_args(Kind))}")
    forbid, seconds = said.get("forbid", False), said.get("seconds", 0.0)
    if not isinstance(forbid, bool) or not _is_time(seconds) or forbid == bool(seconds):
        raise RulesError(f"{where}: give seconds above 0, or forbid: true")
    if not any(said.get(key) for key in ("kind", "name", "type", "properties")):
        raise RulesError(f"{where}: fits everything; name a kind, a name, a type or properties")
    lists = []
    for key in ("name", "type"):
        value = said.get(key, [])
        value = [value] if isinstance(value, str) else value
        if not isinstance(value, list) or not all(isinstance(v, str) and v for v in value):
            raise RulesError(f"{where}: {key} is a word or a list of words, not {value!r}")
        lists.append(tuple(value))
    properties = said.get("properties", {})
    if not isinstance(properties, dict):
        raise RulesError(f"{where}: properties: give key: value, not {properties!r}")
    hours = None
    if "from" in said or "until" in said:
        hours = _hours(said.get("from"), said.get("until"))
        if hours is None:
            raise RulesError(f'{where}: hours are from: "22:00" and until: "06:00", in quotes')
    return Rule(
        math.inf if forbid else float(seconds), said.get("kind"), lists[0], lists[1],
        tuple(properties.items()), hours,
    )  # fmt: skip


def _hours(begin: object, end: object) -> tuple[time, time] | None:
    if not isinstance(begin, str) or not isinstance(end, str):
        return None
    try:
        found = time.fromisoformat(begin), time.fromisoformat(end)
    except ValueError:
        return None
    local = all(t.tzinfo is None for t in found)  # hours are those of the place
    return found if local and found[0] != found[1] else None


def _is_time(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf


@dataclass
class Penalties:
    """What `Network.penalised` takes: seconds more by edge, why it is barred, other walks."""

    seconds: dict[int, float] = field(default_factory=dict)
    bars: dict[int, str] = field(default_factory=dict)
    walks: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, edges: Iterable[int], seconds: float, why: str) -> None:
        """Lay a penalty on edges."""
        for edge in edges:
            if math.isinf(seconds):
                self.bars.setdefault(edge, why)
            else:
                self.seconds[edge] = self.seconds.get(edge, 0.0) + seconds


def penalties(
    network: Network,
    rules: Sequence[Rule],
    at: datetime | None = None,
    *,
    ground: Ground | None = None,
) -> Penalties:
    """What rules lay on the edges of a network at a moment.

    A barred region is gone around, and takes as long as that. Another one costs its penalty, or
    what going around it takes longer where that is less. Without costmaps its room is meant.
    """
    found = Penalties()
    topology = network.topology
    if ground is not None:
        _go_around(network, ground, barred_regions(network, rules, at), found)
    for rule in (r for r in rules if r.holds_at(at)):
        for place in topology.places.values():
            if rule.fits("place", (place.name, place.label), place.types, place.properties):
                why = f"{place.name} is to be avoided"
                found.add(network.entering(place.name), rule.seconds, why)
        for i, connector in enumerate(network.connectors):
            named = (connector.name,)
            if rule.fits("connector", named, (connector.type,), connector.properties):
                why = f"{connector.name} is to be avoided"
                found.add((2 * i, 2 * i + 1), rule.seconds, why)
        for region in topology.regions:
            if rule.fits("region", (region.name, region.label), region.types, region.properties):
                _dearer(network, ground, region, rule.seconds, found)
    return found


def _go_around(
    network: Network, ground: Ground, regions: Sequence[Region], found: Penalties
) -> None:
    """Lay on the walks of rooms what they take around all regions that are barred there."""
    for place in dict.fromkeys(p for r in regions for p in r.places):
        here = [r for r in regions if place in r.places]
        names = " and ".join(r.name for r in here)
        why = f"{names} is to be avoided, and the way in {place} leads through it"
        for edge, seconds, metres in _walks_around(network, ground, place, here):
            if math.isinf(seconds):
                found.bars.setdefault(edge, why)
            else:
                found.walks[edge] = seconds, metres


def _dearer(
    network: Network, ground: Ground | None, region: Region, seconds: float, found: Penalties
) -> None:
    """Lay on the walks of a region's rooms what going around it, or through it, costs more."""
    why = f"{region.name} is to be avoided"
    for place in region.places:
        if ground is None:
            found.add(network.entering(place), seconds, why)
        elif math.isfinite(seconds):
            for edge, longer, _ in _walks_around(network, ground, place, [region]):
                found.add([edge], min(longer - float(network.base[edge]), seconds), why)


def _walks_around(
    network: Network, ground: Ground, place: str, regions: Sequence[Region]
) -> Iterator[tuple[int, float, float]]:
    """The walks of a place that take longer around regions: edge, seconds, metres."""
    edges = network.walk_edges.get(place, slice(0, 0))
    storey = ground.storey_of(place)
    before = ground.avoided(storey)
    ground.avoid(storey, [*before, *regions])
    try:
        walks = network.walks_again(place)
    finally:
        ground.avoid(storey, before)
    for k, edge in enumerate(range(edges.start, edges.stop)):
        if walks.seconds[k] > network.base[edge]:
            yield edge, float(walks.seconds[k]), float(walks.metres[k])


def forbid(names: Iterable[str]) -> tuple[Rule, ...]:
    """Rules that bar what is named, labelled or typed so."""
    return tuple(
        rule
        for name in names
        for rule in (Rule(math.inf, names=(name,)), Rule(math.inf, types=(name,)))
    )


def barred_regions(
    network: Network, rules: Sequence[Rule], at: datetime | None = None
) -> list[Region]:
    """The regions that rules bar at a moment."""
    return [
        region
        for region in network.topology.regions
        if any(
            math.isinf(r.seconds)
            and r.holds_at(at)
            and r.fits("region", (region.name, region.label), region.types, region.properties)
            for r in rules
        )
    ]
