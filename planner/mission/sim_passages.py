"""How a simulated robot opens doors, passes connectors, and rides in elevators."""

from __future__ import annotations

from planner.mission.behaviours import Cause
from planner.mission.command import Command
from planner.mission.sim_body import SimBody, Work, lasting
from semmap.geometry.pose import Pose

Failure = tuple[Cause, str]


def open_door(body: SimBody, command: Command) -> Work:
    """Leave the door ajar: it closes again behind the robot."""
    return (yield from _open(body, command, unlocks=False))


def unlock_door(body: SimBody, command: Command) -> Work:
    """Leave the door ajar."""
    return (yield from _open(body, command, unlocks=True))


def _open(body: SimBody, command: Command, *, unlocks: bool) -> Work:
    name, world = _connector(command), body.world
    yield from lasting(command.seconds)
    with world.change():
        if not body.stands_at(command):
            return body.misplaced(command)
        state = world.door(name)
        if state == "locked" and not unlocks:
            return "locked", f"{name} is locked"
        if body.fails(command.behaviour):
            return "closed", f"{name} does not open"
        if state == "locked":
            world.set_door(name, "closed")
        if state in ("closed", "locked") and _is_there(body, name):
            world.set_door(name, "ajar")
        elif state == "closed":
            return "absent", f"the elevator is not behind {name}"
    return None, ""


def _is_there(body: SimBody, door: str) -> bool:
    """Whether a door is not an elevator door, or its elevator stands behind it."""
    lift = body.elevator_of(door)
    return lift is None or body.world.elevator(lift)[0] == body.cabin_doors[lift][door]


def pass_connector(body: SimBody, command: Command) -> Work:
    """Pass a connector that is open or ajar: a door, an opening, a ramp or a flight of stairs."""
    with body.world.change():
        obstacle = _obstacle(body, command)
    if obstacle is not None:
        return obstacle
    fails = body.fails(command.behaviour)
    crossed = False
    at, seconds = 0.0, max(command.seconds, 1e-3)
    while at < seconds:
        at = min((yield seconds), seconds)
        if fails and at >= 0.25 * seconds:
            return "blocked", f"something stands in {_connector(command)}"
        if at >= 0.5 * seconds and not crossed:
            crossed = True
            with body.world.change():
                _cross(body, command)
    with body.world.change():
        _leave_behind(body, command)
    return None, ""


def _obstacle(body: SimBody, command: Command) -> Failure | None:
    """Why the robot cannot begin to pass a connector."""
    step, name = command.step, _connector(command)
    assert step is not None
    if not body.stands_at(command):
        return body.misplaced(command)
    state = body.world.door(name)
    if state == "locked":
        return "locked", f"{name} is locked"
    if state == "closed":
        return "closed", f"{name} is closed"
    lift = body.elevator_of(name)
    if lift is not None:
        cabin, occupant = body.world.elevator(lift)
        if cabin not in (step.from_place, step.to_place):
            return "absent", f"{lift} is not behind {name}"
        if occupant not in (None, body.name):
            return "blocked", f"{occupant} is in {lift}"
    return None


def _cross(body: SimBody, command: Command) -> None:
    """Put the robot, and what it holds, on the other side."""
    step, name, world = command.step, _connector(command), body.world
    assert step is not None
    middle = _between(step.approach or step.leave, step.leave, 0.6)
    world.put_robot(body.name, step.to_place, middle)
    world.carry(body.name, step.to_place)
    world.log(body.name, "passed", name)
    lift = body.elevator_of(name)
    if lift is not None:
        cabin = world.elevator(lift)[0]
        inside = cabin == step.to_place
        world.log(body.name, "entered" if inside else "left", lift)
        world.set_elevator(lift, cabin, body.name if inside else None)
        world.set_door(name, "ajar")


def _leave_behind(body: SimBody, command: Command) -> None:
    """Put the robot at the end of the passage; a door that was ajar closes."""
    step, name = command.step, _connector(command)
    assert step is not None
    body.world.put_robot(body.name, step.to_place, step.leave)
    if body.world.door(name) == "ajar" and body.elevator_of(name) is None:
        body.world.set_door(name, "closed")  # left as it was


def call_elevator(body: SimBody, command: Command) -> Work:
    """The elevator comes, unless another robot is in it."""
    step, name, world = command.step, _connector(command), body.world
    assert step is not None
    lift = str(step.elevator)
    at = yield command.seconds
    while at < command.seconds:
        at = yield command.seconds
    while True:
        with world.change():
            if not body.stands_at(command):
                return body.misplaced(command)
            if world.is_broken(lift) or body.fails("call_elevator"):
                return "absent", f"{lift} does not come"
            _, occupant = world.elevator(lift)
            if occupant in (None, body.name):
                world.set_elevator(lift, body.cabin_doors[lift][name], None)
                world.set_door(name, "ajar")
                world.log(body.name, "called", lift)
                return None, ""
        if at >= command.seconds + body.wait:
            return "absent", f"{lift} does not come: {occupant} is in it"
        at = yield at


def use_elevator(body: SimBody, command: Command) -> Work:
    """Ride to another storey."""
    step, world = command.step, body.world
    assert step is not None
    lift = str(step.elevator)
    with world.change():
        place, _ = world.robot(body.name)
        if place != step.from_place or world.elevator(lift)[0] != place:
            return body.misplaced(command)
        if world.is_broken(lift) or body.fails("use_elevator"):
            return "absent", f"{lift} does not leave"
    yield from lasting(command.seconds)
    with world.change():
        world.set_elevator(lift, step.to_place, body.name)
        for name, cabin in body.cabin_doors[lift].items():
            if cabin == step.to_place:
                world.set_door(name, "ajar")
        world.put_robot(body.name, step.to_place, step.leave)
        world.carry(body.name, step.to_place)
        world.log(body.name, "rode", lift)
    return None, ""


def _connector(command: Command) -> str:
    assert command.step is not None
    assert command.step.connector is not None
    return command.step.connector.name


def _between(a: Pose, b: Pose, share: float) -> Pose:
    x, y, z = (p + (q - p) * share for p, q in zip(a[:3], b[:3], strict=True))
    return Pose(x, y, z, b.qx, b.qy, b.qz, b.qw)
