"""Actions that users add to the planner's own, in a YAML file::

    actions:
      water:
        parameters: {plant: potted_plant, can: watering_can}   # a type, a label or a name each
        at: plant                                              # where the robot has to be
        needs: [holding(can), not watered(plant)]
        effects: [watered(plant)]
        seconds: 20

``holding(x)`` and ``on(x, y)`` are what the planner knows itself; all other predicates are the
file's. One of a single thing holds at first where the thing's property of that name is true.
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
from planner.tasks.world import World
from semmap.limits import ACTIONS, CONFIG_BYTES
from semmap.yaml_file import check_structure

__all__ = ["Domain", "DomainError", "UserAction", "read_domain"]

_KEYS = ("parameters", "at", "needs", "effects", "seconds")
_OWN = {"holding": 1, "on": 2}
_RESERVED = ("on", "in", "carries", "holding", "pickup", "place", "drive")
_MOST = 2000
"""Actions with things in place of parameters, more than which are refused."""

_MOST_STEPS = 10_000
"""Ways to bring about a fact that are looked at, one action after another."""

_LITERAL = re.compile(r"\s*(not\s+)?([A-Za-z_][\w-]*)\s*\(([^()]*)\)\s*$")


class DomainError(ValueError):
    """A domain file with a mistake; the message names the line and the mend."""


@dataclass(frozen=True)
class Literal:
    """A predicate of parameters, or that it does not hold."""

    predicate: str
    parameters: tuple[str, ...]
    holds: bool = True


@dataclass(frozen=True)
class UserAction:
    """An action of a domain file."""

    name: str
    parameters: Mapping[str, str]
    at: str | None
    needs: tuple[Literal, ...]
    effects: tuple[Literal, ...]
    seconds: float


@dataclass(frozen=True)
class Domain:
    """The actions of a domain file."""

    actions: tuple[UserAction, ...]

    @property
    def relations(self) -> list[tuple[str, int]]:
        """The predicates that goals may ask for, with their numbers of arguments."""
        return [(e.predicate, len(e.parameters)) for a in self.actions for e in a.effects]

    @property
    def words(self) -> list[str]:
        """Types, labels and names that its parameters need."""
        return sorted({kind for a in self.actions for kind in a.parameters.values()})

    def extend(self, problem: Problem, world: World) -> tuple[list[str], int]:
        """Add what the goal needs of these actions to a problem.

        Returns
        -------
        The things that they need the robot to hold, and how many events more that may take.

        Raises
        ------
        NoPlanError
            A fact that the goal asks for comes about by none of them.
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
                    raise NoPlanError(f"{atom}: {word} is no thing; {atom.relation} takes things")
            names = [problem.candidates[w] for w in atom.words]
            wanted.update(dict.fromkeys((atom.relation, *chosen) for chosen in product(*names)))
            slots += self._steps(atom.relation, (), iter(range(_MOST_STEPS)))
        predicates = {n.predicate for a in self.actions for n in (*a.needs, *a.effects)}
        problem.facts = [
            (predicate, thing.name)
            for predicate in sorted(predicates - {*_OWN})
            for thing in world.things.values()
            if thing.properties.get(predicate) is True
        ]
        made: dict[tuple[str, tuple[str, ...]], Operator] = {}
        todo = list(wanted)
        while todo:
            fact = todo.pop(0)
            for operator, needs in self._operators(fact, world):
                if made.setdefault((operator.name, operator.arguments), operator) is not operator:
                    continue
                if len(made) > _MOST:
                    raise NoPlanError(
                        f"{operator.name} can be done with too many things; name them in the goal"
                    )
                lifted.update(dict.fromkeys([*operator.held, *(a for a, _ in operator.on)]))
                for above, below in operator.on:
                    takes = problem.takes.setdefault(below, [])
                    if above not in takes:
                        takes.append(above)
                for need in needs:
                    if need not in wanted:
                        wanted[need] = None
                        todo.append(need)
        problem.operators = list(made.values())
        for atom in problem.goal.atoms:
            if atom.relation in own and not any(
                fact[0] == atom.relation and all(n in problem.candidates[w] for n, w in zip(
                    fact[1:], atom.words, strict=True))
                for fact in [*problem.facts, *(f for o in problem.operators for f in o.adds)]
            ):  # fmt: skip
                raise NoPlanError(
                    f"no action of the domain file brings about {atom}: nothing fits the "
                    "parameters of those that could; see what the map has with semmap ls"
                )
        return list(lifted), slots

    def _steps(self, predicate: str, before: tuple[str, ...], budget: Iterator[int]) -> int:
        """Events that it takes at most to bring about a fact: actions, and things taken and put."""
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
                most = max(most, 1 + sum(
                    2 if need.predicate in _OWN
                    else self._steps(need.predicate, (*before, predicate), budget)
                    for need in action.needs if need.holds
                ))  # fmt: skip
        return most

    def _operators(
        self, fact: tuple[str, ...], world: World
    ) -> Iterable[tuple[Operator, list[tuple[str, ...]]]]:
        """The actions that bring about a fact, with things in place of parameters."""
        for action in self.actions:
            for effect in action.effects:
                if effect.predicate != fact[0] or not effect.holds:
                    continue
                bound = dict(zip(effect.parameters, fact[1:], strict=True))
                options = []
                for parameter, kind in action.parameters.items():
                    fitting = _fitting(kind, world)
                    if parameter in bound:
                        fitting = [n for n in fitting if n == bound[parameter]]
                    options.append(fitting)
                for chosen in product(*options):
                    if len(set(chosen)) == len(chosen):
                        yield _ground(action, dict(zip(action.parameters, chosen, strict=True)))


