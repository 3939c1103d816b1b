"""Plays a plan against the world and finds what is wrong with it; shares nothing with the planner.

Each action is checked: the robot is where the action begins, the connector leads there and lets it
pass, the object is there, clear and within reach, the gripper is free. The
time is added up again from poses, states of doors and heights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from planner.graph_edges import StraightTravelCost, TravelCost
from planner.plan import Action, Plan
from planner.robot_class import Durations, RobotClass
from planner.tasks.goal import ROBOT, Goal, Word
from planner.tasks.world import TaskState, TaskWorld
from planner.topology import OUTSIDE, Topology
from semmap.geometry.pose import Pose


class InvalidPlanError(ValueError):
    """A plan that cannot be carried out, or that does not reach its goal; with the action."""


def validate(
    plan: Plan,
    topology: Topology,
    robot: RobotClass,
    world: TaskWorld,
    state: TaskState,
    goal: Goal,
    *,
    times: Durations | None = None,
    walks: TravelCost | None = None,
) -> None:
    """Replay a plan.

    Raises
    ------
    InvalidPlanError
        With the first action that fails, and why; or that the goal is not reached, or that the
        plan's seconds are not what its actions take.
    """
    _Replay(topology, robot, world, state, times or Durations(), walks).run(plan, goal)


class _Replay:
    def __init__(
        self,
        topology: Topology,
        robot: RobotClass,
        world: TaskWorld,
        state: TaskState,
        times: Durations,
        walks: TravelCost | None,
    ) -> None:
        self.topology, self.robot, self.world, self.times = topology, robot, world, times
        self.walks = walks or StraightTravelCost(robot.speed)
        self.place, self.pose = state.place, state.pose
        self.held = set(state.carrying)
        self.below = {
            t.name: t.holder
            for t in world.objects.values()
            if t.holder is not None and t.name not in self.held
        }
        self.room = {t.name: t.place for t in world.objects.values()}
        self.called: str | None = None
        self.opened: str | None = None
        self.seconds = 0.0

    def run(self, plan: Plan, goal: Goal) -> None:
        for number, action in enumerate(plan.actions, 1):
            before = self.seconds
            why = self._play(action)
            if why is None and not math.isclose(
                self.seconds - before, action.seconds, abs_tol=1e-6
            ):
                why = f"takes {self.seconds - before:.3f} s, not {action.seconds:.3f} s"
            if why is not None:
                raise InvalidPlanError(f"action {number}, {action}: {why}")
        if not math.isclose(self.seconds, plan.seconds, abs_tol=1e-6):
            raise InvalidPlanError(f"it takes {self.seconds:.3f} s, not {plan.seconds:.3f} s")
        if not self._reached(goal):
            raise InvalidPlanError(f"it does not reach {goal.text}")

    def _play(self, action: Action) -> str | None:
        if action.name == "pickup":
            return self._pickup(action)
        if action.name == "place":
            return self._put(action)
        if action.name == "call_elevator":
            return self._call(action)
        if action.name == "use_elevator":
            return self._ride(action)
        if action.name in ("open_door", "unlock_door"):
            return self._open(action)
        if action.name == "navigate":
            return self._walk_to(action.steps[-1].leave if action.steps else None)
        if action.names and action.names[0] in self.topology.connectors:
            return self._pass(action)
        return "no such action"

    # -- moving ------------------------------------------------------------------------------------

    def _walk_to(self, pose: Pose | None) -> str | None:
        """Walk inside of the place where the robot is."""
        if pose is None:
            self.pose = None
        elif self.pose is None:
            self.pose = pose  # nobody said where in the place it was
        else:
            took = float(self.walks.between(self.place, [self.pose], [pose]).seconds[0, 0])
            if math.isinf(took):
                return f"no way leads through {self.place} to ({pose.x:.2f}, {pose.y:.2f})"
            self.seconds += took
            self.pose = pose
        return None

    def _side(self, name: str) -> int | None:
        places = self.topology.connectors[name].places
        return places.index(self.place) if self.place in places else None

    def _at_door(self, name: str) -> str | None:
        if name not in self.topology.connectors:
            return f"there is no {name}"
        side = self._side(name)
        if side is None:
            return f"{name} is not in {self.place}"
        return self._walk_to(self.topology.connectors[name].poses[side])

    def _open(self, action: Action) -> str | None:
        name = action.names[0]
        why = self._at_door(name)
        if why is not None:
            return why
        door = self.topology.connectors[name]
        wanted = "closed" if action.name == "open_door" else "locked"
        if door.state != wanted:
            return f"{name} is {door.state}"
        if not (self.robot.opens if wanted == "closed" else self.robot.unlocks):
            return f"the robot cannot: {name} is {wanted}"
        self.seconds += self._opening(name)
        self.opened = name
        return None

    def _opening(self, name: str) -> float:
        door = self.topology.connectors[name]
        kind = {"closed": "open_door", "locked": "unlock_door"}[door.state]
        usual = self.times.open if door.state == "closed" else self.times.unlock
        return self.times.measured.get((kind, name), usual)

    def _call(self, action: Action) -> str | None:
        step = action.steps[-1]
        if step.connector is None or step.elevator is None:
            return "it does not say which"
        why = self._at_door(step.connector.name)
        if why is not None:
            return why
        self.seconds += self.times.measured.get(("call_elevator", step.elevator), self.times.call)
        self.called = step.elevator
        return None

    def _pass(self, action: Action) -> str | None:
        name, here, there = action.names
        door = self.topology.connectors[name]
        why = self._at_door(name)
        if why is not None:
            return why
        side = self._side(name)
        assert side is not None
        if (here, there) != (door.places[side], door.places[1 - side]):
            return f"{name} leads from {door.places[side]} to {door.places[1 - side]}"
        if door.direction != "both" and (door.direction == "forward") != (side == 0):
            return f"{name} is not passed from {here}"
        if door.permissions and not door.permissions & self.robot.permissions:
            return f"the robot has no permission for {name}"
        for part in self.robot.parts:
            if door.height is not None and part.interval[1] > door.height:
                return f"the {part.name} is too high for {name}"
        cabin = self.topology.places[there].elevator
        if cabin is not None and self.topology.places[here].elevator != cabin:
            if self.called != cabin:
                return f"{cabin} was not called"
            self.called = None
        alone = door.type == "elevator_door" and door.state == "closed"  # the elevator opens it
        if door.state != "open" and self.opened != name and not alone:
            return f"{name} is {door.state}"
        a, b = ((p.x, p.y, p.z) for p in door.poses)
        through = math.dist(a, b) / self.robot.speed
        self.seconds += self.times.measured.get((door.behaviour, name), through)
        self.place, self.pose, self.opened = there, door.poses[1 - side], None
        if there == OUTSIDE and not self.robot.outside:
            self.pose = door.poses[1 - side]
        return None

    def _ride(self, action: Action) -> str | None:
        elevator = self.topology.places[self.place].elevator
        if elevator is None:
            return f"{self.place} is no elevator"
        step = action.steps[-2] if action.steps[-1].behaviour == "switch_map" else action.steps[-1]
        target = self.topology.places.get(step.to_place)
        if target is None or target.elevator != elevator:
            return f"{elevator} does not lead to {step.to_place}"
        doors = [
            (c, i)
            for c in self.topology.connectors.values()
            for i in (0, 1)
            if c.places[i] == target.name
        ]
        ends = [
            c.poses[i]
            for c, i in doors
            if (c.poses[i].x, c.poses[i].y, c.poses[i].z)
            == (step.leave.x, step.leave.y, step.leave.z)
        ]
        if not ends:
            return f"{target.name} has no door at which that ends"
        before = self.seconds
        if self.pose is not None and step.approach is not None:
            why = self._walk_to(step.approach)
            if why is not None:
                return why
        begin = before if self.pose is None else self.seconds
        rise = across = 0.0
        if self.pose is not None:
            rise = abs(ends[0].z - self.pose.z)
            across = math.hypot(ends[0].x - self.pose.x, ends[0].y - self.pose.y)
        usual = self.times.measured.get(("use_elevator", elevator), self.times.ride)
        self.seconds = begin + usual + self.times.ride_per_metre * rise
        self.seconds += across / self.robot.speed
        self.place, self.pose = target.name, ends[0]
        return None

    # -- handling ----------------------------------------------------------------------------------

    def _where(self, name: str) -> str | None:
        """The room in which an object is, by what it stands on."""
        seen = name
        while seen in self.below and self.below[seen] in self.world.objects:
            seen = self.below[seen]
            if seen in self.held:
                return None
        return self.below.get(seen, self.room.get(seen)) if seen in self.below else self.room[seen]

    def _pickup(self, action: Action) -> str | None:
        name, on = action.names
        item = self.world.objects.get(name)
        if item is None:
            return f"there is no {name}"
        if self.below.get(name) != on:
            return f"{name} is not on {on}"
        if self._where(name) != self.place:
            return f"{name} is in {self._where(name)}, the robot in {self.place}"
        if len(self.held) >= self.robot.capacity:
            return f"the robot carries {', '.join(sorted(self.held))}"
        carrier = item.properties.get("carrier", "tray" in item.types)
        above = [a for a, b in self.below.items() if b == name]
        if above and not carrier:
            return f"{above[0]} stands on {name}"
        if not self.robot.heights[0] <= item.height <= self.robot.heights[1]:
            return f"{name} is {item.height} m high"
        if item.graspable is False:
            return f"{name} cannot be lifted"
        why = self._walk_to(action.at)
        if why is not None:
            return why
        self.seconds += self.times.pickup
        del self.below[name]
        self.held.add(name)
        return None

    def _put(self, action: Action) -> str | None:
        name, on = action.names
        if name not in self.held:
            return f"the robot does not carry {name}"
        target = self.world.objects.get(on)
        where = on if target is None else self._where(on)
        if on in self.held or where is None:
            return f"the robot carries {on}"
        if where != self.place:
            return f"{on} is in {where}, the robot in {self.place}"
        if target is not None:
            if not self.robot.heights[0] <= target.surface_height <= self.robot.heights[1]:
                return f"{on} is {target.surface_height} m high"
            item = self.world.objects[name]
            if item.size[0] * item.size[1] > target.surface:
                return f"{on} has no room for {name}"
        why = self._walk_to(action.at)
        if why is not None:
            return why
        self.seconds += self.times.place
        self.held.remove(name)
        self.below[name] = on
        return None

    # -- the goal ----------------------------------------------------------------------------------

    def _reached(self, goal: Goal) -> bool:
        """Whether there are objects for the goal's words for which all of it is so."""
        return self._meant(goal, list(goal.words()), {})

    def _meant(self, goal: Goal, words: list[Word], so_far: Mapping[Word, str]) -> bool:
        if not words:
            return all(
                self._holds(
                    atom.relation, [ROBOT if w.text == ROBOT else so_far[w] for w in atom.words]
                )
                for atom in goal.atoms
            )
        word, *rest = words
        named = word.text in self.world.objects or word.text in self.topology.places
        if named and word.number == 0:
            options = [word.text]
        else:
            options = [
                t.name for t in self.world.objects.values() if word.text in (t.label, *t.types)
            ] or [
                p.name
                for p in self.topology.places.values()
                if word.text in (p.label, p.type, *p.types)
            ]
        return any(
            self._meant(goal, rest, {**so_far, word: name})
            for name in options
            if not any(w.text == word.text and n == name for w, n in so_far.items())
        )

    def _holds(self, relation: str, names: list[str]) -> bool:
        a, b = names
        if relation == "carries":
            return b in self.held
        if a == ROBOT:
            return self.place == b
        if relation == "in" and b in self.topology.places:
            return a not in self.held and self._where(a) == b
        return self.below.get(a) == b
