"""What a robot claims for itself before it begins a stage, and until when it keeps it.

A robot claims one thing at a time, and gives it back before it claims the next: nobody waits for
another while he keeps what that one waits for, and so no two robots wait for each other. It claims
before it drives up to a connector, so that it waits out of the way of who comes through. The doors
of an elevator go with the elevator, which it keeps from the way to its door until it has left it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.mission.stage import Stage
from planner.topology import Connector

__all__ = ["claims_of"]

ROOM = 0.3
"""Metres between two robots that pass each other in a connector, and at its sides."""


def claims_of(
    stages: Sequence[Stage], elevators: Mapping[str, str], width: float | None = None
) -> list[str | None]:
    """For each stage the connector or elevator that its robot must have for itself, or None.

    Parameters
    ----------
    elevators : the elevator of each place that is a cabin
    width : of the robot, metres; None: unknown, no two fit through any connector
    """
    claims = [_claim(stage, elevators, width) for stage in stages]
    for i in range(len(stages) - 2, -1, -1):  # with what it leads to, if it leads into no other
        step = stages[i].step
        if claims[i] is None and step is not None and stages[i].behaviour == "navigate":
            claims[i] = claims[i + 1]
    return claims


def _claim(stage: Stage, elevators: Mapping[str, str], width: float | None) -> str | None:
    step = stage.step
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
    return connector.name if _narrow(connector, width) else None


def _narrow(connector: Connector, width: float | None) -> bool:
    if connector.width is None or width is None:
        return True
    return connector.width < 2 * width + 3 * ROOM
