"""The same problem in PDDL, for planners of the shelf: costs are milliseconds.

What holds in the logic program holds here: one drive between two events, no thing picked up more
often than it has to be, and in the end nothing in hand but what was before. After `finish` the
words of the goal are taken for things, which costs nothing.

The writer of unified-planning takes 600 times as long (``python -m benchmarks plans``), would
replace only the formatting, and needs the domain as objects, which are more lines than the PDDL.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

from planner.tasks.goal import ROBOT
from planner.tasks.problem import Problem, milliseconds
from semmap.whole_file import write_whole

_DOMAIN = """\
; Tasks of a robot that fetches and delivers; times are milliseconds.
(define (domain tasks)
  (:requirements :strips :typing :negative-preconditions
    :conditional-effects :universal-preconditions :action-costs)
  (:types thing site count left word)
  (:constants{constants})
  (:predicates
    (working) (may-drive) (robot-at ?l - site) (way ?a ?b - site)
    (at ?x - thing ?l - site) (on ?x ?y - thing) (held ?x - thing) (clear ?x - thing)
    (differ ?v ?w - word)
    (takes ?y ?x - thing) (fixed ?y - thing ?l - site) (carrier ?x - thing) (single ?x - thing)
    (load ?n - count) (more ?n ?m - count) (left-of ?x - thing ?n - left) (less ?n ?m - left)
    (open ?v - word) (is ?v - word ?x - thing) (candidate ?v - word ?x - thing)
    (taken ?v - word ?x - thing) (carries ?v - word) (free ?x - thing){predicates})
  (:functions (total-cost) - number (seconds ?a ?b - site) - number)

  (:action drive :parameters (?a ?b - site)
    :precondition (and (working) (may-drive) (robot-at ?a) (way ?a ?b))
    :effect (and (robot-at ?b) (not (robot-at ?a)) (not (may-drive))
                 (increase (total-cost) (seconds ?a ?b))))

  (:action pickup :parameters (?x ?y - thing ?l - site ?n ?m - count ?i ?j - left)
    :precondition (and (working) (robot-at ?l) (at ?x ?l) (on ?x ?y) (not (single ?y)) (clear ?x)
                       (load ?n) (more ?n ?m) (left-of ?x ?i) (less ?j ?i))
    :effect (and (held ?x) (not (on ?x ?y)) (not (at ?x ?l)) (load ?m) (not (load ?n))
                 (left-of ?x ?j) (not (left-of ?x ?i)) (may-drive)
                 (increase (total-cost) {pickup})))

  (:action unstack :parameters (?x ?y - thing ?l - site ?n ?m - count ?i ?j - left)
    :precondition (and (working) (robot-at ?l) (at ?x ?l) (on ?x ?y) (single ?y) (clear ?x)
                       (load ?n) (more ?n ?m) (left-of ?x ?i) (less ?j ?i))
    :effect (and (held ?x) (not (on ?x ?y)) (not (at ?x ?l)) (clear ?y) (load ?m) (not (load ?n))
                 (left-of ?x ?j) (not (left-of ?x ?i)) (may-drive)
                 (increase (total-cost) {pickup})))

  (:action place :parameters (?x ?y - thing ?l - site ?n ?m - count)
    :precondition (and (working) (robot-at ?l) (held ?x) (takes ?y ?x) (fixed ?y ?l)
                       (load ?m) (more ?n ?m))
    :effect (and (on ?x ?y) (at ?x ?l) (not (held ?x)) (load ?n) (not (load ?m)) (may-drive)
                 (increase (total-cost) {place})))

  (:action stack :parameters (?x ?y - thing ?l - site ?n ?m - count)
    :precondition (and (working) (robot-at ?l) (held ?x) (takes ?y ?x) (at ?y ?l) (single ?y)
                       (clear ?y) (load ?m) (more ?n ?m))
    :effect (and (on ?x ?y) (at ?x ?l) (not (held ?x)) (not (clear ?y)) (load ?n) (not (load ?m))
                 (may-drive) (increase (total-cost) {place})))

  (:action finish :parameters () :precondition (working)
    :effect (and (not (working)) (increase (total-cost) 0)))

  (:action mean :parameters (?v - word ?x - thing)
    :precondition (and (not (working)) (open ?v) (candidate ?v ?x) (not (taken ?v ?x)))
    :effect (and (is ?v ?x) (not (open ?v)) (increase (total-cost) 0)
                 (forall (?w - word) (when (differ ?v ?w) (taken ?w ?x)))))

  (:action leave :parameters (?x - thing)
    :precondition (and (not (working)) (not (held ?x)))
    :effect (and (free ?x) (increase (total-cost) 0)))

  (:action keep :parameters (?v - word ?x - thing)
    :precondition (and (not (working)) (carries ?v) (is ?v ?x))
    :effect (and (free ?x) (increase (total-cost) 0)))
{actions})
"""


def pddl(problem: Problem) -> tuple[str, str]:
    """Domain and problem as PDDL 2.1 with action costs.

    Raises ValueError for a thing that is carried with what stands on it (a tray).
    """
    return _Writer(problem).write()


def write_pddl(problem: Problem, folder: Path) -> tuple[Path, Path]:
    """Write ``domain.pddl`` and ``problem.pddl`` into a folder, and say where they are."""
    domain, task = pddl(problem)
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / "domain.pddl", folder / "problem.pddl"
    for path, facts in zip(paths, (domain, task), strict=True):
        write_whole(path, facts)
    return paths


class _Writer:
    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        names = {*problem.limits, *problem.takes, *problem.spots, *problem.held}
        names |= {*problem.on, *problem.on.values()}
        names |= {n for ns in problem.candidates.values() for n in ns}
        names |= {n for f in problem.facts for n in f[1:]}
        for operator in problem.operators:
            names |= {n for f in operator.facts for n in f[1:]}
        # names of entities may hold any characters; those of PDDL may not
        self.ids = {name: f"t{i}-{_plain(name)}" for i, name in enumerate(sorted(names))}
        words = [*problem.candidates, *problem.regions]
        self.words = {word: f"w{i}" for i, word in enumerate(words)}
        for name in problem.carriers:
            moves = name in problem.limits or name in problem.held
            if moves and name not in problem.fixed:
                raise ValueError(
                    f"{name} is carried with what stands on it, which the PDDL export cannot say; "
                    "plan it without pddl="
                )

    def write(self) -> tuple[str, str]:
        problem, t = self.problem, self.ids
        predicates: list[str] = []
        actions: list[str] = []
        goals: list[str] = ["(not (working))"]
        for k in range(len(problem.goal.atoms)):
            predicates.append(f"(reached{k})")
            goals.append(f"(reached{k})")
            actions += self._reach(k)
        arities = {(f[0], len(f) - 1) for f in problem.facts}
        for operator in problem.operators:
            arities |= {(f[0], len(f) - 1) for f in operator.facts}
        predicates += [
            f"(f-{name} {' '.join(f'?x{i}' for i in range(n))} - thing)" if n else f"(f-{name})"
            for name, n in sorted(arities)
        ]
        for i in range(len(problem.operators)):
            predicates.append(f"(undone{i})")
            actions.append(self._operator(i))
        goals += [f"(free {t[name]})" for name in problem.limits if name not in problem.held]
        n, most = len(problem.sites), max([*problem.limits.values(), 0])
        objects = [
            f"{' '.join(t.values())} - thing" if t else "",
            f"{' '.join(f's{i}' for i in range(n))} - site",
            f"{' '.join(f'n{i}' for i in range(problem.capacity + 1))} - count",
            f"{' '.join(f'l{i}' for i in range(most + 1))} - left",
            f"{' '.join(self.words.values())} - word" if self.words else "",
        ]
        domain = _DOMAIN.format(
            constants="".join(f"\n    {o}" for o in objects if o),
            predicates="".join(f"\n    {p}" for p in predicates),
            actions="".join(f"\n{a}" for a in actions),
            pickup=milliseconds(problem.pickup),
            place=milliseconds(problem.place),
        )
        return domain, self._problem(goals)

    def _problem(self, goals: Sequence[str]) -> str:
        problem, t = self.problem, self.ids
        n = len(problem.sites)
        most = max([*problem.limits.values(), 0])
        facts = ["(working)", "(may-drive)", "(robot-at s0)", "(= (total-cost) 0)"]
        for a, b in product(range(n), repeat=2):
            seconds = float(problem.seconds[a, b])
            if a != b and seconds < math.inf:
                facts.append(f"(way s{a} s{b}) (= (seconds s{a} s{b}) {milliseconds(seconds)})")
        facts.append(f"(load n{len(problem.held)})")
        facts += [f"(more n{i} n{i + 1})" for i in range(problem.capacity)]
        facts += [f"(less l{i} l{i + 1})" for i in range(most)]
        fixed_like = {n for n in t if n in problem.fixed or n in problem.carriers}
        above = set(problem.on.values())
        for name, of in t.items():
            if name in problem.limits:
                facts.append(f"(left-of {of} l{problem.limits[name]})")
            if name not in fixed_like and (name in problem.spots or name in problem.held):
                facts.append(f"(single {of})")
                if name not in above:
                    facts.append(f"(clear {of})")
            if name in problem.spots:
                kind = "fixed" if name in problem.fixed else "at"
                facts.append(f"({kind} {of} s{problem.spots[name]})")
        facts += [f"(on {t[a]} {t[b]})" for a, b in problem.on.items()]
        facts += [f"(held {t[name]})" for name in problem.held]
        facts += [f"(takes {t[y]} {t[x]})" for y, xs in problem.takes.items() for x in xs]
        for word, names in problem.candidates.items():
            of = self.words[word]
            facts.append(f"(open {of})")
            facts += [f"(candidate {of} {t[name]})" for name in names]
        for v, w in problem.differ:
            facts.append(f"(differ {self.words[v]} {self.words[w]})")
            facts.append(f"(differ {self.words[w]} {self.words[v]})")
        carried = [a.words[1] for a in problem.goal.atoms if a.relation == "carries"]
        facts += [f"(carries {self.words[word]})" for word in carried]
        facts += [self._fact(f) for f in problem.facts]
        facts += [f"(undone{i})" for i in range(len(problem.operators))]
        lines = "\n    ".join
        return (
            f"; {problem.goal.text}\n(define (problem task) (:domain tasks)\n"
            f"  (:init\n    {lines(facts)})\n"
            f"  (:goal (and\n    {lines(goals)}))\n"
            "  (:metric minimize (total-cost)))\n"
        )

    def _reach(self, k: int) -> Iterator[str]:
        """The actions that make an atom of the goal so in the end."""
        problem, atom = self.problem, self.problem.goal.atoms[k]
        things = {w: f"?x{i}" for i, w in enumerate(atom.words) if w in problem.candidates}
        x, places = [*things.values()], problem.regions.get(atom.words[-1])
        if atom.relation == "carries":
            facts = [f"(held {x[0]})"]
        elif atom.relation not in ("on", "in"):
            facts = [f"(f-{' '.join([atom.relation, *x])})"]
        elif places is None:
            facts = [f"(on {' '.join(x)})"]
        elif atom.words[0].text == ROBOT:
            facts = [f"(robot-at s{n})" for n, place in problem.finals if place in places]
        else:
            sites = enumerate(problem.sites)
            facts = [f"(at {x[0]} s{n})" for n, site in sites if site.place in places]
        means = [f"(is {self.words[word]} {thing})" for word, thing in things.items()]
        parameters = f"{' '.join(x)} - thing" if x else ""
        for number, fact in enumerate(facts):
            needs = " ".join(["(not (working))", *means, fact])
            yield _action(f"reach{k}-{number}", parameters, needs, f"(reached{k})")

    def _fact(self, fact: Sequence[str]) -> str:
        return f"(f-{' '.join([fact[0], *(self.ids[n] for n in fact[1:])])})"

    def _operator(self, i: int) -> str:
        """An action of a domain file, at the site where it is done."""
        problem, t = self.problem, self.ids
        operator = problem.operators[i]
        needs = ["(working)", f"(undone{i})", *(f"(held {t[n]})" for n in operator.held)]
        needs += [f"(on {t[a]} {t[b]})" for a, b in operator.on]
        needs += [self._fact(f) for f in operator.needs]
        needs += [f"(not {self._fact(f)})" for f in operator.needs_not]
        effects = [f"(not (undone{i}))", "(may-drive)", *(self._fact(f) for f in operator.adds)]
        effects += [f"(not {self._fact(f)})" for f in operator.deletes if f not in operator.adds]
        parameters = ""
        if operator.at is not None:
            kind, parameters = "fixed" if operator.at in problem.fixed else "at", "?l - site"
            needs += ["(robot-at ?l)", f"({kind} {t[operator.at]} ?l)"]
        cost = milliseconds(operator.seconds)
        name = f"do{i}-{operator.name}"
        return _action(name, parameters, " ".join(needs), " ".join(effects), cost)


def _action(name: str, parameters: str, needs: str, effects: str, cost: int = 0) -> str:
    return (
        f"  (:action {name} :parameters ({parameters})\n    :precondition (and {needs})\n"
        f"    :effect (and {effects} (increase (total-cost) {cost})))"
    )


def _plain(name: str) -> str:
    return "".join(c if c.isascii() and c.isalnum() else "-" for c in name.lower())
