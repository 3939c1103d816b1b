"""Finds what a goal names: the objects that it moves, and the surfaces on which it wants them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import product

from planner.tasks.goal import ROBOT, Atom, Goal, GoalError, Word
from planner.tasks.problem import NoPlanError, Problem, join_reasons
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.world import TaskObject, TaskWorld
from planner.topology import Topology

_SURFACES = frozenset({"table", "counter", "support_furniture", "shelf", "bookshelf"})


def resolve_words(problem: Problem, world: TaskWorld, topology: Topology) -> None:
    """Fill the candidates and regions of a problem, and the pairs of words that differ.

    Raises UnknownObjectError: a word stands for nothing; GoalError: the goal contradicts itself or
    the world; NoPlanError: the map has too few objects for a word.
    """
    goal = problem.goal
    _find_entities(problem, world, topology)
    for a in problem.candidates:
        for b in problem.candidates:
            if a.text == b.text and a < b:
                problem.differ.append((a, b))
        if len(problem.candidates[a]) <= a.number:
            raise NoPlanError(
                f"{goal.text} needs {a.number + 1} of {a.text}; the map has "
                f"{', '.join(problem.candidates[a])}"
            )
    by_name: dict[str, Word] = {}
    for word, names in problem.candidates.items():
        if len(names) == 1:
            other = by_name.setdefault(names[0], word)
            if other != word:
                _refuse_two_places(goal, other, word)
    if any(
        a.relation == "in" and a.words[0].text == ROBOT and a.words[1] in problem.candidates
        for a in goal.atoms
    ):
        raise GoalError(f"{goal.text}: a robot is in rooms; say the room of that object")


def _find_entities(problem: Problem, world: TaskWorld, topology: Topology) -> None:
    for atom in problem.goal.atoms:
        for i, word in enumerate(atom.words):
            if word.text == ROBOT or word in problem.candidates or word in problem.regions:
                continue
            kind, names = world.find(word, topology)
            if kind == "place" and (atom.relation != "in" or i != 1):
                raise GoalError(
                    f"{atom}: {word} is a place; say in({atom.words[0]}, {word})"
                    if atom.relation == "on"
                    else f"{atom}: {word} is a place, no object"
                )
            if kind == "region" and (atom.relation != "in" or atom.words[0].text != ROBOT):
                raise GoalError(
                    f"{atom}: {word} is a region, where only the robot can go; name the room, or "
                    "an object in it"
                )
            of = problem.candidates if kind == "item" else problem.regions
            of[word] = names


def _refuse_two_places(goal: Goal, a: Word, b: Word) -> None:
    """Refuse a goal that puts one object, with two words for it, on two others."""
    atoms = [
        [atom for atom in goal.atoms if atom.relation == "on" and atom.words[0] == word]
        for word in (a, b)
    ]
    for one, other in product(*atoms):
        if one.words[1] != other.words[1]:
            raise GoalError(
                f"{one} and {other} contradict each other: {a} and {b} are the same object; drop "
                "one of them"
            )


def find_wanted(draft: ProblemDraft) -> None:
    """Find the words whose objects the goal moves; drop the candidates that are out of reach.

    Raises GoalError: the goal moves a place; NoPlanError: too few objects can be picked up.
    """
    problem, sites, world = draft.problem, draft.sites, draft.world
    wanted = dict.fromkeys(
        atom.words[1] if atom.relation == "carries" else atom.words[0]
        for atom in problem.goal.atoms
        if (atom.relation in ("on", "in", "carries") and atom.words[0].text != ROBOT)
        or atom.relation == "carries"
    )
    named = dict.fromkeys(n for word in wanted for n in problem.candidates.get(word, ()))
    sites.survey(world.objects[n] for n in named)
    for word in wanted:
        if word not in problem.candidates:
            raise GoalError(f"{problem.goal.text}: {word} is a place; a robot carries objects")
        usable, reasons = [], []
        for name in problem.candidates[word]:
            done = name in problem.held or draft.satisfied(word, name)
            why = None if done else draft.obstacle(name)
            if why is None:
                usable.append(name)
            else:
                reasons.append(why)
        if len(usable) <= word.number:
            raise NoPlanError(join_reasons(reasons))
        problem.candidates[word] = usable
    draft.wanted = list(wanted)


def find_surfaces(draft: ProblemDraft) -> None:
    """Find the surfaces for each object that the goal moves; drop unsuitable candidates.

    Raises NoPlanError: no surface is suitable.
    """
    problem = draft.problem
    for word in draft.wanted:
        for name in problem.candidates[word]:
            draft.surfaces.setdefault(name, [])
    for atom in problem.goal.atoms:
        if atom.relation in ("on", "in") and atom.words[0].text != ROBOT:
            _find_surfaces_of(draft, atom)


def _find_surfaces_of(draft: ProblemDraft, atom: Atom) -> None:
    problem, world = draft.problem, draft.world
    word, target = atom.words
    reasons: list[str] = []
    taken: set[str] = set()
    inside = atom.relation == "in" and target in problem.candidates
    options = dict.fromkeys(_options(draft, target))
    for name, on in product(problem.candidates[word], options):
        if on != name and on in world.objects:
            draft.no_place(name, on, inside)  # first: bases stand where the hand gets
    draft.sites.survey(world.objects[on] for on in options if on in world.objects)
    for name in problem.candidates[word]:
        for on in options:
            if on == name:
                continue
            item, below = world.objects[name], world.objects.get(on)
            why = draft.unsuitable(name, on, inside=inside)
            if inside and below is not None and item.holder == on and not below.has_inside(item):
                reasons.append(f"{name} is on top of {on}: put it elsewhere first")
            elif why is None:
                draft.surfaces[name].append(on)
                taken.add(on)
            elif item.holder == on and (
                target in problem.candidates or draft.satisfied(word, name)
            ):
                taken.add(on)
            else:
                reasons.append(why)
    problem.refused += reasons
    if target in problem.candidates:
        kept = [n for n in problem.candidates[target] if n in taken]
        if len(kept) <= target.number:
            raise NoPlanError(join_reasons(reasons) or f"{atom}: nothing else fits there")
        problem.candidates[target] = kept
    elif not taken and not any(draft.satisfied(word, n) for n in problem.candidates[word]):
        raise NoPlanError(join_reasons(reasons) or f"{atom}: nothing else fits there")


def _options(draft: ProblemDraft, target: Word) -> Iterable[str]:
    problem = draft.problem
    if target in problem.candidates:
        return problem.candidates[target]
    found: list[str] = []
    for place in problem.regions[target]:
        inside = [t.name for t in draft.inside.get(place, ()) if _is_furniture(t, draft.heights)]
        found += inside or [place]
    return found


def _is_furniture(item: TaskObject, heights: tuple[float, float]) -> bool:
    """Whether an object stays where it is and has a surface that the robot reaches."""
    return (
        0 < item.surface < math.inf
        and item.obstacle(heights) is not None
        and heights[0] <= item.surface_height <= heights[1]
        and not _SURFACES.isdisjoint(item.types)
    )