def _fitting(kind: str, world: World) -> list[str]:
    if kind in world.things:
        return [kind]
    return world.of_kind(Word(kind))


def _ground(action: UserAction, of: Mapping[str, str]) -> tuple[Operator, list[tuple[str, ...]]]:
    def facts(literals: Iterable[Literal], holds: bool) -> tuple[tuple[str, ...], ...]:
        return tuple(
            (k.predicate, *(of[p] for p in k.parameters))
            for k in literals if k.holds == holds and k.predicate not in _OWN
        )  # fmt: skip

    own = [(k.predicate, tuple(of[p] for p in k.parameters)) for k in action.needs]
    needs = facts(action.needs, True)
    return Operator(
        action.name,
        tuple(of[p] for p in action.parameters),
        action.seconds,
        None if action.at is None else of[action.at],
        tuple(names[0] for name, names in own if name == "holding"),
        tuple((names[0], names[1]) for name, names in own if name == "on"),
        needs,
        facts(action.needs, False),
        facts(action.effects, True),
        facts(action.effects, False),
    ), list(needs)


# -- reading --------------------------------------------------------------------------------------


def read_domain(path: Path) -> Domain:
    """The actions of a file.

    Raises
    ------
    DomainError
        With the line of the mistake.
    """

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
        raise DomainError(f"{path}: no text; name a YAML file of actions") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f", line {mark.line + 1}"
        raise DomainError(f"{path}{line}: no YAML: {getattr(error, 'problem', error)}") from error
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
                raise self.fail(key, f"what is {name}? A domain file has actions: alone")
        if "actions" not in top:
            raise self.fail(tree, "no actions: in it; name one with its parameters and effects")
        actions = self.mapping(top["actions"][1], "actions", "maps names to what they need")
        if not actions:
            raise self.fail(tree, "actions: is empty; name one")
        ACTIONS.check(
            len(actions), lambda problem, fix: self.fail(tree, f"{problem}. {fix}"), "Drop some."
        )
        found = tuple(self.action(name, key, node) for name, (key, node) in actions.items())
        self.arities(found, actions)
        return Domain(found)

    def mapping(self, node: Any, what: str, mend: str) -> dict[str, tuple[Any, Any]]:
        if not isinstance(node, yaml.MappingNode):
            raise self.fail(node, f"{what} {mend}")
        found: dict[str, tuple[Any, Any]] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self.fail(key, f"{what}: a key is a word")
            if key.value in found:
                raise self.fail(key, f"{key.value} comes twice; drop one")
            found[key.value] = (key, value)
        return found

    def action(self, name: str, key: Any, node: Any) -> UserAction:
        if not re.fullmatch(r"[A-Za-z_][\w-]*", name) or name in _RESERVED:
            raise self.fail(key, f"an action cannot be named {name}; choose another word")
        said = self.mapping(node, name, f"has {', '.join(_KEYS)}")
        for part, (at, _) in said.items():
            if part not in _KEYS:
                raise self.fail(at, f"{name}: what is {part}? It has {', '.join(_KEYS)}")
        if "effects" not in said:
            raise self.fail(key, f"{name} has no effects; say what it brings about")
        parameters: dict[str, str] = {}
        if "parameters" in said:
            for parameter, (_, value) in self.mapping(
                said["parameters"][1], f"{name}: parameters", "map names to types"
            ).items():
                parameters[parameter] = self.word(value, f"{name}: the type of {parameter}")
        place = None
        if "at" in said:
            place = self.word(said["at"][1], f"{name}: at")
            if place not in parameters:
                raise self.fail(said["at"][1], f"{name}: at is a parameter, not {place}")
        needs = self.literals(name, said.get("needs"), parameters)
        effects = self.literals(name, said.get("effects"), parameters)
        for literal in effects:
            if literal.predicate in _RESERVED:
                raise self.fail(
                    said["effects"][1],
                    f"{name}: {literal.predicate} is the planner's own; effects are facts of yours",
                )
        for literal in needs:
            if literal.predicate in _OWN and not literal.holds:
                raise self.fail(said["needs"][1], f"{name}: say what shall be, not that "
                                f"{literal.predicate} shall not")  # fmt: skip
            if literal.predicate in _RESERVED and literal.predicate not in _OWN:
                raise self.fail(
                    said["needs"][1],
                    f"{name}: {literal.predicate} cannot be asked for; say holding(x) or on(x, y)",
                )
        seconds = 0.0
        if "seconds" in said:
            try:
                seconds = float(said["seconds"][1].value)
            except (TypeError, ValueError):
                seconds = -1.0
            if not 0 <= seconds < 1e6:
                raise self.fail(said["seconds"][1], f"{name}: seconds is a number from 0 on")
        return UserAction(name, parameters, place, needs, effects, seconds)

    def word(self, node: Any, what: str) -> str:
        if not isinstance(node, yaml.ScalarNode) or not node.value:
            raise self.fail(node, f"{what} is one word")
        return str(node.value)

    def literals(
        self, name: str, said: tuple[Any, Any] | None, parameters: Mapping[str, str]
    ) -> tuple[Literal, ...]:
        if said is None:
            return ()
        found = []
        for item, text in self.facts(name, said):
            match = _LITERAL.match(text)
            if match is None:
                raise self.fail(item, f"{name}: a fact reads watered(plant) or not watered(plant)")
            of = tuple(p.strip() for p in match[3].split(",")) if match[3].strip() else ()
            for parameter in of:
                if parameter not in parameters:
                    known = ", ".join(parameters) or "none"
                    raise self.fail(
                        item, f"{name}: {match[2]} is of {parameter}, which is no parameter; "
                        f"there are: {known}"
                    )  # fmt: skip
            if match[2] in _OWN and len(of) != _OWN[match[2]]:
                raise self.fail(item, f"{name}: {match[2]} takes {_OWN[match[2]]} parameters")
            found.append(Literal(match[2], of, match[1] is None))
        return tuple(found)

    def facts(self, name: str, said: tuple[Any, Any]) -> list[tuple[Any, str]]:
        """The facts of a list, each with where it stands: YAML takes ``[on(p, q)]`` for two."""
        node = said[1]
        if not isinstance(node, yaml.SequenceNode):
            raise self.fail(node, f"{name}: {said[0].value} is a list: [watered(plant)]")
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
        """Each predicate takes as many things everywhere, and some action brings it about."""
        counts: dict[str, int] = dict(_OWN)
        for action in actions:
            for literal in (*action.effects, *action.needs):
                known = counts.setdefault(literal.predicate, len(literal.parameters))
                if known != len(literal.parameters):
                    raise self.fail(
                        nodes[action.name][0],
                        f"{action.name}: {literal.predicate} is of {len(literal.parameters)} "
                        f"things here, of {known} before; make them the same",
                    )
