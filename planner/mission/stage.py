"""What is handed to the robot, one behaviour at a time (Deeken et al., section 4.1)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from planner.plan import Action, Plan
from planner.route import Step
from planner.topology import Connector
from semmap.geometry.pose import Pose

__all__ = ["Stage", "stages_of"]

NEAR = 0.1
"""Metres within which a robot stands at a pose."""


@dataclass(frozen=True)
class Stage:
    """One behaviour, and all that it is given.

    Attributes
    ----------
    behaviour : navigate, open_door, unlock_door, call_elevator, use_elevator, switch_map,
        pass_door, pickup, place, or one that a connector or a domain file names
    arguments : names, as `planner.plan.Action` has them
    step : of what leads along a route: its poses, its connector, its map
    at : of what is done in place: where the base stands, in the map's frame
    spot : of place: where the thing shall lie, in the map's frame; found when it begins
    seconds : how long it is thought to take
    """

    behaviour: str
    arguments: tuple[str, ...]
    step: Step | None = None
    at: Pose | None = None
    spot: Pose | None = None
    seconds: float = 0.0

    def __str__(self) -> str:
        return f"{self.behaviour}({', '.join(self.arguments)})"

    @property
    def subject(self) -> str | None:
        """What it is done to: a thing, a connector or an elevator; None for ways inside a place."""
        if self.step is None:
            return self.arguments[0] if self.arguments else None
        if self.behaviour in ("call_elevator", "use_elevator"):
            return self.step.elevator
        return self.step.connector.name if self.step.connector is not None else None

    @property
    def begin(self) -> Pose | None:
        """Where the robot stands as it begins; None: anywhere in the place."""
        return self.at if self.step is None else self.step.approach

    def begins(self, place: str, pose: Pose) -> bool:
        """Whether a robot there can begin it."""
        if self.step is not None and self.step.from_place != place:
            return False
        return self.begin is None or near(self.begin, pose)

    def ends(self, place: str, pose: Pose) -> bool:
        """Whether a robot there has gone all its way."""
        return self.step is not None and self.step.to_place == place and near(self.step.leave, pose)

    def as_json(self) -> dict[str, Any]:
        """As plain values, from which `of_json` makes it again."""
        said = asdict(self)
        if self.step is not None and self.step.connector is not None:
            said["step"]["connector"]["permissions"] = sorted(self.step.connector.permissions)
        return said

    @classmethod
    def of_json(cls, said: Mapping[str, Any]) -> Stage:
        """A stage that `as_json` wrote."""
        step = None
        if said["step"] is not None:
            connector = said["step"]["connector"]
            if connector is not None:
                connector = Connector(
                    **{
                        **connector,
                        "places": tuple(connector["places"]),
                        "poses": tuple(Pose.of_json(p) for p in connector["poses"]),
                        "permissions": frozenset(connector["permissions"]),
                    }
                )
            step = Step(
                **{
                    **said["step"],
                    "connector": connector,
                    "approach": _pose(said["step"]["approach"]),
                    "leave": Pose.of_json(said["step"]["leave"]),
                }
            )
        return cls(
            said["behaviour"], tuple(said["arguments"]), step, _pose(said["at"]),
            _pose(said["spot"]), said["seconds"],
        )  # fmt: skip


def stages_of(plan: Plan) -> list[Stage]:
    """The stages of a plan's actions, in order: the steps of each, then what it does in place."""
    return [stage for action in plan.actions for stage in _stages(action)]


def near(a: Pose, b: Pose) -> bool:
    """Whether two poses are the same place to stand."""
    return math.dist((a.x, a.y, a.z), (b.x, b.y, b.z)) < NEAR


def _stages(action: Action) -> Iterator[Stage]:
    done = False
    for step in action.steps:
        yield Stage(step.behaviour, _arguments(step), step, seconds=step.seconds)
        done = done or step.behaviour == action.name
    moved = any(s.from_place != s.to_place for s in action.steps)
    if not done and not moved:
        spent = sum(s.seconds for s in action.steps)
        yield Stage(
            action.name, action.names, at=action.at, seconds=max(action.seconds - spent, 0.0)
        )


def _arguments(step: Step) -> tuple[str, ...]:
    if step.behaviour == "call_elevator":
        return (str(step.elevator),)
    if step.behaviour == "use_elevator":
        return (str(step.elevator), step.from_place, step.to_place)
    if step.connector is None:
        return (step.from_place,)
    if step.from_place == step.to_place:
        return (step.connector.name,)
    return (step.connector.name, step.from_place, step.to_place)


def _pose(said: Any) -> Pose | None:
    return None if said is None else Pose.of_json(said)


def with_spot(stage: Stage, spot: Pose) -> Stage:
    """The stage, told where the thing shall lie."""
    return replace(stage, spot=spot)
