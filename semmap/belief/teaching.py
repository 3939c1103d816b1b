"""Teachings of modules and people, checked before the map is asked.

The parts are those of the thesis's teaching topic (appendix B.1), by its names or by plainer ones.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from semmap.belief.error import BeliefError
from semmap.finite_number import is_finite_number
from semmap.limits import TEXT_BYTES
from semmap.snake_case import snake_case
from semmap.suggestions import suggestion

Row = dict[str, Any]

ALIASES = {
    "directedRelations": "relations",
    "directed_relations": "relations",
    "actionss": "actions",
    "objs": "objects",
    "master": "subject",
    "slave": "object",
    "instance1": "cause",
    "instance2": "effect",
    "clas": "class",
    "baseArea": "base_area",
    "seenAt": "at",
    "time": "at",
}
"""Names of the thesis, and ours for them."""

PARTS = ("sentences", "knowledge", "relations", "actions", "objects", "observations", "model")
MODEL = (
    "there",
    "elsewhere",
    "change",
    "seconds",
    "moves",
    "stated",
    "prior_elsewhere",
    "prior_history",
    "prior_typical",
)
"""The numbers of the table ``belief_model``."""


@dataclass(frozen=True)
class Knowledge:
    """A concept (or an entity of the map) and its properties."""

    name: str
    properties: Row = field(default_factory=dict)


@dataclass(frozen=True)
class KnownRelation:
    """A directed relation: subject, its name, object, such as coke isA sodacan.

    A name may be that of an entity and of a class. It is the entity, unless the relation is
    `of_classes`.
    """

    subject: str
    relation: str
    object: str
    of_classes: bool = field(default=False, repr=False, kw_only=True)

    def __str__(self) -> str:
        return f"{self.subject} {self.relation} {self.object}"


@dataclass(frozen=True)
class KnownAction:
    """An action, the state that it needs, and the state that it brings about."""

    name: str
    cause: str
    effect: str


@dataclass(frozen=True)
class TaughtObject:
    """An object of the environment, with its class, if taught.

    `properties` are `base_area` (square metres), `volume` (cubic metres), `mobility` and others;
    `occurrences` are rows of `add_observations` without `object`.
    """

    name: str
    type: str | None = None
    properties: Row = field(default_factory=dict)
    occurrences: tuple[Row, ...] = ()


@dataclass(frozen=True)
class Teaching:
    """All that one message or file teaches; `model` has numbers of the table ``belief_model``.

    `sentences` are statements of the map's grammar, which the map's names give their meaning.
    """

    knowledge: tuple[Knowledge, ...] = ()
    relations: tuple[KnownRelation, ...] = ()
    actions: tuple[KnownAction, ...] = ()
    objects: tuple[TaughtObject, ...] = ()
    observations: tuple[Row, ...] = ()
    model: dict[str, float] = field(default_factory=dict)
    sentences: tuple[str, ...] = ()


def is_sentence(teaching: Any) -> bool:
    """Whether a teaching is a sentence and not the name of a file: it has a space and no ending.

    >>> is_sentence("the mug is on the table"), is_sentence("my kitchen.json")
    (True, False)
    """
    if not isinstance(teaching, str) or " " not in teaching.strip():
        return False
    return Path(teaching).suffix.lower() not in (".json", ".xml")


def is_a(relation: str) -> bool:
    """Whether a relation is that of a class to a class that subsumes it: isA, is_a, IsA."""
    return snake_case(relation) in ("is_a", "isa")


def read_teaching(path: Path) -> Teaching:
    """Return the teaching of a JSON file, or of a Map.xml of the thesis.

    `BeliefError` if it cannot be read or used; WorldError if an ``.xml`` is not XML.
    """
    if path.suffix.lower() == ".xml":
        from semmap.belief.map_xml import read_map_xml

        return parse_teaching(read_map_xml(path), str(path))
    try:
        TEXT_BYTES.check(
            path.stat().st_size,
            lambda problem, fix: BeliefError(f"{path}: {problem}. {fix}"),
            "Split the file.",
        )
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BeliefError(f"{path}: cannot be read ({error.strerror}): check the path") from error
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise BeliefError(f"{path}: is not valid JSON: {error}") from error
    return parse_teaching(data, str(path))


def parse_teaching(data: Any, where: str = "teaching") -> Teaching:
    """Return a teaching from plain data, as JSON has it; `where` begins messages, such as the file.

    `data` is a mapping with any of `sentences` (of the map's grammar, which state something),
    `knowledge` (name, properties), `relations` (subject, relation, object), `actions` (action,
    cause, effect), `objects` (name, class, base_area, volume, mobility, properties, occurrences),
    `observations` and `model`. The names of the thesis are accepted, too: directedRelations
    (master, action, slave), actions (action, instance1, instance2), objs (name, clas, base_area,
    volume, occurrences).

    Raises
    ------
    BeliefError
        A part, a name or a number that cannot be used, or classes that subsume each other.

    Examples
    --------
    >>> parse_teaching({"relations": [{"master": "coke", "action": "isA", "slave": "sodacan"}]})
    ... # doctest: +NORMALIZE_WHITESPACE
    Teaching(knowledge=(),
             relations=(KnownRelation(subject='coke', relation='isA', object='sodacan'),),
             actions=(), objects=(), observations=(), model={}, sentences=())
    """
    given = _renamed(data, where)
    _only(given, PARTS, where)
    teaching = Teaching(
        _each(given, "knowledge", where, _knowledge),
        _each(given, "relations", where, _relation),
        _each(given, "actions", where, _action),
        _each(given, "objects", where, _object),
        _each(given, "observations", where, _occurrence),
        _model(given.get("model", {}), where),
        _sentences(given.get("sentences", []), where),
    )
    if teaching == Teaching():
        raise BeliefError(f"{where}: teaches nothing: give any of {', '.join(PARTS)}")
    _check_cycles(teaching, where)
    _check_repeats(teaching, where)
    return teaching


def _each(given: Row, part: str, where: str, parse: Callable[[Row, str], Any]) -> tuple[Any, ...]:
    rows = given.get(part, [])
    if not isinstance(rows, Sequence) or isinstance(rows, str):
        raise BeliefError(f"{where}: {part} is {rows!r}: give a list")
    found = []
    for number, row in enumerate(rows, 1):
        place = f"{where}: {part} {number}"
        found.append(parse(_renamed(row, place), place))
    return tuple(found)


def _renamed(row: Any, where: str) -> Row:
    if not isinstance(row, Mapping):
        raise BeliefError(f"{where}: is {row!r}: give names with their values")
    found: Row = {}
    for key, value in row.items():
        name = ALIASES.get(str(key), str(key))
        if name in found:
            raise BeliefError(f"{where}: {name} is given twice")
        found[name] = value
    return found


def _only(row: Row, known: Sequence[str], where: str) -> None:
    unknown = [key for key in row if key not in known]
    if unknown:
        raise BeliefError(f"{where}: {unknown[0]} is not one of {', '.join(known)}")


def _knowledge(row: Row, where: str) -> Knowledge:
    _only(row, ("name", "properties"), where)
    return Knowledge(_name(row, "name", where), _properties(row, where))


def _relation(row: Row, where: str) -> KnownRelation:
    if "relation" not in row and "action" in row:
        row = {("relation" if key == "action" else key): value for key, value in row.items()}
    _only(row, ("subject", "relation", "object"), where)
    subject, name, other = (_name(row, key, where) for key in ("subject", "relation", "object"))
    found = KnownRelation(subject, name, other)
    if found.subject == found.object:
        raise BeliefError(f"{where}: {found}: a relation is between two names")
    return found


def _action(row: Row, where: str) -> KnownAction:
    _only(row, ("action", "cause", "effect"), where)
    found = KnownAction(*(_name(row, key, where) for key in ("action", "cause", "effect")))
    if found.cause == found.effect:
        raise BeliefError(f"{where}: {found.name}: cause and effect are both {found.cause}")
    return found


def _object(row: Row, where: str) -> TaughtObject:
    known = ("name", "class", "base_area", "volume", "mobility", "properties", "occurrences")
    _only(row, known, where)
    name = _name(row, "name", where)
    where += f" ({name})"
    properties = _properties(row, where)
    for quantity in ("base_area", "volume", "mobility"):
        if row.get(quantity) is not None:
            properties[quantity] = _number(row[quantity], quantity, where)
    for key in ("base_area", "volume"):
        if key in properties and not _number(properties[key], key, where) > 0:
            raise BeliefError(f"{where}: {key} is {properties[key]:g}: give a number above 0")
    if "mobility" in properties and not _number(properties["mobility"], "mobility", where) >= 0:
        raise BeliefError(f"{where}: mobility is {properties['mobility']:g}: give at least 0")
    rows = _each(row, "occurrences", where, _occurrence)
    type_ = _name(row, "class", where) if row.get("class") else None
    return TaughtObject(name, type_, properties, rows)


def _occurrence(row: Row, where: str) -> Row:
    """An observation: x and y become its position, a number as its time counts from 1970."""
    found: Row = {"seen": True} | row
    spot = [found.pop(axis, None) for axis in "xyz"]
    if spot[:2] != [None, None] or spot[2] is not None:
        found["position"] = [
            _number(0.0 if v is None else v, axis, where)
            for v, axis in zip(spot, "xyz", strict=True)
        ]
    if isinstance(found.get("at"), int | float) and not isinstance(found["at"], bool):
        from datetime import UTC, datetime

        try:
            found["at"] = datetime.fromtimestamp(found["at"], UTC)
        except (ValueError, OverflowError, OSError):
            raise BeliefError(
                f"{where}: at is {found['at']}: give seconds since 1970, or ISO 8601"
            ) from None
    return found


def _sentences(given: Any, where: str) -> tuple[str, ...]:
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise BeliefError(f"{where}: sentences is {given!r}: give a list")
    for number, sentence in enumerate(given, 1):
        if not isinstance(sentence, str) or not sentence.strip():
            raise BeliefError(f"{where}: sentences {number} is {sentence!r}: give a text")
    return tuple(given)


def _model(given: Any, where: str) -> dict[str, float]:
    row = _renamed(given, f"{where}: model")
    _only(row, MODEL, f"{where}: model")
    return {key: _number(value, key, f"{where}: model") for key, value in row.items()}


def _name(row: Row, key: str, where: str) -> str:
    value = row.get(key)
    if not isinstance(value, str) or not value.strip():
        raise BeliefError(f"{where}: {key} is {value!r}: give a name")
    return value.strip()


def _properties(row: Row, where: str) -> Row:
    """The properties of a concept; a text, as the thesis has it, is the property `text`."""
    given = row.get("properties") or {}
    if isinstance(given, str):
        return {"text": given}
    if not isinstance(given, Mapping):
        raise BeliefError(f"{where}: properties is {given!r}: give names with their values")
    for key in ("base_area", "volume", "mobility"):
        if key in given and not _number(given[key], key, where) >= 0:
            raise BeliefError(f"{where}: {key} is {given[key]:g}: give at least 0")
    try:
        json.dumps(dict(given), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise BeliefError(f"{where}: properties: {error}: give values that JSON has") from error
    return dict(given)


def _number(value: Any, key: str, where: str) -> float:
    """A finite number; the thesis writes numbers as text."""
    try:
        number = float(value) if isinstance(value, str) else value
    except ValueError:
        number = None
    if not is_finite_number(number):
        raise BeliefError(f"{where}: {key} is {value!r}: give a number")
    return number


def _check_cycles(teaching: Teaching, where: str) -> None:
    above: dict[str, set[str]] = {}
    for taught in teaching.relations:
        if is_a(taught.relation):
            above.setdefault(snake_case(taught.subject), set()).add(snake_case(taught.object))
    try:
        TopologicalSorter(above).prepare()
    except CycleError as error:
        circle = " isA ".join(reversed(error.args[1]))
        raise BeliefError(f"{where}: {circle}: leave out one of these relations") from None


def _check_repeats(teaching: Teaching, where: str) -> None:
    """An object that is taught twice must not be of two classes."""
    types: dict[str, str | None] = {}
    for taught in teaching.objects:
        if types.setdefault(taught.name, taught.type) != taught.type:
            raise BeliefError(
                f"{where}: {taught.name} is a {types[taught.name]} and a {taught.type}: teach one"
            )


def action_chain(
    actions: Sequence[KnownAction],
    goal: str,
    is_a: Callable[[str, str], bool],
    given: Collection[str] = (),
) -> list[KnownAction]:
    """Return the shortest chain of actions that brings about a goal, the first action first.

    An action does so if its effect is a kind of the goal, or the goal a kind of its effect. `is_a`
    says whether the first name is the second one or a kind of it. A cause that no action brings
    about, or that is `given`, ends the chain. `BeliefError` if there is no chain.

    Examples
    --------
    >>> fetch = KnownAction("grasp", "object_found", "object_held")
    >>> bring = KnownAction("bring", "object_held", "object_delivered")
    >>> chain = action_chain([bring, fetch], "object_delivered", str.__eq__)
    >>> [action.name for action in chain]
    ['grasp', 'bring']
    """

    def achieving(name: str) -> list[KnownAction]:
        return [a for a in actions if is_a(a.effect, name) or is_a(name, a.effect)]

    if any(is_a(fact, goal) for fact in given):
        return []
    if not achieving(goal):
        effects = [action.effect for action in actions]
        raise BeliefError(f"no action brings about {goal}{suggestion(goal, effects, 'teach one')}")
    found: deque[tuple[str, list[KnownAction]]] = deque([(goal, [])])
    visited = {goal}
    while found:
        name, chain = found.popleft()
        before = achieving(name)
        if chain and (not before or any(is_a(fact, name) for fact in given)):
            return chain
        for action in before:
            if action.cause not in visited:
                visited.add(action.cause)
                found.append((action.cause, [action, *chain]))
    raise BeliefError(f"each chain of actions that brings about {goal} needs itself")
