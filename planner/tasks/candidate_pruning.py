"""Leaves out the candidates of a goal that no shortest plan uses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from planner.route_search import seconds_between
from planner.tasks.goal import ROBOT, Word
from planner.tasks.problem_draft import ProblemDraft


def prune(draft: ProblemDraft, aside: Mapping[str, None]) -> None:
    """Of objects that differ only by their sites, keep the best ones between any two others.

    `aside` are the objects in the way, which the robot puts aside.
    """
    for word in draft.wanted:
        _prune_objects(draft, aside, word)
    for atom in draft.problem.goal.atoms:
        if (atom.relation != "in" and atom.relation != "on") or atom.words[0].text == ROBOT:
            continue
        _prune_targets(draft, aside, atom.words[0], atom.words[1])


def _prune_objects(draft: ProblemDraft, aside: Mapping[str, None], word: Word) -> None:
    problem, surfaces = draft.problem, draft.surfaces
    names = problem.candidates[word]
    atoms = [a for a in problem.goal.atoms if word in a.words]
    if len(names) < 3 or len(atoms) != 1:
        return
    sharing = sum(bool(set(names) & set(others)) for others in problem.candidates.values())
    alike = [
        n
        for n in names
        if not draft.tucked.get(n)
        and n not in aside
        and n not in problem.held
        and not draft.satisfied(word, n)
        and set(surfaces[n]) == set(surfaces[names[0]])
    ]
    if len(alike) <= sharing:
        return
    rest = [n for w, ns in problem.candidates.items() if w != word for n in ns]
    rest += [n for n in problem.limits if n not in names]
    rest += [on for n in [*alike, *rest] for on in surfaces.get(n, ())]
    keep = _best(draft, alike, rest, sharing)
    dropped = set(alike) - keep
    problem.candidates[word] = [n for n in names if n not in dropped]
    still = {n for ns in problem.candidates.values() for n in ns}
    for name in dropped - still:
        problem.limits.pop(name, None)
        surfaces.pop(name, None)


def _prune_targets(
    draft: ProblemDraft, aside: Mapping[str, None], word: Word, target: Word
) -> None:
    problem, surfaces, items = draft.problem, draft.surfaces, draft.world.objects
    if sum(target in a.words for a in problem.goal.atoms) > 1:
        return
    names = problem.candidates[word]
    options = list(dict.fromkeys(on for n in names for on in surfaces.get(n, ())))
    fixed = [
        on
        for on in options
        if on not in problem.limits
        and all(on in surfaces.get(n, [on]) for n in names)
        and ((item := items.get(on)) is None or item.obstacle(draft.heights) is not None)  # stays
    ]
    if len(fixed) < 3 or any(n in aside for n in names):
        return
    rest = [n for ns in problem.candidates.values() for n in ns if n not in fixed]
    rest += list(problem.limits)
    rest += [on for n in rest for on in surfaces.get(n, ()) if on not in fixed]
    dropped = set(fixed) - _best(draft, fixed, rest, 1, last=True)
    for name in names:
        if name in surfaces:
            surfaces[name] = [on for on in surfaces[name] if on not in dropped]
    if target in problem.candidates:
        problem.candidates[target] = [n for n in problem.candidates[target] if n not in dropped]


def _best(
    draft: ProblemDraft,
    alike: Sequence[str],
    rest: Iterable[str],
    count: int,
    *,
    last: bool = False,
) -> set[str]:
    """The `count` objects of least detour between each two sites."""
    graph, numbering = draft.graph, draft.sites
    spots = np.array([numbering.of(n) for n in alike])
    others = sorted({0, *(numbering.of(n) for n in dict.fromkeys(rest))})
    others += [s for s, _ in draft.finals if s not in others]
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
