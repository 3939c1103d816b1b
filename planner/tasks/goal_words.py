"""Finds the objects and places that each word of a goal may stand for."""

from __future__ import annotations

from planner.tasks.goal import ROBOT, Goal, GoalError, Word
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.world import TaskWorld
from planner.topology import Topology


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
            if kind == "place":
                if atom.relation != "in" or i != 1:
                    raise GoalError(
                        f"{atom}: {word} is a place; say in({atom.words[0]}, {word})"
                        if atom.relation == "on"
                        else f"{atom}: {word} is a place, no object"
                    )
                problem.regions[word] = names
            elif kind == "region":
                if atom.relation != "in" or atom.words[0].text != ROBOT:
                    raise GoalError(
                        f"{atom}: {word} is a region, where only the robot can go; name the room, "
                        "or an object in it"
                    )
                problem.regions[word] = names
            else:
                problem.candidates[word] = names


def _refuse_two_places(goal: Goal, a: Word, b: Word) -> None:
    """Refuse a goal that puts one object, with two words for it, on two others."""
    atoms = [
        [atom for atom in goal.atoms if atom.relation == "on" and atom.words[0] == word]
        for word in (a, b)
    ]
    for one in atoms[0]:
        for other in atoms[1]:
            if one.words[1] != other.words[1]:
                raise GoalError(
                    f"{one} and {other} contradict each other: {a} and {b} are the same "
                    "object; drop one of them"
                )
