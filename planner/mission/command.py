"""Commands: what a robot is given, one behaviour at a time (Deeken et al., section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from planner.plan import Action, Plan
from planner.route import RouteStep
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose

NEAR = 0.1  # metres within which a robot counts as being at a pose


@dataclass(frozen=True)
class Command:
    """One behaviour of a robot, with its arguments.

    Attributes
    ----------
    behaviour
        navigate, open_door, unlock_door, call_elevator, use_elevator, switch_map, pass_door,
        pickup, place, or one that a connector or a domain file names.
    arguments
        Names, as in `planner.plan.Action`.
    step
        The step of a route, with poses, connector and map; None for pickup and place.
    at
        For pickup, place and look: the base pose, in the map's frame.
    spot
        For place: the pose of the object, in the map's frame; determined when the command begins.
    seconds
        Expected duration.
    camera
        For look: the pose of the camera, in the map's frame: x ahead, z up.
    action
        For pickup and place: the id of the stored action that the robot does (`Map.grasps`), if
        one is known; determined when the command begins.
    motion
        For pickup and place by a robot whose arm is known: how the arm moves; determined with the
        action. It has the `joints`, the `width` between the fingers around the object (metres; None
        of suction cups), the `pose` of the grasp frame where the hand closes or opens, in the map's
        frame (seven numbers), and the ways, (N, D) positions of the joints, radians or metres:
        `to_pre_grasp`, to where the approach begins, `approach`, `after`, off what was put down,
        and `back`, to how the arm is carried. Each begins where the one before ends; one that the
        action lacks is empty.
    """

    behaviour: str
    arguments: tuple[str, ...]
    step: RouteStep | None = None
    at: Pose | None = None
    spot: Pose | None = None
    seconds: float = 0.0
    camera: Pose | None = None
    action: int | None = None
    motion: Mapping[str, Any] | None = None

    def __str__(self) -> str:
        return f"{self.behaviour}({', '.join(self.arguments)})"

    @property
    def needs(self) -> tuple[str, ...]:
        """The entities without which a pickup or a place cannot begin."""
        return self.arguments[: {"pickup": 1, "place": 2}.get(self.behaviour, 0)]

    @property
    def subject(self) -> str | None:
        """The object, connector or elevator that it acts on; None for drives inside a place."""
        if self.step is None:
            return self.arguments[0] if self.arguments else None
        if self.behaviour in ("call_elevator", "use_elevator"):
            return self.step.elevator
        return self.step.connector.name if self.step.connector is not None else None

    @property
    def begin(self) -> Pose | None:
        """The pose at which it begins; None: anywhere in the place."""
        return self.at if self.step is None else self.step.approach

    def begins(self, place: str, pose: Pose) -> bool:
        """Whether a robot at this pose can begin it."""
        if self.step is not None and self.step.from_place != place:
            return False
        return self.begin is None or near(self.begin, pose)

    def ends(self, place: str, pose: Pose) -> bool:
        """Whether a robot at this pose has completed its drive."""
        return self.step is not None and self.step.to_place == place and near(self.step.leave, pose)

    def as_json(self) -> dict[str, Any]:
        """As plain values, from which `of_json` makes it again."""
        value = asdict(self)
        for name in ("camera", "action", "motion"):
            if value[name] is None:
                del value[name]
        if self.step is not None and not self.step.bends:
            del value["step"]["bends"]
        if self.step is not None and self.step.connector is not None:
            value["step"]["connector"]["permissions"] = sorted(self.step.connector.permissions)
            del value["step"]["connector"]["narrowed"]  # its bends say the way
        return value

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> Command:
        """A command that `as_json` wrote."""
        step, connector = value["step"], value["step"] and value["step"]["connector"]
        if connector is not None:
            own = {
                "places": tuple(connector["places"]),
                "poses": tuple(Pose.of_json(p) for p in connector["poses"]),
                "permissions": frozenset(connector["permissions"]),
            }
            connector = PlaceConnector(**connector | own)
        if step is not None:
            ends = {name: _pose(step[name]) for name in ("approach", "leave")}
            bends = tuple((x, y) for x, y in step.get("bends", ()))
            step = RouteStep(**step | ends | {"connector": connector, "bends": bends})
        at, spot = _pose(value["at"]), _pose(value["spot"])
        camera = _pose(value.get("camera"))
        arguments = tuple(value["arguments"])
        how = value.get("action"), value.get("motion")
        return cls(value["behaviour"], arguments, step, at, spot, value["seconds"], camera, *how)


def commands_of(plan: Plan) -> list[Command]:
    """The commands of the actions of a plan, in order."""
    return [command for action in plan.actions for command in _commands(action)]


def near(a: Pose, b: Pose) -> bool:
    """Whether two positions are closer than `NEAR`."""
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z)) < NEAR


def _commands(action: Action) -> Iterator[Command]:
    done = False
    for step in action.steps:
        yield Command(step.behaviour, _arguments(step), step, seconds=step.seconds)
        done = done or step.behaviour == action.name
    moved = any(s.from_place != s.to_place for s in action.steps)
    if not done and not moved:
        spent = sum(s.seconds for s in action.steps)
        seconds = max(action.seconds - spent, 0.0)
        yield Command(
            action.name, action.names, at=action.at, seconds=seconds, camera=action.camera
        )


def _arguments(step: RouteStep) -> tuple[str, ...]:
    if step.behaviour == "call_elevator":
        return (str(step.elevator),)
    if step.behaviour == "use_elevator":
        return (str(step.elevator), step.from_place, step.to_place)
    if step.connector is None:
        return (step.from_place,)
    if step.from_place == step.to_place:
        return (step.connector.name,)
    return (step.connector.name, step.from_place, step.to_place)


def _pose(value: Any) -> Pose | None:
    return None if value is None else Pose.of_json(value)
