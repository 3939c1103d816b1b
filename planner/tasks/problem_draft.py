"""A problem while it is built, with the map's data that it is built from."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import compress

from planner.routing_graph import RoutingGraph
from planner.tasks.goal import ROBOT, Word
from planner.tasks.problem import NoPlanError, Problem, join_reasons
from planner.tasks.sites import Sites
from planner.tasks.world import TaskObject, TaskWorld
from planner.topology import OUTSIDE

ROOMY = 2.0
"""How many times the ground of all that the goal moves is room enough beside what stands there."""

SAME = 1e-3  # metres between two poses below which a drive from one to the other is none


class ProblemDraft:
    """What every step of building a problem reads; the steps fill `problem`.

    `wanted` are the words for the objects that the goal moves, `surfaces` the objects and places on
    which it wants each of them. `tucked` has the objects to take off each checked object.
    """

    def __init__(
        self, graph: RoutingGraph, world: TaskWorld, sites: Sites, problem: Problem
    ) -> None:
        self.graph, self.world, self.sites, self.problem = graph, world, sites, problem
        self.heights = graph.robot.heights
        self.wanted: list[Word] = []
        self.surfaces: dict[str, list[str]] = {}
        self.tucked: dict[str, list[str]] = {}
        self._obstacles: dict[str, str | None] = {}  # each pickup is checked once
        self._no_place: dict[tuple[str, str, bool], str | None] = {}

    def obstacle(self, name: str) -> str | None:
        """Why an object, or an object on it, cannot be picked up; else None."""
        if name in self._obstacles:
            return self._obstacles[name]
        self._obstacles[name] = None
        world = self.world
        item = world.objects[name]
        why = item.obstacle(self.heights) or self._unreachable(item) or world.misfit(name)
        off: list[str] = []
        if why is None and not item.carrier:
            for above in world.above.get(name, ()):
                reason = self.obstacle(above)
                if reason is not None:
                    why = f"{above} stands on {name}: {reason}"
                    break
                off += [above, *self.tucked[above]]
        self.tucked[name] = off
        self._obstacles[name] = why
        return why

    def unsuitable(self, name: str, on: str, *, inside: bool = False) -> str | None:
        """Why the robot cannot put an object on or in another one, or on a floor; else None."""
        problem, sites, world = self.problem, self.sites, self.world
        if on not in world.objects:
            if not len(self.graph.nodes.get(on, ())) and on != problem.state.place:
                return f"{on} cannot be reached: it has no door; add a connector that joins it"
            number = sites.of_floor(on)
            return None if sites.is_reachable(number) else sites.unreachable_reason(number, on)
        target = world.objects[on]
        why = self.no_place(name, on, inside)
        if why is None and on not in problem.held:
            why = self._unreachable(target)
        if why is None and self.needs_space(target):
            for above in world.above.get(on, ()):
                reason = self.obstacle(above)
                if above != name and reason is not None:
                    return f"{above} stands on {on}: {reason}"
        return why

    def no_place(self, name: str, on: str, inside: bool) -> str | None:
        """Why an object, or the hand with it, has no place on or in another one; else None."""
        key = name, on, inside
        if key not in self._no_place:
            item, target = self.world.objects[name], self.world.objects[on]
            why = target.unsuitable(item, self.heights, inside=inside)
            if why is None and not self.needs_space(target):
                is_open = target.is_open(self.heights, inside=inside)
                why = self.world.no_place(name, on, inside, is_open)
            self._no_place[key] = why
        return self._no_place[key]

    def needs_space(self, target: TaskObject) -> bool:
        """Whether the objects on a target are taken off before another one is put there.

        They are on small ones, such as a book, if their free surface is not known to suffice.
        """
        if target.carrier or target.obstacle(self.heights) is not None:
            return False
        grounds = [
            max((self.world.objects[n].ground for n in self.problem.candidates[word]), default=0.0)
            for word in self.wanted
        ]
        return not ROOMY * sum(grounds) <= target.surface < math.inf

    def _unreachable(self, item: TaskObject) -> str | None:
        if item.place is None:
            return f"{item.name} is in no room that the map knows; place it in one"
        sites = self.sites
        number = sites.of_object(item)
        return None if sites.is_reachable(number) else sites.unreachable_reason(number, item.name)

    def satisfied(self, word: Word, name: str) -> bool:
        """Whether an object is already where the goal requires it."""
        problem = self.problem
        item = self.world.objects[name]
        for atom in problem.goal.atoms:
            if atom.relation == "carries" and atom.words[1] == word:
                return False
            if atom.relation in ("on", "in") and atom.words[0] == word:
                target, places = atom.words[1], problem.regions.get(atom.words[1])
                where = item.holder if places is None else item.place
                if where not in (problem.candidates[target] if places is None else places):
                    return False
                inside = places is None and atom.relation == "in" and where is not None
                if inside and not self.world.objects[str(where)].has_inside(item):
                    return False
        return True

    @cached_property
    def finals(self) -> list[tuple[int, str]]:
        """The numbers of the sites, each with its place or region; NoPlanError without one."""
        problem, sites = self.problem, self.sites
        ends: list[tuple[int, str]] = []
        reasons: list[str] = []
        for atom in problem.goal.atoms:
            if atom.relation != "in" or atom.words[0].text != ROBOT:
                continue
            for name in problem.regions[atom.words[1]]:
                if name == OUTSIDE:
                    continue
                for number in self._end_sites(name):
                    here = number == 0 or name == problem.state.place
                    if here or sites.is_reachable(number):
                        ends.append((number, name))
                    else:
                        reasons.append(sites.unreachable_reason(number, name))
            if not ends:
                raise NoPlanError(join_reasons(reasons) or f"{atom}: the robot fits nowhere there")
        return ends

    def _end_sites(self, name: str) -> list[int]:
        """The site of a place, or those of a region; where the robot is, if it is there already."""
        state, sites = self.problem.state, self.sites
        topology = sites.graph.topology
        if name in topology.places:
            return [sites.at(name, None)]
        region = next(r for r in topology.regions if r.name == name)
        found = sites.of_region(region)
        if state.place in region.places and state.pose is not None and region.contains(state.pose):
            here = state.pose[:3]
            poses = [sites.all[n].pose for n in found]
            apart = [pose is None or math.dist(pose[:3], here) > SAME for pose in poses]
            return [0, *compress(found, apart)]
        return found

    @cached_property
    def inside(self) -> dict[str, list[TaskObject]]:
        """The objects in each place."""
        places: dict[str, list[TaskObject]] = {}
        for item in self.world.objects.values():
            if item.place is not None:
                places.setdefault(item.place, []).append(item)
        return places
