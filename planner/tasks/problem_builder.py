"""Builds the problem of a goal: the objects, surfaces and sites that its plan can use.

Only the objects that a goal names, the objects in their way and the surfaces for them become part
of the problem, with the travel times between their sites. So neither the size of the building nor
the number of its objects matters. Objects that no shortest plan can use are left out (`_best`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from planner.route_search import seconds_between
from planner.routing_graph import RoutingGraph
from planner.tasks.goal import ROBOT, Goal, GoalError, Word
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.sites import ApproachPoseOf, Sites
from planner.tasks.world import TaskObject, TaskState, TaskWorld
from planner.topology import OUTSIDE

__all__ = ["Extend", "build_problem"]

Extend = Callable[[Problem, TaskWorld], tuple[list[str], int]]
"""Adds operators and facts; returns the objects to hold for them, and the number of more events."""

_SURFACES = frozenset({"table", "counter", "support_furniture", "shelf", "bookshelf"})


def build_problem(
    graph: RoutingGraph,
    world: TaskWorld,
    state: TaskState,
    goal: Goal,
    *,
    approach_pose: ApproachPoseOf | None = None,
    extend: Extend | None = None,
) -> Problem:
    """The problem of a goal.

    Raises
    ------
    UnknownObjectError
        A word of the goal stands for nothing.
    GoalError
        The goal contradicts itself or the world.
    NoPlanError
        The goal cannot be reached; the message says why.
    """
    return _ProblemBuilder(graph, world, state, goal, approach_pose, extend).problem()


class _ProblemBuilder:
    def __init__(
        self,
        graph: RoutingGraph,
        world: TaskWorld,
        state: TaskState,
        goal: Goal,
        approach_pose: ApproachPoseOf | None,
        extend: Extend | None,
    ) -> None:
        self.graph, self.world, self.state, self.goal = graph, world, state, goal
        self.heights = graph.robot.heights
        self.sites = Sites(graph, world, state.place, state.pose, approach_pose)
        self.extend = extend
        times = graph.durations
        self.made = Problem(goal, state, graph.robot.capacity, times.pickup, times.place)
        self.reach: dict[str, str | None] = {}
        self.tucked: dict[str, list[str]] = {}  # objects to take off an object first

    def problem(self) -> Problem:
        made = self.made
        for name in self.state.carrying:
            if name not in self.world.objects:
                raise NoPlanError(f"the robot carries {name}, which the world does not have")
        if len(self.state.carrying) > made.capacity:
            raise NoPlanError(
                f"the robot already carries {', '.join(self.state.carrying)}: more than its "
                f"capacity of {made.capacity}"
            )
        made.held = list(self.state.carrying)
        self._words()
        moved = self._moved()
        extra, self.more = self.extend(made, self.world) if self.extend else ([], 0)
        for name in extra:
            why = self._obstacle(name)
            if why is None and name not in made.held:
                moved.setdefault(name, 0)
        self._targets(moved)
        self._limits(moved, extra)
        self._surfaces(moved, extra)
        self._finals()
        self._drives()
        return made

    # -- what the words mean -----------------------------------------------------------------------

    def _words(self) -> None:
        made, topology = self.made, self.graph.topology
        for atom in self.goal.atoms:
            for i, word in enumerate(atom.words):
                if word.text == ROBOT or word in made.candidates or word in made.regions:
                    continue
                kind, names = self.world.find(word, topology)
                if kind == "place":
                    if atom.relation != "in" or i != 1:
                        raise GoalError(
                            f"{atom}: {word} is a place; say in({atom.words[0]}, {word})"
                            if atom.relation == "on"
                            else f"{atom}: {word} is a place, no object"
                        )
                    made.regions[word] = names
                else:
                    made.candidates[word] = names
        for a in made.candidates:
            for b in made.candidates:
                if a.text == b.text and a < b:
                    made.differ.append((a, b))
            if len(made.candidates[a]) <= a.number:
                raise NoPlanError(
                    f"{self.goal.text} needs {a.number + 1} of {a.text}; the map has "
                    f"{', '.join(made.candidates[a])}"
                )
        by_name: dict[str, Word] = {}
        for word, names in made.candidates.items():
            if len(names) == 1:
                other = by_name.setdefault(names[0], word)
                if other != word:
                    self._refuse_two_places(other, word)
        if any(
            a.relation == "in" and a.words[0].text == ROBOT and a.words[1] in made.candidates
            for a in self.goal.atoms
        ):
            raise GoalError(f"{self.goal.text}: a robot is in rooms; say the room of that object")

    def _refuse_two_places(self, a: Word, b: Word) -> None:
        """Refuse a goal that puts one object, with two words for it, on two others."""
        atoms = [
            [atom for atom in self.goal.atoms if atom.relation == "on" and atom.words[0] == word]
            for word in (a, b)
        ]
        for one in atoms[0]:
            for other in atoms[1]:
                if one.words[1] != other.words[1]:
                    raise GoalError(
                        f"{one} and {other} contradict each other: {a} and {b} are the same "
                        "object; drop one of them"
                    )

    def _moved(self) -> dict[str, int]:
        """Things that the goal moves; words of which nothing can be taken are refused."""
        made = self.made
        moved: dict[str, int] = {}
        named = dict.fromkeys(n for names in made.candidates.values() for n in names)
        self.sites.survey(self.sites.of_object(self.world.objects[n]) for n in named)
        wanted = dict.fromkeys(
            atom.words[1] if atom.relation == "carries" else atom.words[0]
            for atom in self.goal.atoms
            if (atom.relation in ("on", "in", "carries") and atom.words[0].text != ROBOT)
            or atom.relation == "carries"
        )
        for word in wanted:
            if word not in made.candidates:
                raise GoalError(f"{self.goal.text}: {word} is a place; a robot carries objects")
            usable, reasons = [], []
            for name in made.candidates[word]:
                if name in made.held or self._satisfied(word, name):
                    usable.append(name)
                    continue
                why = self._obstacle(name)
                if why is None:
                    usable.append(name)
                else:
                    reasons.append(why)
            if len(usable) <= word.number:
                raise NoPlanError(_some(reasons))
            made.candidates[word] = usable
        self.wanted = list(wanted)
        return moved

    def _satisfied(self, word: Word, name: str) -> bool:
        """Whether an object is already where the goal requires it."""
        item = self.world.objects[name]
        for atom in self.goal.atoms:
            if atom.words[0] != word or atom.relation not in ("on", "in"):
                if atom.relation == "carries" and atom.words[1] == word:
                    return False
                continue
            target = atom.words[1]
            if target in self.made.regions:
                if item.place not in self.made.regions[target]:
                    return False
            elif item.holder not in self.made.candidates[target]:
                return False
        return True

    def _obstacle(self, name: str) -> str | None:
        """Why an object, or an object on it, cannot be picked up; else None."""
        if name in self.reach:
            return self.reach[name]
        self.reach[name] = None
        item = self.world.objects[name]
        why = item.obstacle(self.heights) or self._unreachable(item)
        off: list[str] = []
        if why is None and not item.carrier:
            for above in self.world.above.get(name, ()):
                reason = self._obstacle(above)
                if reason is not None:
                    why = f"{above} stands on {name}: {reason}"
                    break
                off += [above, *self.tucked[above]]
        self.tucked[name] = off
        self.reach[name] = why
        return why

    def _unreachable(self, item: TaskObject) -> str | None:
        if item.place is None:
            return f"{item.name} is in no room that the map knows; place it in one"
        number = self.sites.of_object(item)
        return (
            None
            if self.sites.is_reachable(number)
            else self.sites.unreachable_reason(number, item.name)
        )

    # -- what may be put where ---------------------------------------------------------------------

    def _targets(self, moved: dict[str, int]) -> None:
        """Find the surfaces for each object that the goal moves."""
        made = self.made
        self.goals: dict[str, list[str]] = {}
        for word in self.wanted:
            for name in made.candidates[word]:
                moved.setdefault(name, 0)
                self.goals.setdefault(name, [])
        for atom in self.goal.atoms:
            if atom.relation not in ("on", "in") or atom.words[0].text == ROBOT:
                continue
            word, target = atom.words
            reasons: list[str] = []
            taken: set[str] = set()
            for name in made.candidates[word]:
                for on in self._options(target):
                    if on == name:
                        continue
                    why = self._unsuitable(name, on)
                    if why is None:
                        self.goals[name].append(on)
                        taken.add(on)
                    elif self.world.objects[name].holder == on:
                        taken.add(on)
                    else:
                        reasons.append(why)
            if target in made.candidates:
                kept = [n for n in made.candidates[target] if n in taken]
                if len(kept) <= target.number:
                    raise NoPlanError(_some(reasons) or f"{atom}: nothing else fits there")
                made.candidates[target] = kept
            elif not taken and not any(self._satisfied(word, n) for n in made.candidates[word]):
                raise NoPlanError(_some(reasons) or f"{atom}: nothing else fits there")

    def _options(self, target: Word) -> list[str]:
        made = self.made
        if target in made.candidates:
            return made.candidates[target]
        found = []
        for place in made.regions[target]:
            inside = [
                t.name
                for t in self._by_place().get(place, ())
                if t.surface > 0
                and t.surface < math.inf
                and t.obstacle(self.heights) is not None
                and _out(t.surface_height, self.heights) is False
                and _SURFACES.intersection(t.types)
            ]
            found += inside or [place]
        return found

    def _by_place(self) -> Mapping[str, Sequence[TaskObject]]:
        if not hasattr(self, "places"):
            self.places: dict[str, list[TaskObject]] = {}
            for item in self.world.objects.values():
                if item.place is not None:
                    self.places.setdefault(item.place, []).append(item)
        return self.places

    def _unsuitable(self, name: str, on: str) -> str | None:
        item = self.world.objects[name]
        if on not in self.world.objects:
            if not len(self.graph.nodes.get(on, ())) and on != self.state.place:
                return f"{on} cannot be reached: it has no door; add a connector that joins it"
            number = self.sites.of_floor(on)
            return (
                None
                if self.sites.is_reachable(number)
                else self.sites.unreachable_reason(number, on)
            )
        target = self.world.objects[on]
        why = target.unsuitable(item, self.heights)
        if why is None and on not in self.made.held:
            why = self._unreachable(target)
        if why is None and target.obstacle(self.heights) is None and not target.carrier:
            for above in self.world.above.get(on, ()):
                reason = self._obstacle(above)
                if above != name and reason is not None:
                    return f"{above} stands on {on}: {reason}"
        return why

    def _limits(self, moved: dict[str, int], extra: Sequence[str]) -> None:
        """Limit the pickups of each object."""
        made = self.made
        for name in list(moved):
            moved[name] = 1
        tucked = dict.fromkeys(
            off for name in moved for off in self.tucked.get(name, ()) if name in self.tucked
        )
        for word, names in made.candidates.items():
            if word in self.wanted and all(n in moved for n in names):
                continue
            for name in names:  # space is made on a target
                target = self.world.objects[name]
                if target.obstacle(self.heights) is None and not target.carrier:
                    for above in self.world.above.get(name, ()):
                        if self._obstacle(above) is None:
                            tucked.update(dict.fromkeys([above, *self.tucked[above]]))
        for off in tucked:
            moved[off] = moved.get(off, 0) + 1
        for name in made.held:
            moved.setdefault(name, 1 if name in self.goals else 0)
        made.limits = moved
        self.off = tucked

    def _surfaces(self, moved: dict[str, int], extra: Sequence[str]) -> None:
        """Find all surfaces, and the sites at which the robot reaches them."""
        made = self.made
        self._prune()
        moved = made.limits
        aside = dict.fromkeys(on for name in moved for on in self.goals.get(name, ()))
        for name in moved:
            holder = self.world.objects[name].holder
            if holder is not None and name not in made.held:
                aside.setdefault(holder)
        targets = {n for names in made.candidates.values() for n in names}
        targets |= {o.at for o in made.operators if o.at is not None}
        targets |= {on for o in made.operators for _, on in o.on}
        for name in moved:
            options = list(dict.fromkeys(self.goals.get(name, ())))
            if name in self.off or name in made.held or name in extra:
                for on in aside:
                    item = self.world.objects.get(on)
                    if on == name or on in options or (item is None and on not in self.graph.nodes):
                        continue
                    movable = item is not None and on in moved
                    if not movable and self._unsuitable(name, on) is None:
                        options.append(on)
            for on in options:
                made.takes.setdefault(on, []).append(name)
        for name in [*moved, *made.takes, *targets]:
            item = self.world.objects.get(name)
            if item is None:
                made.fixed.add(name)
                made.spots[name] = self.sites.of_floor(name)
                continue
            if item.carrier:
                made.carriers.add(name)
            if name not in made.held:
                below = self.world.objects.get(item.holder or "")
                rides = below is not None and below.carrier and below.name in moved
                made.spots[name] = self.sites.of_object(
                    below if rides and below is not None else item
                )
            if name not in moved and (item.carrier or item.obstacle(self.heights) is not None):
                made.fixed.add(name)
        relevant = {*moved, *made.takes, *targets}
        above = {n for on in relevant if on not in made.fixed for n in self.world.above.get(on, ())}
        for name in relevant | above:
            item = self.world.objects.get(name)
            if item is not None and item.holder is not None and name not in made.held:
                made.on[name] = item.holder
        self._count_slots()

    def _count_slots(self) -> None:
        made = self.made

        def events(name: str) -> int:
            return 2 * made.limits.get(name, 0) + (name in made.held)

        def with_tucked(names: Iterable[str]) -> int:
            return sum(events(n) for n in set(names))

        several: list[int] = []
        sure: set[str] = set(made.held)
        for names in made.candidates.values():
            groups = [{n, *self.tucked.get(n, ())} | self._off_target(n) for n in names]
            if len(groups) == 1:
                sure |= groups[0]
            else:
                several.append(max(map(with_tucked, groups)))
        made.slots = with_tucked(sure) + sum(several) + self.more

    def _off_target(self, name: str) -> set[str]:
        item = self.world.objects[name]
        if item.obstacle(self.heights) is not None or item.carrier:
            return set()
        found: set[str] = set()
        for above in self.world.above.get(name, ()):
            found |= {above, *self.tucked.get(above, ())}
        return found

    # -- leaving out objects that no shortest plan uses -----------------------------------------

    def _prune(self) -> None:
        """Of objects that differ only by their sites, keep the best ones between any two others."""
        made = self.made
        if self.extend is not None:
            return
        for word in self.wanted:
            names = made.candidates[word]
            atoms = [a for a in self.goal.atoms if word in a.words]
            if len(names) < 3 or len(atoms) != 1:
                continue
            sharing = sum(bool(set(names) & set(others)) for others in made.candidates.values())
            alike = [
                n
                for n in names
                if not self.tucked.get(n)
                and n not in self.off
                and n not in made.held
                and not self._satisfied(word, n)
                and set(self.goals[n]) == set(self.goals[names[0]])
            ]
            if len(alike) <= sharing:
                continue
            rest = [n for w, ns in made.candidates.items() if w != word for n in ns]
            rest += [n for n in made.limits if n not in names]
            rest += [on for n in [*alike, *rest] for on in self.goals.get(n, ())]
            keep = self._best(alike, rest, sharing)
            dropped = set(alike) - keep
            made.candidates[word] = [n for n in names if n not in dropped]
            still = {n for ns in made.candidates.values() for n in ns}
            for name in dropped - still:
                made.limits.pop(name, None)
                self.goals.pop(name, None)
        for atom in self.goal.atoms:
            if (atom.relation != "in" and atom.relation != "on") or atom.words[0].text == ROBOT:
                continue
            self._prune_targets(atom.words[0], atom.words[1])

    def _prune_targets(self, word: Word, target: Word) -> None:
        made = self.made
        if sum(target in a.words for a in self.goal.atoms) > 1:
            return
        names = made.candidates[word]
        options = list(dict.fromkeys(on for n in names for on in self.goals.get(n, ())))
        fixed = [
            on
            for on in options
            if on not in made.limits
            and all(on in self.goals.get(n, [on]) for n in names)
            and (
                on not in self.world.objects
                or self.world.objects[on].obstacle(self.heights) is not None
            )
        ]
        if len(fixed) < 3 or any(n in self.off for n in names):
            return
        rest = [n for ns in made.candidates.values() for n in ns if n not in fixed]
        rest += list(made.limits)
        rest += [on for n in rest for on in self.goals.get(n, ()) if on not in fixed]
        dropped = set(fixed) - self._best(fixed, rest, 1, last=True)
        for name in names:
            if name in self.goals:
                self.goals[name] = [on for on in self.goals[name] if on not in dropped]
        if target in made.candidates:
            made.candidates[target] = [n for n in made.candidates[target] if n not in dropped]

    def _best(
        self, alike: Sequence[str], rest: Iterable[str], count: int, *, last: bool = False
    ) -> set[str]:
        """The `count` objects of least detour between each two sites."""
        spots = np.array([self.sites.of(n) for n in alike])
        others = sorted({0, *(self.sites.of(n) for n in dict.fromkeys(rest))})
        others += [s for s, _ in self._final_sites() if s not in others]
        sites = [self.sites.all[i] for i in others]
        here = [self.sites.all[i] for i in spots]
        to = seconds_between(self.graph, sites, here)  # (P, C)
        back = seconds_between(self.graph, here, sites)  # (C, N)
        if last or not len(others):
            back = np.column_stack([back, np.zeros(len(here))])
        keep: set[str] = set()
        for row in to:
            through = row[:, None] + back  # (C, N)
            order = np.argsort(through, axis=0, kind="stable")[:count]
            keep |= {alike[i] for i in np.unique(order)}
        return keep

    # -- where the plan ends, and travel times --------------------------------------------------

    def _final_sites(self) -> list[tuple[int, str]]:
        if not hasattr(self, "ends"):
            self.ends: list[tuple[int, str]] = []
            reasons = []
            for atom in self.goal.atoms:
                if atom.relation != "in" or atom.words[0].text != ROBOT:
                    continue
                for place in self.made.regions[atom.words[1]]:
                    if place == OUTSIDE:
                        continue
                    number = self.sites.at(place, None)
                    if place != self.state.place and not self.sites.is_reachable(number):
                        reasons.append(self.sites.unreachable_reason(number, place))
                        continue
                    self.ends.append((number, place))
                if not self.ends:
                    raise NoPlanError(_some(reasons))
        return self.ends

    def _finals(self) -> None:
        self.made.finals = self._final_sites()

    def _drives(self) -> None:
        """Compute the travel times between the sites that are used."""
        made = self.made
        used = sorted({0, *made.spots.values(), *(n for n, _ in made.finals)})
        renumbered = {old: new for new, old in enumerate(used)}
        made.sites = [self.sites.all[i] for i in used]
        made.spots = {name: renumbered[i] for name, i in made.spots.items()}
        made.finals = [(renumbered[i], place) for i, place in made.finals]
        ends = {number for number, _ in made.finals} - {*made.spots.values()}
        starts = [i for i in range(len(used)) if i not in ends]
        # no drive leads back to the start, unless an object is there
        goals = [i for i in range(len(used)) if i > 0 or i in made.spots.values()]
        made.seconds = np.full((len(used), len(used)), math.inf)
        if goals:
            made.seconds[np.ix_(starts, goals)] = seconds_between(
                self.graph, [made.sites[i] for i in starts], [made.sites[i] for i in goals]
            )
        np.fill_diagonal(made.seconds, 0.0)


def _out(height: float, heights: tuple[float, float]) -> bool:
    return not heights[0] <= height <= heights[1]


def _some(reasons: Sequence[str], most: int = 3) -> str:
    """The first reasons, without repetition."""
    each = list(dict.fromkeys(reasons))
    more = f"; and {len(each) - most} more" if len(each) > most else ""
    return "; ".join(each[:most]) + more
