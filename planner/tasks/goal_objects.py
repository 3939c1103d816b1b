"""Finds the objects that a goal moves, and the surfaces on which it wants them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

from planner.tasks.goal import ROBOT, Atom, GoalError, Word
from planner.tasks.object_checks import ObjectChecks
from planner.tasks.problem import NoPlanError
from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.reason_list import join_reasons
from planner.tasks.world import TaskObject

_SURFACES = frozenset({"table", "counter", "support_furniture", "shelf", "bookshelf"})


class GoalObjects:
    """The words for the objects that a goal moves, and the surfaces on which it wants each."""

    def __init__(self, draft: ProblemDraft, checks: ObjectChecks) -> None:
        self.draft, self.checks = draft, checks
        self.wanted: list[Word] = []
        self.surfaces: dict[str, list[str]] = {}

    def find_wanted(self) -> None:
        """Find the words whose objects the goal moves; drop the candidates that are out of reach.

        Raises GoalError: the goal moves a place; NoPlanError: too few objects can be picked up.
        """
        problem, sites, world = self.draft.problem, self.draft.sites, self.draft.world
        named = dict.fromkeys(n for names in problem.candidates.values() for n in names)
        sites.survey(sites.of_object(world.objects[n]) for n in named)
        wanted = dict.fromkeys(
            atom.words[1] if atom.relation == "carries" else atom.words[0]
            for atom in problem.goal.atoms
            if (atom.relation in ("on", "in", "carries") and atom.words[0].text != ROBOT)
            or atom.relation == "carries"
        )
        for word in wanted:
            if word not in problem.candidates:
                raise GoalError(f"{problem.goal.text}: {word} is a place; a robot carries objects")
            usable, reasons = [], []
            for name in problem.candidates[word]:
                if name in problem.held or self.satisfied(word, name):
                    usable.append(name)
                    continue
                why = self.checks.obstacle(name)
                if why is None:
                    usable.append(name)
                else:
                    reasons.append(why)
            if len(usable) <= word.number:
                raise NoPlanError(join_reasons(reasons))
            problem.candidates[word] = usable
        self.wanted = list(wanted)

    def satisfied(self, word: Word, name: str) -> bool:
        """Whether an object is already where the goal requires it."""
        problem = self.draft.problem
        item = self.draft.world.objects[name]
        for atom in problem.goal.atoms:
            if atom.words[0] != word or atom.relation not in ("on", "in"):
                if atom.relation == "carries" and atom.words[1] == word:
                    return False
                continue
            target = atom.words[1]
            if target in problem.regions:
                if item.place not in problem.regions[target]:
                    return False
            elif item.holder not in problem.candidates[target]:
                return False
        return True

    def find_surfaces(self) -> None:
        """Find the surfaces for each object that the goal moves; drop unsuitable candidates.

        Raises NoPlanError: no surface is suitable.
        """
        problem = self.draft.problem
        for word in self.wanted:
            for name in problem.candidates[word]:
                self.surfaces.setdefault(name, [])
        for atom in problem.goal.atoms:
            if atom.relation in ("on", "in") and atom.words[0].text != ROBOT:
                self._find_surfaces_of(atom)

    def _find_surfaces_of(self, atom: Atom) -> None:
        problem, world = self.draft.problem, self.draft.world
        word, target = atom.words
        reasons: list[str] = []
        taken: set[str] = set()
        for name in problem.candidates[word]:
            for on in self._options(target):
                if on == name:
                    continue
                why = self.checks.unsuitable(name, on)
                if why is None:
                    self.surfaces[name].append(on)
                    taken.add(on)
                elif world.objects[name].holder == on:
                    taken.add(on)
                else:
                    reasons.append(why)
        if target in problem.candidates:
            kept = [n for n in problem.candidates[target] if n in taken]
            if len(kept) <= target.number:
                raise NoPlanError(join_reasons(reasons) or f"{atom}: nothing else fits there")
            problem.candidates[target] = kept
        elif not taken and not any(self.satisfied(word, n) for n in problem.candidates[word]):
            raise NoPlanError(join_reasons(reasons) or f"{atom}: nothing else fits there")

    def _options(self, target: Word) -> Iterable[str]:
        problem = self.draft.problem
        if target in problem.candidates:
            return problem.candidates[target]
        found: list[str] = []
        for place in problem.regions[target]:
            inside = [t.name for t in self._by_place.get(place, ()) if self._is_furniture(t)]
            found += inside or [place]
        return found

    def _is_furniture(self, item: TaskObject) -> bool:
        """Whether an object stays where it is and has a surface that the robot reaches."""
        lowest, highest = self.draft.heights
        return (
            item.surface > 0
            and item.surface < math.inf
            and item.obstacle(self.draft.heights) is not None
            and lowest <= item.surface_height <= highest
            and not _SURFACES.isdisjoint(item.types)
        )

    @cached_property
    def _by_place(self) -> dict[str, list[TaskObject]]:
        places: dict[str, list[TaskObject]] = {}
        for item in self.draft.world.objects.values():
            if item.place is not None:
                places.setdefault(item.place, []).append(item)
        return places
