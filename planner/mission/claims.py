"""Which connector or elevator a robot claims before a command, and how long it keeps the claim.

A robot claims one resource at a time and releases it before it claims the next, so robots cannot
deadlock. It claims a connector before it drives up to it, so it waits out of the way of robots that
come through. The doors of an elevator belong to the elevator, which the robot keeps from the drive
to its door until it has left the cabin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.mission.command import Command

ROOM = 0.3  # metres between two robots that pass each other in a connector, and at its sides


def claims_of(
    commands: Sequence[Command], elevators: Mapping[str, str], width: float | None = None
) -> list[str | None]:
    """For each command, the connector or elevator that its robot must claim, or None.

    `elevators` has that of each cabin. `width` is the robot's, metres; None if unknown: then no two
    robots fit through any connector.
    """
    claims = [_claim(command, elevators, width) for command in commands]
    for i in range(len(commands) - 2, -1, -1):  # a drive belongs to what it leads to
        step = commands[i].step
        if claims[i] is None and step is not None and commands[i].behaviour == "navigate":
            claims[i] = claims[i + 1]
    return claims


def _claim(command: Command, elevators: Mapping[str, str], width: float | None) -> str | None:
    step = command.step
    if step is None:
        return None
    for place in (step.from_place, step.to_place):
        if place in elevators:
            return elevators[place]
    if step.elevator is not None:
        return step.elevator
    connector = step.connector
    if connector is None:
        return None
    cabin = next((elevators[p] for p in connector.places if p in elevators), None)
    if cabin is not None:
        return cabin
    if connector.width is not None and width is not None:
        return None if connector.width >= 2 * width + 3 * ROOM else connector.name
    return connector.name
