"""Reads domain files: additional actions, in YAML::

    actions:
      water:
        parameters: {plant: potted_plant, can: watering_can}   # types, labels or names
        at: plant                                              # where the robot has to be
        needs: [holding(can), not watered(plant)]
        effects: [watered(plant)]
        seconds: 20

The planner itself defines ``holding(x)`` and ``on(x, y)``; the file defines all other predicates.
Initially, a predicate holds for an object if the property of this name is true.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import yaml

from planner.tasks.goal import Word
from planner.tasks.problem import NoPlanError, Operator, Problem
from planner.tasks.world import TaskWorld
from semmap.error import Error
from semmap.limits import ACTIONS, CONFIG_BYTES
from semmap.yaml_file import check_structure

_KEYS = ("parameters", "at", "needs", "effects", "seconds")
_OWN = {"holding": 1, "on": 2}
_RESERVED = ("on", "in", "carries", "holding", "pickup", "place", "drive")
_MOST = 2000  # maximum number of actions after their parameters are replaced by objects
_MOST_STEPS = 10_000  # ways to bring about a fact that are looked at, one action after another

_LITERAL = re.compile(r"\s*(not\s+)?([A-Za-z_][\w-]*)\s*\(([^()]*)\)\s*$")


class DomainError(Error, ValueError):
    """A domain file is invalid; the message names the line and how to fix it."""


@dataclass(frozen=True)
class DomainLiteral:
    """A predicate of parameters, or its negation."""

    predicate: str
    parameters: tuple[str, ...]
    holds: bool = True


@dataclass(frozen=True)
class UserAction:
    """An action of a domain file."""

    name: str
    parameters: Mapping[str, str]
    at: str | None
    needs: tuple[DomainLiteral, ...]
    effects: tuple[DomainLiteral, ...]
    seconds: float


@dataclass(frozen=True)
class Domain:
    """The actions of a domain file."""

    actions: tuple[UserAction, ...]

    @property
    def relations(self) -> list[tuple[str, int]]:
        """The predicates that goals may use, with their numbers of arguments."""
        return [(e.predicate, len(e.parameters)) for a in self.actions for e in a.effects]

    @property
    def words(self) -> list[str]:
        """Types, labels and names that its parameters need."""
        return sorted({kind for a in self.actions for kind in a.parameters.values()})

    def extend(self, problem: Problem, world: TaskWorld) -> tuple[list[str], int]:
        """Add the actions that a goal needs to a problem.

        Returns the objects that the robot has to hold for them, and the maximum number of
        additional events. Raises NoPlanError: no action achieves a condition of the goal.
        """
        own = {name for name, _ in self.relations}
        lifted: dict[str, None] = {}
        wanted: dict[tuple[str, ...], None] = {}
        slots = 0
        for atom in problem.goal.atoms:
            if atom.relation not in own:
                continue
            for word in atom.words:
                if word not in problem.candidates:
                    raise NoPlanError(
                        f"{atom}: {word} is not an object; {atom.relation} takes objects"
                    )
            names = [problem.candidates[w] for w in atom.words]
            wanted.update(dict.fromkeys((atom.relation, *chosen) for chosen in product(*names)))
            slots += self._steps(atom.relation, (), iter(range(_MOST_STEPS)))
        predicates = {n.predicate for a in self.actions for n in (*a.needs, *a.effects)}
        problem.facts = [
            (predicate, item.name)
            for predicate in sorted(predicates - {*_OWN})
            for item in world.objects.values()
            if item.properties.get(predicate) is True
        ]
        made: dict[tuple[str, tuple[str, ...]], Operator] = {}
        todo = list(wanted)
        while todo:
            fact = todo.pop(0)
            for operator in self._operators(fact, world):
                if made.setdefault((operator.name, operator.arguments), operator) is not operator:
                    continue
                if len(made) > _MOST:
                    raise NoPlanError(
                        f"{operator.name} fits too many objects; name them in the goal"
                    )
                lifted.update(dict.fromkeys([*operator.held, *(a for a, _ in operator.on)]))
                for above, below in operator.on:
                    takes = problem.takes.setdefault(below, [])
                    if above not in takes:
                        takes.append(above)
                for need in operator.needs:
                    if need not in wanted:
                        wanted[need] = None
                        todo.append(need)
        problem.operators = list(made.values())
        for atom in problem.goal.atoms:
            if atom.relation in own and not any(
                fact[0] == atom.relation
                and all(
                    n in problem.candidates[w] for n, w in zip(fact[1:], atom.words, strict=True)
                )
                for fact in [*problem.facts, *(f for o in problem.operators for f in o.adds)]
            ):
                raise NoPlanError(
                    f"no action of the domain file achieves {atom}: no object fits the "
                    "parameters of such an action; semmap ls lists the objects"
                )
        return list(lifted), slots

    def _steps(self, predicate: str, before: tuple[str, ...], budget: Iterator[int]) -> int:
        """The maximum number of events that achieve a predicate, with pickups and placings."""
        if next(budget, None) is None:
            raise NoPlanError(
                f"{before[0]} needs facts that need others in more than {_MOST_STEPS} ways: "
                "give the actions of the domain file fewer needs"
            )
        if predicate in before:
            return 0
        most = 0
        for action in self.actions:
            if any(e.holds and e.predicate == predicate for e in action.effects):
                events, path = 1, (*before, predicate)
                for need in (n.predicate for n in action.needs if n.holds):
                    events += 2 if need in _OWN else self._steps(need, path, budget)
                most = max(most, events)
        return most

    def _operators(self, fact: tuple[str, ...], world: TaskWorld) -> Iterator[Operator]:
        """The actions that achieve a fact, with objects for their parameters."""
        for action in self.actions:
            for effect in action.effects:
                if effect.predicate != fact[0] or not effect.holds:
                    continue
                bound = dict(zip(effect.parameters, fact[1:], strict=True))
                options = [
                    [n for n in _fitting(kind, world) if bound.get(parameter, n) == n]
                    for parameter, kind in action.parameters.items()
                ]
                for chosen in product(*options):
                    if len(set(chosen)) == len(chosen):
                        yield _ground(action, dict(zip(action.parameters, chosen, strict=True)))


def _fitting(kind: str, world: TaskWorld) -> list[str]:
    if kind in world.objects:
        return [kind]
    return world.of_kind(Word(kind))


def _ground(action: UserAction, of: Mapping[str, str]) -> Operator:
    def facts(literals: Iterable[DomainLiteral], holds: bool) -> tuple[tuple[str, ...], ...]:
        return tuple(
            (k.predicate, *(of[p] for p in k.parameters))
            for k in literals
            if k.holds == holds and k.predicate not in _OWN
        )

    own = [(k.predicate, tuple(of[p] for p in k.parameters)) for k in action.needs]
    return Operator(
        action.name,
        tuple(of[p] for p in action.parameters),
        action.seconds,
        None if action.at is None else of[action.at],
        tuple(names[0] for name, names in own if name == "holding"),
        tuple((names[0], names[1]) for name, names in own if name == "on"),
        facts(action.needs, True),
        facts(action.needs, False),
        facts(action.effects, True),
        facts(action.effects, False),
    )


def read_domain(path: Path) -> Domain:
    """The actions of a file; a DomainError has the line of the mistake."""

    def refused(line: int, problem: str, fix: str) -> DomainError:
        return DomainError(f"{path}, line {line}: {problem}. {fix}")

    try:
        CONFIG_BYTES.check(
            path.stat().st_size, lambda p, f: refused(1, p, f), "Name a YAML file of actions."
        )
        text = path.read_text("utf-8")
        check_structure(text, refused)
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
    except OSError as error:
        raise DomainError(f"{path}: {error.strerror}; name a YAML file of actions") from error
    except UnicodeDecodeError as error:
        raise DomainError(f"{path}: not text; name a YAML file of actions") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f", line {mark.line + 1}"
        raise DomainError(
            f"{path}{line}: invalid YAML: {getattr(error, 'problem', error)}"
        ) from error
    return _Reader(path).domain(tree)


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, node: Any, what: str) -> DomainError:
        line = 1 if node is None else node.start_mark.line + 1
        return DomainError(f"{self.path}, line {line}: {what}")

    def domain(self, tree: Any) -> Domain:
        top = self.mapping(tree, "the file", "begins with actions:")
        for name, (key, _) in top.items():
            if name != "actions":
                raise self.fail(key, f"unknown key {name}; a domain file has only actions:")
        if "actions" not in top:
            raise self.fail(tree, "actions: is missing; add an action with parameters and effects")
        actions = self.mapping(top["actions"][1], "actions", "maps names to what they need")
        if not actions:
            raise self.fail(tree, "actions: is empty; add an action")
        ACTIONS.check(
            len(actions), lambda problem, fix: self.fail(tree, f"{problem}. {fix}"), "Drop some."
        )
        found = tuple(self.action(name, key, node) for name, (key, node) in actions.items())
        self.arities(found, actions)
        return Domain(found)

    def mapping(self, node: Any, what: str, hint: str) -> dict[str, tuple[Any, Any]]:
        if not isinstance(node, yaml.MappingNode):
            raise self.fail(node, f"{what} {hint}")
        found: dict[str, tuple[Any, Any]] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self.fail(key, f"{what}: a key is a word")
            if key.value in found:
                raise self.fail(key, f"{key.value} is there twice; remove one")
            found[key.value] = (key, value)
        return found

    def action(self, name: str, key: Any, node: Any) -> UserAction:
        if not re.fullmatch(r"[A-Za-z_][\w-]*", name) or name in _RESERVED:
            raise self.fail(key, f"an action cannot be named {name}; choose another word")
        given = self.mapping(node, name, f"has {', '.join(_KEYS)}")
        for part, (at, _) in given.items():
            if part not in _KEYS:
                raise self.fail(at, f"{name}: unknown key {part}; the keys are {', '.join(_KEYS)}")
        if "effects" not in given:
            raise self.fail(key, f"{name} has no effects; add effects:")
        parameters: dict[str, str] = {}
        if "parameters" in given:
            what, hint = f"{name}: parameters", "map names to types"
            for parameter, (_, value) in self.mapping(given["parameters"][1], what, hint).items():
                parameters[parameter] = self.word(value, f"{name}: the type of {parameter}")
        place = None
        if "at" in given:
            place = self.word(given["at"][1], f"{name}: at")
            if place not in parameters:
                raise self.fail(given["at"][1], f"{name}: at is a parameter, not {place}")
        needs = self.literals(name, given.get("needs"), parameters)
        effects = self.literals(name, given.get("effects"), parameters)
        for of in (e.predicate for e in effects if e.predicate in _RESERVED):
            why = f"{of} is defined by the planner; effects use other predicates"
            raise self.fail(given["effects"][1], f"{name}: {why}")
        for of, holds in ((n.predicate, n.holds) for n in needs if n.predicate in _RESERVED):
            if of not in _OWN:
                why = f"{of} cannot be a need; use holding(x) or on(x, y)"
                raise self.fail(given["needs"][1], f"{name}: {why}")
            if not holds:
                why = f"only positive needs are possible: {of} shall not"
                raise self.fail(given["needs"][1], f"{name}: {why}")
        seconds = 0.0
        if "seconds" in given:
            try:
                seconds = float(given["seconds"][1].value)
            except (TypeError, ValueError):
                seconds = -1.0
            if not 0 <= seconds < 1e6:
                raise self.fail(given["seconds"][1], f"{name}: seconds: give a number, 0 or more")
        return UserAction(name, parameters, place, needs, effects, seconds)

    def word(self, node: Any, what: str) -> str:
        if not isinstance(node, yaml.ScalarNode) or not node.value:
            raise self.fail(node, f"{what} is one word")
        return str(node.value)

    def literals(
        self, name: str, given: tuple[Any, Any] | None, parameters: Mapping[str, str]
    ) -> tuple[DomainLiteral, ...]:
        if given is None:
            return ()
        found = []
        for item, text in self.facts(name, given):
            match = _LITERAL.match(text)
            if match is None:
                raise self.fail(item, f"{name}: a fact reads watered(plant) or not watered(plant)")
            of = tuple(p.strip() for p in match[3].split(",")) if match[3].strip() else ()
            for parameter in of:
                if parameter not in parameters:
                    known = ", ".join(parameters) or "none"
                    why = f"uses {parameter}, which is not a parameter; there are: {known}"
                    raise self.fail(item, f"{name}: {match[2]} {why}")
            if match[2] in _OWN and len(of) != _OWN[match[2]]:
                raise self.fail(item, f"{name}: {match[2]} takes {_OWN[match[2]]} parameters")
            found.append(DomainLiteral(match[2], of, match[1] is None))
        return tuple(found)

    def facts(self, name: str, given: tuple[Any, Any]) -> list[tuple[Any, str]]:
        """The facts of a list with their nodes: YAML reads ``[on(p, q)]`` as two elements."""
        node = given[1]
        if not isinstance(node, yaml.SequenceNode):
            raise self.fail(node, f"{name}: {given[0].value} is a list: [watered(plant)]")
        found: list[tuple[Any, str]] = []
        for item in node.value:
            if not isinstance(item, yaml.ScalarNode):
                raise self.fail(item, f"{name}: a fact reads watered(plant) or not watered(plant)")
            if found and found[-1][1].count("(") > found[-1][1].count(")"):
                found[-1] = (found[-1][0], f"{found[-1][1]}, {item.value}")
            else:
                found.append((item, str(item.value)))
        return found

    def arities(self, actions: Iterable[UserAction], nodes: Mapping[str, tuple[Any, Any]]) -> None:
        """Refuse predicates with different numbers of arguments."""
        counts: dict[str, int] = dict(_OWN)
        for action in actions:
            for literal in (*action.effects, *action.needs):
                known = counts.setdefault(literal.predicate, len(literal.parameters))
                if known != len(literal.parameters):
                    raise self.fail(
                        nodes[action.name][0],
                        f"{action.name}: {literal.predicate} is of {len(literal.parameters)} "
                        f"objects here, of {known} before; make them the same",
                    )
