"""Checks which objects the robot can pick up, and on which surfaces it can put them."""

from __future__ import annotations

from planner.tasks.problem_draft import ProblemDraft
from planner.tasks.world import TaskObject


class ObjectChecks:
    """Why objects cannot be picked up or put down; each pickup is checked once.

    `tucked` has the objects to take off each checked object before its pickup.
    """

    def __init__(self, draft: ProblemDraft) -> None:
        self.draft = draft
        self.tucked: dict[str, list[str]] = {}
        self._obstacles: dict[str, str | None] = {}

    def obstacle(self, name: str) -> str | None:
        """Why an object, or an object on it, cannot be picked up; else None."""
        if name in self._obstacles:
            return self._obstacles[name]
        self._obstacles[name] = None
        world = self.draft.world
        item = world.objects[name]
        why = item.obstacle(self.draft.heights) or self._unreachable(item) or world.misfit(name)
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

    def unsuitable(self, name: str, on: str) -> str | None:
        """Why the robot cannot put an object on another one, or on a floor; else None."""
        draft, sites = self.draft, self.draft.sites
        problem, world = draft.problem, draft.world
        item = world.objects[name]
        if on not in world.objects:
            if not len(draft.graph.nodes.get(on, ())) and on != problem.state.place:
                return f"{on} cannot be reached: it has no door; add a connector that joins it"
            number = sites.of_floor(on)
            return None if sites.is_reachable(number) else sites.unreachable_reason(number, on)
        target = world.objects[on]
        why = target.unsuitable(item, draft.heights)
        if why is None and on not in problem.held:
            why = self._unreachable(target)
        if why is None and self.needs_space(target):
            for above in world.above.get(on, ()):
                reason = self.obstacle(above)
                if above != name and reason is not None:
                    return f"{above} stands on {on}: {reason}"
        return why

    def needs_space(self, target: TaskObject) -> bool:
        """Whether the objects on a target are taken off before another one is put there."""
        return target.obstacle(self.draft.heights) is None and not target.carrier

    def _unreachable(self, item: TaskObject) -> str | None:
        if item.place is None:
            return f"{item.name} is in no room that the map knows; place it in one"
        sites = self.draft.sites
        number = sites.of_object(item)
        return None if sites.is_reachable(number) else sites.unreachable_reason(number, item.name)
