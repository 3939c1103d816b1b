"""Leaves out the candidates of a goal that no shortest plan uses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from planner.route_search import seconds_between
from planner.tasks.final_sites import FinalSites
from planner.tasks.goal import ROBOT, Word
from planner.tasks.goal_objects import GoalObjects
from planner.tasks.object_checks import ObjectChecks
from planner.tasks.problem_draft import ProblemDraft


class CandidatePruning:
    """Removes candidates and surfaces that no shortest plan uses.

    `aside` are the objects in the way, which the robot puts aside.
    """

    def __init__(
        self,
        draft: ProblemDraft,
        checks: ObjectChecks,
        objects: GoalObjects,
        aside: Mapping[str, None],
        finals: FinalSites,
    ) -> None:
        self.draft, self.checks, self.objects = draft, checks, objects
        self.aside, self.finals = aside, finals

    def prune(self) -> None:
        """Of objects that differ only by their sites, keep the best ones between any two others."""
        for word in self.objects.wanted:
            self._prune_objects(word)
        for atom in self.draft.problem.goal.atoms:
            if (atom.relation != "in" and atom.relation != "on") or atom.words[0].text == ROBOT:
                continue
            self._prune_targets(atom.words[0], atom.words[1])

    def _prune_objects(self, word: Word) -> None:
        problem, surfaces = self.draft.problem, self.objects.surfaces
        names = problem.candidates[word]
        atoms = [a for a in problem.goal.atoms if word in a.words]
        if len(names) < 3 or len(atoms) != 1:
            return
        sharing = sum(bool(set(names) & set(others)) for others in problem.candidates.values())
        alike = [
            n
            for n in names
            if not self.checks.tucked.get(n)
            and n not in self.aside
            and n not in problem.held
            and not self.objects.satisfied(word, n)
            and set(surfaces[n]) == set(surfaces[names[0]])
        ]
        if len(alike) <= sharing:
            return
        rest = [n for w, ns in problem.candidates.items() if w != word for n in ns]
        rest += [n for n in problem.limits if n not in names]
        rest += [on for n in [*alike, *rest] for on in surfaces.get(n, ())]
        keep = self._best(alike, rest, sharing)
        dropped = set(alike) - keep
        problem.candidates[word] = [n for n in names if n not in dropped]
        still = {n for ns in problem.candidates.values() for n in ns}
        for name in dropped - still:
            problem.limits.pop(name, None)
            surfaces.pop(name, None)

    def _prune_targets(self, word: Word, target: Word) -> None:
        problem, surfaces = self.draft.problem, self.objects.surfaces
        if sum(target in a.words for a in problem.goal.atoms) > 1:
            return
        names = problem.candidates[word]
        options = list(dict.fromkeys(on for n in names for on in surfaces.get(n, ())))
        fixed = [
            on
            for on in options
            if on not in problem.limits
            and all(on in surfaces.get(n, [on]) for n in names)
            and self._stays(on)
        ]
        if len(fixed) < 3 or any(n in self.aside for n in names):
            return
        rest = [n for ns in problem.candidates.values() for n in ns if n not in fixed]
        rest += list(problem.limits)
        rest += [on for n in rest for on in surfaces.get(n, ()) if on not in fixed]
        dropped = set(fixed) - self._best(fixed, rest, 1, last=True)
        for name in names:
            if name in surfaces:
                surfaces[name] = [on for on in surfaces[name] if on not in dropped]
        if target in problem.candidates:
            problem.candidates[target] = [n for n in problem.candidates[target] if n not in dropped]

    def _stays(self, on: str) -> bool:
        """Whether the robot cannot pick up an object; a floor stays too."""
        item = self.draft.world.objects.get(on)
        return item is None or item.obstacle(self.draft.heights) is not None

    def _best(
        self, alike: Sequence[str], rest: Iterable[str], count: int, *, last: bool = False
    ) -> set[str]:
        """The `count` objects of least detour between each two sites."""
        graph, numbering = self.draft.graph, self.draft.sites
        spots = np.array([numbering.of(n) for n in alike])
        others = sorted({0, *(numbering.of(n) for n in dict.fromkeys(rest))})
        others += [s for s, _ in self.finals.all if s not in others]
        sites = [numbering.all[i] for i in others]
        here = [numbering.all[i] for i in spots]
        to = seconds_between(graph, sites, here)  # (P, C)
        back = seconds_between(graph, here, sites)  # (C, N)
        if last or not len(others):
            back = np.column_stack([back, np.zeros(len(here))])
        keep: set[str] = set()
        for row in to:
            through = row[:, None] + back  # (C, N)
            order = np.argsort(through, axis=0, kind="stable")[:count]
            keep |= {alike[i] for i in np.unique(order)}
        return keep
