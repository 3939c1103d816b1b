"""Rules about what places, connectors and regions cost, or that routes must avoid them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, time
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, get_args

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
